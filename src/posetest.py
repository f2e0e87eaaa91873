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
from typing import Any

import rospy
import tf2_ros
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.replay.checks import compare
from mushr_ros_intro.replay.node_test_case import NodeTestCase, main
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg

_TYPES = [kind._type for kind in (PoseStamped, PoseWithCovarianceStamped, Odometry)]


class PoseTest(NodeTestCase):
    """The test node."""

    def configure(self, parameters: Parameters) -> None:
        """Read the parameters."""
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
            self.listen(self._topic, self._take_message)
        else:
            self._listen_to_tf()
        is_over = lambda: self._passes and not self._fault()  # noqa: E731
        self.wait_for_series(self._source, self._duration, is_over)
        fault = self._fault()
        if fault and self._passes:
            self.fail(f"the pose was not reached in {self._duration:g} s; closest: {fault}")
        if fault:
            self.fail(f"after {self._duration:g} s the pose is {fault}")

    def _fault(self) -> str:
        """Return what is wrong with the last pose, or with the nearest if `passes` is set."""
        poses = [pose for _, pose in self.series.entries]
        faults = {}
        for pose in poses if self._passes else poses[-1:]:
            is_right, faults[pose] = compare(pose, self._wanted, self._position, self._angle)
            if is_right:
                return ""
        return faults[min(faults, key=self._wanted.distance_to)]

    def _take_message(self, msg: Any) -> None:
        """Add the pose of a message of any supported type."""
        if msg._type in _TYPES:
            self._take(msg.header, getattr(msg.pose, "pose", msg.pose))
        else:
            expected = ", ".join(_TYPES)
            self.error = f"{self._topic} has the type {msg._type}; expected one of {expected}"

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
            self.series.add(stamp, pose_from_msg(msg))
        except MessageError as error:
            self.error = f"{self._source}: {error}"


if __name__ == "__main__":
    main("posetest", PoseTest)
