#!/usr/bin/python3
"""Test node: check that something ends at a pose, or passes it. For .test files of any package."""

import math
import unittest
from typing import Any, Callable

import roslib.message
import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.replay.series import Series
from mushr_ros_intro.replay.tolerances import compare
from mushr_ros_intro.ros import node, ros_time
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg
from mushr_ros_intro.stamps import from_seconds

_TYPES = [kind._type for kind in (PoseStamped, PoseWithCovarianceStamped, Odometry)]


class PoseTest(unittest.TestCase):
    """The test node."""

    def setUp(self) -> None:
        """Read the parameters; a wrong one is a failure."""
        self._series = Series()
        self._error = ""  # set by a callback to make the test fail
        try:
            with node.parameters() as parameters:
                self._configure(parameters)
        except UserError as error:
            self.fail(str(error))

    def _configure(self, parameters: Parameters) -> None:
        """Read the parameters.

        Raises:
            UserError: a parameter is wrong.
        """
        number = parameters.number
        self._topic = parameters.optional_text("topic", "topic with a pose, or else a transform:")
        if self._topic is None:
            expected = "a frame, or the parameter ~topic"
            self._frame = parameters.text("frame", None, expected, "parent frame of the transform")
            self._child = parameters.text("child_frame", None, "a frame", "its child frame")
        meaning = "expected position"
        x, y = (number(name, math.nan, "m", -1e6, 1e6, meaning) for name in ("x", "y"))
        meaning = "expected heading; by default any heading is right"
        theta = parameters.optional_number("theta", "rad", -1e6, 1e6, meaning)
        self._wanted = Pose(x, y, theta or 0.0)
        meaning = "allowed difference from the expected pose"
        self._position = number("position_tolerance", 0.05, "m", 0.0, 1e6, meaning)
        angle = number("angle_tolerance", 0.05, "rad", 0.0, 1e6, meaning)
        self._angle = None if theta is None else angle
        meaning = "whether the pose must be reached once; otherwise at the end"
        self._passes = parameters.flag("passes", False, meaning)
        meaning = "time from the first pose to the end, by the stamps"
        self._duration = number("test_duration", 5.0, "s", 0.0, 1e6, meaning)
        meaning = "timeout for the first pose, in wall-clock time"
        self._wait_time = number("wait_time", 20.0, "s", 0.0, 1e6, meaning)
        if self._topic is None:
            self._source = f"a transform from {self._frame} to {self._child}"
        else:
            self._topic = rospy.resolve_name(self._topic)
            self._source = f"a pose on {self._topic}"

    def test_pose(self) -> None:
        """The pose is the expected one, at the end or once."""
        if self._topic:
            rospy.Subscriber(self._topic, rospy.AnyMsg, self._take_message, tcp_nodelay=True)
        else:
            self._listen_to_tf()
        self.wait_for(lambda: self._series.entries, self._source, self._wait_time)
        duration = from_seconds(self._duration)
        self.wait_for(
            lambda: (self._passes and not self._fault())
            or self._series.covers(duration, ros_time.now()),
            f"{self._duration:g} s to pass on the clock",
            self._wait_time + 10.0 * self._duration,
        )
        fault = self._fault()
        if fault and self._passes:
            self.fail(f"the pose was not reached in {self._duration:g} s; closest: {fault}")
        if fault:
            self.fail(f"after {self._duration:g} s the pose is {fault}")

    def wait_for(self, condition: Callable[[], Any], what: str, seconds: float) -> None:
        """Fail if a condition is not true within `seconds` of wall-clock time, or on an error."""
        is_met = ros_time.wait_for(lambda: self._error or condition(), seconds)
        if self._error or not is_met:
            self.fail(self._error or f"waited {seconds:g} s for {what}")

    def _fault(self) -> str:
        """Return what is wrong with the last pose, or with the nearest if `passes` is set."""
        poses = [pose for _, pose in self._series.entries]
        faults = {}
        for pose in poses if self._passes else poses[-1:]:
            is_right, faults[pose] = compare(pose, self._wanted, self._position, self._angle)
            if is_right:
                return ""
        return faults[min(faults, key=self._wanted.distance_to)]

    def _take_message(self, msg: Any) -> None:
        """Add the pose of a message of any supported type."""
        if isinstance(msg, rospy.AnyMsg):  # rospy itself knows the type of /clock
            message_class = roslib.message.get_message_class(msg._connection_header["type"])
            msg = message_class().deserialize(msg._buff)
        if msg._type in _TYPES:
            self._take(msg.header, getattr(msg.pose, "pose", msg.pose))
        else:
            expected = ", ".join(_TYPES)
            self._error = f"{self._topic} has the type {msg._type}; expected one of {expected}"

    def _listen_to_tf(self) -> None:
        """Collect the poses of the transform."""
        buffer = tf2_ros.Buffer()
        self.addCleanup(tf2_ros.TransformListener(buffer).unregister)

        def take(_: Any) -> None:
            try:
                found = buffer.lookup_transform(self._frame, self._child, rospy.Time(0))
            except tf2_ros.TransformException:
                return
            transform = found.transform
            self._take(found.header, PoseMsg(transform.translation, transform.rotation))

        self.addCleanup(rospy.Timer(rospy.Duration(0.01), take).shutdown)

    def _take(self, header: Header, msg: PoseMsg) -> None:
        """Add a pose; without a stamp it counts as of now."""
        stamp = header.stamp.to_nsec() or rospy.get_rostime().to_nsec()
        try:
            self._series.add(stamp, pose_from_msg(msg))
        except MessageError as error:
            self._error = f"{self._source}: {error}"


def read_parameters() -> None:
    """Read the parameters of the test node.

    Subscribes to the topic ``~topic``, or else looks up a transform.

    Example: ``<test test-name="end" pkg="mushr_ros_intro" type="posetest.py">`` in a .test file
    """
    PoseTest().setUp()


if __name__ == "__main__":
    node.check_arguments(read_parameters, "--gtest_output=", "--text", "--cov")
    node.init_node("posetest")
    rostest.rosrun("mushr_ros_intro", "posetest", PoseTest)
