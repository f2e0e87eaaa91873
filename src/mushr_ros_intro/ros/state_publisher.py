"""Publish the state of the simulated car."""

from typing import List, Optional

import rospy
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Car, Contact, State
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.footprint import on_map


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
            self._announce(state)

    def _announce(self, state: State) -> None:
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
