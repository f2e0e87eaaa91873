"""Publish the state of the simulated car."""

import threading
import time
from collections import deque
from contextlib import suppress
from typing import Callable, Deque, Iterator, List, Optional, Tuple

import rospy
from geometry_msgs.msg import PoseArray, PoseStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import Car, Contact, State, Wheels, front_wheel_angles, wheel_rates
from mushr_ros_intro.car.odometry import Odometer
from mushr_ros_intro.car.odometry import Odometry as Measured
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros import conversions, rospy_fixes
from mushr_ros_intro.ros.commands import as_typed, drive_command
from mushr_ros_intro.ros.ros_time import SHUTDOWN_POLL_PERIOD
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import World, on_map

_DRAWN_STEP = 0.1
"""Distance between the drawn poses of the driven path [m]."""

_DRAWN_POSES = 2000
"""Limit of the number of poses of the driven path; the oldest ones are dropped."""

_DRAWN_PERIOD = 0.1
"""Shortest time between two messages with the driven path [s of wall-clock time]."""

Convert = Callable[[State, Measured], rospy.Message]
"""Returns the message with a state of the car and its measured odometry."""

READY_POLL_PERIOD = 0.1
"""Period at which it is checked whether the car is ready [s of wall-clock time]."""


class StatePublisher:
    """The publishers of a car's state, relative to its namespace.

    ``car_pose``, ``odom``, ``joint_states``, /tf, and ``~collision``, latched: the pose of the car
    if it touches a wall, otherwise no pose. For rviz: ``driven_path``; see `DrivenPath`.
    """

    def __init__(self, car: Car, now: int, loses_states: bool, prefix: str, with_map: bool) -> None:
        """Advertise the topics.

        Args:
            car: the car.
            now: the current time [ns].
            prefix: of the frames.
            with_map: whether /tf contains the transform from the map to the odometry.
            loses_states: whether a slow subscriber loses old states rather than getting them late.
        """
        self.world: Optional[World] = None
        """The map; None if there is none."""
        self._car = car
        self._wheels_stamp = now
        self._wheel_angles = Wheels(0.0, 0.0, 0.0, 0.0)
        self._front_angles = front_wheel_angles(0.0, car)
        self._odometer = Odometer(car)
        self._announced: Optional[Contact] = None
        self._is_on_map = True
        frames = f"{prefix}odom", f"{prefix}base_footprint"
        self._queue_size = 1 if loses_states else 10_000
        self._publishers: List[Tuple[rospy.Publisher, Convert]] = []
        self.add("car_pose", PoseStamped, lambda state, _: conversions.car_pose_to_msg(state))
        self.add("odom", Odometry, lambda _, odom: conversions.odometry_to_msg(odom, *frames))
        self.add("joint_states", JointState, lambda state, _: self._joint_states(state))
        # Not tf2_ros.TransformBroadcaster: it publishes the same, and needs 7 MB.
        self.add(
            "/tf",
            TFMessage,
            lambda _, odom: conversions.transforms_to_msg(odom.state, *frames, with_map),
        )
        self._collision_pub = rospy.Publisher("~collision", PoseArray, queue_size=10, latch=True)
        self._collision_pub.publish(conversions.poses_to_msg([], now))
        self._driven_path = DrivenPath()
        self._last: Optional[State] = None  # the last one that was published

    def add(self, topic: str, kind: type, convert: Convert) -> None:
        """Publish each state on a topic, too, in the form that `convert` returns."""
        publisher = rospy.Publisher(topic, kind, queue_size=self._queue_size, tcp_nodelay=True)
        self._publishers.append((publisher, convert))

    def publish(self, states: List[State]) -> None:
        """Publish states on every topic that has a subscriber."""
        for _ in self.publish_each(states):
            pass

    def publish_each(self, states: List[State]) -> Iterator[int]:
        """Publish states on each topic that has a subscriber; yield its number of connections."""
        pairs = [(state, self._odometer.read(state)) for state in states]
        for publisher, convert in self._publishers:
            if publisher.get_num_connections():
                messages = [convert(state, measured) for state, measured in pairs]
                rospy_fixes.publish_together(publisher, messages)
                yield publisher.get_num_connections()
        for state in states:
            self._draw(state)
            self._last = state
            self._announce_contact(state)

    def count_connections(self) -> int:
        """Return the number of connections to which each state is written."""
        return sum(publisher.get_num_connections() for publisher, _ in self._publishers)

    def _joint_states(self, state: State) -> JointState:
        """Return the joint states; the wheels turn at their present rate since the last message."""
        seconds = (state.stamp - self._wheels_stamp) / NANOSECONDS
        self._wheels_stamp = state.stamp
        rates = wheel_rates(state, self._car)
        angles = (a + rate * seconds for a, rate in zip(self._wheel_angles, rates))
        self._wheel_angles = Wheels(*angles)
        before, self._front_angles = (
            self._front_angles,
            front_wheel_angles(state.steering_angle, self._car),
        )
        changes = (a - b for a, b in zip(self._front_angles, before))
        steering_rates = [change / seconds if seconds > 0.0 else 0.0 for change in changes]
        return conversions.joint_states_to_msg(state, self._wheel_angles, steering_rates, self._car)

    def _draw(self, state: State) -> None:
        """Extend the driven path; it begins anew when the car is placed."""
        last = self._last
        is_placed = (
            last is None
            or state.map_from_odom != last.map_from_odom
            or state.drive_commands < last.drive_commands
        )
        self._driven_path.add(state, is_placed)

    def announce(self, is_ready: Callable[[], bool]) -> None:
        """Log the pose and what to type, as soon as poses are published and the car is ready."""

        def wait_and_log() -> None:
            while self._last is None or not is_ready():
                if rospy.is_shutdown():
                    return
                time.sleep(READY_POLL_PERIOD)
            car = rospy.get_namespace().strip("/")
            rospy.loginfo(
                "ready: the car is at %s. To drive a plan, type in another terminal: %s",
                self._last.pose,
                as_typed(drive_command(car)),
            )

        threading.Thread(target=wait_and_log, daemon=True).start()

    def _announce_contact(self, state: State) -> None:
        """Publish a changed collision; log once if the car hit a wall or left the map."""
        if state.collision != self._announced:
            self._announced = contact = state.collision
            poses, stamp = ([contact.pose], contact.stamp) if contact else ([], state.stamp)
            self._collision_pub.publish(conversions.poses_to_msg(poses, stamp))
            if contact:
                rospy.logwarn(
                    f"the car hit a wall and stopped at {contact.pose}; drive it away from the "
                    "wall, or place it elsewhere"
                )
        if self.world is None:
            return
        is_on_map = on_map(*self.world, state.pose)
        if self._is_on_map and not is_on_map:
            rospy.logwarn(f"the car left the map at {state.pose}; there are no walls outside")
        self._is_on_map = is_on_map


