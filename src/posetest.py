#!/usr/bin/python3
"""Test node: check that something ends at a pose, or passes it. For .test files of any package.

Parameters, all private:
    topic: of geometry_msgs/PoseStamped, PoseWithCovarianceStamped or nav_msgs/Odometry; or
    frame, child_frame: of a transform: the pose of child_frame in frame
    x, y: the expected position [m]
    theta: the expected heading [rad]; if not set, any heading is right
    position_tolerance: [m], default 0.05
    angle_tolerance: [rad], default 0.05
    passes: true: the pose must be reached at least once; false (default): at the end
    test_duration: time from the first pose to the end, by the stamps [s], default 5.0
    wait_time: how long to wait for the first pose [s of wall-clock time], default 20.0
"""

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
from mushr_ros_intro.replay.judge import compare
from mushr_ros_intro.replay.series import Series
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
            self._configure(node.parameters())
        except UserError as error:
            self.fail(str(error))

    def _configure(self, parameters: Parameters) -> None:
        """Read the parameters.

        Raises:
            UserError: a parameter is wrong.
        """
        self._patience = parameters.number("wait_time", 20.0, "s", 0.0, 1e6)
        self._wanted = Pose(
            parameters.number("x", math.nan, "m", -1e6, 1e6),
            parameters.number("y", math.nan, "m", -1e6, 1e6),
            parameters.number("theta", 0.0, "rad", -1e6, 1e6),
        )
        self._position = parameters.number("position_tolerance", 0.05, "m", 0.0, 1e6)
        angle = parameters.number("angle_tolerance", 0.05, "rad", 0.0, 1e6)
        self._angle = angle if rospy.has_param("~theta") else math.pi
        self._passes = parameters.flag("passes", False)
        self._duration = parameters.number("test_duration", 5.0, "s", 0.0, 1e6)
        self._topic = parameters.optional_text("topic")
        if self._topic is None:
            self._frame = parameters.text("frame", expected="a frame, or the parameter ~topic")
            self._child = parameters.text("child_frame", expected="a frame")
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
        self.wait_for(lambda: self._series.entries, self._source, self._patience)
        duration = from_seconds(self._duration)
        self.wait_for(
            lambda: (self._passes and not self._fault())
            or self._series.covers(duration, ros_time.now()),
            f"{self._duration:g} s to pass on the clock",
            self._patience + 10.0 * self._duration,
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


if __name__ == "__main__":
    node.init_node("posetest")
    rostest.rosrun("mushr_ros_intro", "posetest", PoseTest)
