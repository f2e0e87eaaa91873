#!/usr/bin/python3
"""Test node: check that something ends at a pose. For .test files of any package."""

import time
import unittest
from typing import Any, Callable

import roslib.message
import rospy
import rostest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import REQUIRED, Parameters, number, text
from mushr_ros_intro.replay.tolerances import compare
from mushr_ros_intro.ros import node, ros_time
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg
from mushr_ros_intro.stamps import from_seconds

_TYPES = [kind._type for kind in (PoseStamped, PoseWithCovarianceStamped, Odometry)]

QUIET = 1.0
"""Time without a pose after which none is in transit any more [s of wall-clock time]."""

TOLERANCE = "allowed difference from the expected pose"


class PoseTest(unittest.TestCase):
    """The test node.

    Subscribes to the topic ``~topic``.

    Example: ``<test test-name="end" pkg="mushr_ros_intro" type="posetest.py">`` in a .test file
    """

    PARAMETERS = (
        text("topic", REQUIRED, "topic with a pose", "a topic"),
        number("x", REQUIRED, "m", -1e6, 1e6, "expected position"),
        number("y", REQUIRED, "m", -1e6, 1e6, "expected position"),
        number("theta", None, "rad", -1e6, 1e6, "expected heading; by default any is right"),
        number("position_tolerance", 0.05, "m", 0.0, 1e6, TOLERANCE),
        number("angle_tolerance", 0.05, "rad", 0.0, 1e6, TOLERANCE),
        number("test_duration", 5.0, "s", 0.0, 1e6, "from the first pose to the end, by stamps"),
        number("wait_time", 20.0, "s", 0.0, 1e6, "timeout for the first pose, wall-clock time"),
    )

    def setUp(self) -> None:
        """Read the parameters; a wrong one is a failure."""
        self._first = self._last = 0  # the stamps of poses
        self._arrival = 0.0  # of the last pose [s of wall-clock time]
        self._error = ""  # set by a callback to make the test fail
        parameters = Parameters(rospy.get_param("~", {}))
        for message in parameters.unknown(self.PARAMETERS):
            rospy.logwarn("%s", message)
        try:
            values = parameters.read(self.PARAMETERS)
        except UserError as error:
            self.fail(str(error))
        self._wanted = Pose(values["x"], values["y"], values["theta"] or 0.0)
        self._position = values["position_tolerance"]
        self._angle = None if values["theta"] is None else values["angle_tolerance"]
        self._duration, self._wait_time = values["test_duration"], values["wait_time"]
        self._topic = rospy.resolve_name(values["topic"])

    def test_pose(self) -> None:
        """The pose is the expected one at the end."""
        rospy.Subscriber(self._topic, rospy.AnyMsg, self._take, tcp_nodelay=True)
        source = f"a pose on {self._topic}"
        self.wait_for(lambda: self._arrival, source, self._wait_time)
        self.wait_for(
            self._is_complete,
            f"{self._duration:g} s to pass on the clock",
            self._wait_time + 10.0 * self._duration,
        )
        is_right, difference = compare(self._pose, self._wanted, self._position, self._angle)
        if not is_right:
            self.fail(f"after {self._duration:g} s the pose is {difference}")

    def _is_complete(self) -> bool:
        """Return whether the poses of the test's duration have arrived.

        This depends on the stamps, because a fast clock can be ahead of messages in transit. Only
        if no pose arrives any more it depends on the clock.
        """
        end = self._first + from_seconds(self._duration)
        is_quiet = time.monotonic() > self._arrival + QUIET
        return self._last >= end or (ros_time.now() >= end and is_quiet)

    def wait_for(self, condition: Callable[[], Any], what: str, seconds: float) -> None:
        """Fail if a condition is not true within `seconds` of wall-clock time, or on an error."""
        is_met = ros_time.wait_for(lambda: self._error or condition(), seconds)
        if self._error or not is_met:
            self.fail(self._error or f"waited {seconds:g} s for {what}")

    def _take(self, msg: Any) -> None:
        """Add the pose of a message of any supported type; without a stamp it counts as of now."""
        if isinstance(msg, rospy.AnyMsg):  # rospy itself knows the type of /clock
            message_class = roslib.message.get_message_class(msg._connection_header["type"])
            msg = message_class().deserialize(msg._buff)
        if msg._type not in _TYPES:
            expected = ", ".join(_TYPES)
            self._error = f"{self._topic} has the type {msg._type}; expected one of {expected}"
            return
        try:
            self._pose = pose_from_msg(getattr(msg.pose, "pose", msg.pose))
        except MessageError as error:
            self._error = f"a pose on {self._topic}: {error}"
            return
        self._last = msg.header.stamp.to_nsec() or ros_time.now()
        self._first = self._first or self._last
        self._arrival = time.monotonic()


if __name__ == "__main__":
    node.check_arguments(PoseTest, "--gtest_output=", "--text", "--cov")
    node.init_node("posetest")
    rostest.rosrun("mushr_ros_intro", "posetest", PoseTest)