class DrivenPath:
    """The publisher of the path that the car has driven since it was placed: ``driven_path``.

    A thread publishes the path, latched, when it has changed. Its rate is limited in wall-clock
    time, because the path is published as a whole, and simulated time may run fast.
    """

    def __init__(self) -> None:
        self._poses: Deque[PoseStamped] = deque(maxlen=_DRAWN_POSES)
        self._last: Optional[Pose] = None
        self._lock = threading.Lock()
        self._has_changed = threading.Event()
        self._publisher = rospy.Publisher("driven_path", Path, queue_size=1, latch=True)
        threading.Thread(target=self._publish, daemon=True).start()

    def add(self, state: State, is_placed: bool) -> None:
        """Extend the path to a state, or begin a new path there if the car has been placed."""
        if not is_placed and self._last and state.pose.distance_to(self._last) < _DRAWN_STEP:
            return
        self._last = state.pose
        with self._lock:
            if is_placed:
                self._poses.clear()
            self._poses.append(conversions.car_pose_to_msg(state))
        self._has_changed.set()

    def _publish(self) -> None:
        """Publish each change, in a thread."""
        with suppress(rospy.ROSException):  # the topic is closed in a shutdown
            while not rospy.is_shutdown():
                if self._has_changed.wait(SHUTDOWN_POLL_PERIOD):
                    self._has_changed.clear()
                    with self._lock:
                        poses = list(self._poses)
                    self._publisher.publish(Path(poses[-1].header, poses))
                    time.sleep(_DRAWN_PERIOD)
