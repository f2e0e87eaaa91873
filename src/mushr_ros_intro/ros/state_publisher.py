"""Publish the state of the simulated car."""

import threading
import time
from typing import Callable, List, Optional

import rospy
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Car, Contact, State
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.footprint import on_map

READY_POLL_PERIOD = 0.1
"""Period at which it is checked whether the car is ready [s of wall-clock time]."""


class StatePublisher:
    """The publishers of a car's state, relative to its namespace.

    ``car_pose``, ``odom``, ``joint_states``, /tf, and ``~collision``, latched: the pose of the car
    if it touches a wall, otherwise no pose.
    """

    def __init__(self, car: Car, now: int, loses_states: bool) -> None:
        """Advertise the topics.

        Args:
            car: the car.
            now: the present [ns].
            loses_states: whether a slow subscriber loses old states rather than getting them late.
        """
        self.world: Optional[World] = None
        """The map; None if there is none."""
        self._pose: Optional[Pose] = None  # the last one that was published
        self._announced: Optional[Contact] = None
        self._is_on_map = True
        prefix = rospy.get_namespace().strip("/")
        odom_frame, base_frame = (
            f"{prefix}/{name}".lstrip("/") for name in ("odom", "base_footprint")
        )

        def odometry(state: State) -> Odometry:
            return conversions.odometry_to_msg(state, car, odom_frame, base_frame)

        def joint_states(state: State) -> JointState:
            return conversions.joint_states_to_msg(state, car)

        def transforms(state: State) -> TFMessage:
            return TFMessage(conversions.transforms_to_msgs(state, odom_frame, base_frame))

        queue_size = 1 if loses_states else 10_000
        self._publishers = [
            (rospy.Publisher(topic, kind, queue_size=queue_size, tcp_nodelay=True), convert)
            for topic, kind, convert in (
                ("car_pose", PoseStamped, conversions.car_pose_to_msg),
                ("odom", Odometry, odometry),
                ("joint_states", JointState, joint_states),
                # Not tf2_ros.TransformBroadcaster: it publishes the same, and needs 7 MB.
                ("/tf", TFMessage, transforms),
            )
        ]
        self._collision_pub = rospy.Publisher("~collision", PoseArray, queue_size=10, latch=True)
        self._collision_pub.publish(conversions.collision_to_msg(None, now))

    def publish(self, states: List[State]) -> None:
        """Publish states on every topic that has a subscriber."""
        for state in states:
            for publisher, convert in self._publishers:
                if publisher.get_num_connections():
                    publisher.publish(convert(state))
            self._pose = state.pose
            self._announce_contact(state)

    def announce(self, is_ready: Callable[[], bool]) -> None:
        """Log the pose and what to type, as soon as poses are published and the car is ready."""

        def wait_and_log() -> None:
            while self._pose is None or not is_ready():
                if rospy.is_shutdown():
                    return
                time.sleep(READY_POLL_PERIOD)
            name = rospy.get_namespace().strip("/")
            rospy.loginfo(
                "ready: the car is at %s. To drive a plan, type in another terminal: "
                "roslaunch mushr_ros_intro path_publisher.launch%s",
                self._pose,
                "" if name == "car" else f" car_name:={name}",
            )

        threading.Thread(target=wait_and_log, daemon=True).start()

    def _announce_contact(self, state: State) -> None:
        """Publish a changed collision; log once if the car hit a wall or left the map."""
        if state.collision != self._announced:
            self._announced = state.collision
            self._collision_pub.publish(conversions.collision_to_msg(state.collision, state.stamp))
            if state.collision:
                rospy.logwarn(
                    f"the car hit a wall and stopped at {state.collision.pose}; drive it away from "
                    "the wall, or place it elsewhere"
                )
        if self.world is None:
            return
        is_on_map = on_map(*self.world, state.pose)
        if self._is_on_map and not is_on_map:
            rospy.logwarn(f"the car left the map at {state.pose}; there are no walls outside")
        self._is_on_map = is_on_map
