#!/usr/bin/python3
"""Simulate the car: a kinematic bicycle that obeys commands and reports where it is."""

import sys
import threading
from typing import Callable

import rospy
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from mushr_ros_intro import conversions
from mushr_ros_intro.bicycle import Pose
from mushr_ros_intro.car import Car, Event, History, State, at_rest
from mushr_ros_intro.parameters import ParameterError, number
from mushr_ros_intro.plan import MAX_COORDINATE
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE, effective_stamp, from_seconds


class CarSim:
    """The simulated car as a node.

    Topics, relative to the car's namespace: subscribes to ``initialpose`` and
    ``mux/ackermann_cmd_mux/output``; publishes ``car_pose``, ``odom``, ``joint_states`` and /tf.
    """

    def __init__(self) -> None:
        def parameter(name: str, default: float, unit: str, least: float, most: float) -> float:
            value = number(f"~{name}", rospy.get_param(f"~{name}", default), unit, least, most)
            rospy.loginfo("%s: %g %s", name, value, unit)
            return value

        self._car = Car(
            wheelbase=parameter("wheelbase", Car().wheelbase, "m", 0.01, 100.0),
            track=parameter("track", Car().track, "m", 0.01, 100.0),
            wheel_radius=parameter("wheel_radius", Car().wheel_radius, "m", 0.001, 10.0),
            command_timeout=from_seconds(
                parameter("command_timeout", Car().command_timeout / NANOSECONDS, "s", 0.001, 10.0)
            ),
        )
        self._rate = parameter("pose_rate", 50.0, "Hz", 0.1, 1000.0)
        start = Pose(
            parameter("x", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE),
            parameter("y", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE),
            parameter("theta", 0.0, "rad", -1e3, 1e3),
        )
        prefix = rospy.get_namespace().strip("/")
        self._odom_frame = f"{prefix}/odom".lstrip("/")
        self._base_frame = f"{prefix}/base_footprint".lstrip("/")

        self._lock = threading.Lock()
        self._now = rospy.get_rostime().to_nsec()
        self._history = History(self._car, at_rest(self._now, start))

        # Each stands for the newest state, so a slow subscriber is better off without the old ones.
        self._pose_pub = rospy.Publisher("car_pose", PoseStamped, queue_size=1, tcp_nodelay=True)
        self._odom_pub = rospy.Publisher("odom", Odometry, queue_size=1, tcp_nodelay=True)
        self._joint_pub = rospy.Publisher("joint_states", JointState, queue_size=1)
        self._tf = tf2_ros.TransformBroadcaster()

        # No queue size: every message counts, and the history forgets none that is young enough.
        rospy.Subscriber(
            "initialpose",
            PoseWithCovarianceStamped,
            self._on_message,
            conversions.placement_from_msg,
            tcp_nodelay=True,
        )
        rospy.Subscriber(
            "mux/ackermann_cmd_mux/output",
            AckermannDriveStamped,
            self._on_message,
            conversions.command_from_msg,
            tcp_nodelay=True,
        )

    def run(self) -> None:
        """Report the car's state at the pose rate until the node is shut down."""
        rate = rospy.Rate(self._rate, reset=True)
        while not rospy.is_shutdown():
            with self._lock:
                state = self._history.state_at(self._read_clock())
            self._publish(state)
            rate.sleep()

    def _on_message(self, msg: rospy.Message, read: Callable[[rospy.Message], Event]) -> None:
        """Take a command or a placement, to be applied at its stamp."""
        try:
            event = read(msg)
        except conversions.MessageError as error:
            rospy.logwarn_throttle(1.0, f"ignored a message on {_topic(msg)}: {error}")
            return
        with self._lock:
            now = self._read_clock()
            stamp = effective_stamp(event.stamp, now)
            self._history.add(event._replace(stamp=stamp), now)
        if event.stamp and stamp != event.stamp:
            ahead = (event.stamp - now) / NANOSECONDS
            rospy.logwarn_throttle(
                1.0,
                f"a message on {_topic(msg)} is stamped {ahead:+.1f} s from this machine's "
                f"clock; expected at most {STAMP_TOLERANCE / NANOSECONDS:g} s. It is applied on "
                "arrival; synchronise the clocks of the machines",
            )

    def _read_clock(self) -> int:
        """Return the present [ns], never before an earlier present; needs the lock.

        Where the clock jumped back, the car is put at rest where it is and time starts afresh.
        """
        now = rospy.get_rostime().to_nsec()
        if now < self._now - STAMP_TOLERANCE:
            rospy.logwarn("the clock jumped back; the car stands and starts afresh")
            state = self._history.state_at(self._now)
            rest = state._replace(stamp=now, speed=0.0, expires=now)
            self._history = History(self._car, rest)
            self._now = now
        self._now = max(self._now, now)
        return self._now

    def _publish(self, state: State) -> None:
        """Publish everything that says where the car is, with one stamp."""
        if self._pose_pub.get_num_connections():
            self._pose_pub.publish(conversions.car_pose_to_msg(state))
        if self._odom_pub.get_num_connections():
            self._odom_pub.publish(
                conversions.odometry_to_msg(state, self._car, self._odom_frame, self._base_frame)
            )
        if self._joint_pub.get_num_connections():
            self._joint_pub.publish(conversions.joint_states_to_msg(state, self._car))
        self._tf.sendTransform(
            conversions.transforms_to_msgs(state, self._odom_frame, self._base_frame)
        )


def _topic(msg: rospy.Message) -> str:
    """Return the name of the topic that a received message came on."""
    return msg._connection_header["topic"]


def main() -> int:
    """Run the node; return its exit status."""
    rospy.init_node("car_sim")
    try:
        node = CarSim()
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    try:
        node.run()
    except rospy.ROSInterruptException:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
