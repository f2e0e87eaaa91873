#!/usr/bin/python3
"""Test node: does something end at a pose, or pass it? For .test files of any package.

Parameters, all private:
    topic: of geometry_msgs/PoseStamped, PoseWithCovarianceStamped or nav_msgs/Odometry; or
    frame, child_frame: of a transform, whose pose is that of child_frame in frame
    x, y: where it is to be [m]
    theta: its heading [rad]; any, if not given
    position_tolerance: [m], default 0.05
    angle_tolerance: [rad], default 0.05
    passes: true: it is enough to be there once; default false: it is to be there at the end
    test_duration: when the end is, or for how long to wait for the pose [s by the stamps from the
        first pose on], default 5.0
    wait_time: for how long to wait for the first pose [s of wall-clock time], default 20.0
"""

import unittest
from typing import Any, Callable, Dict, Optional, Tuple

import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Header

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.grading.checks import Series, as_number, pose_fault, wait_for
from mushr_ros_intro.parameters import ParameterError, flag, number, text
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import from_seconds

_KINDS: Dict[str, Tuple[Any, Callable[[Any], PoseMsg]]] = {
    "geometry_msgs/PoseStamped": (PoseStamped, lambda msg: msg.pose),
    "geometry_msgs/PoseWithCovarianceStamped": (
        PoseWithCovarianceStamped,
        lambda msg: msg.pose.pose,
    ),
    "nav_msgs/Odometry": (Odometry, lambda msg: msg.pose.pose),
}


def _number(name: str, default: Optional[float], unit: str, least: float = 0.0) -> float:
    """Return a parameter that is a number."""
    value = as_number(rospy.get_param(f"~{name}", default))
    return number(f"~{name}", value, unit, least, 1e6)


class PoseTest(unittest.TestCase):
    """The test node."""

    def setUp(self) -> None:
        """Read the parameters."""
        self._poses = Series()
        self._broken = ""
        try:
            theta = rospy.get_param("~theta", None)
            self._wanted = Pose(
                _number("x", None, "m", -1e6),
                _number("y", None, "m", -1e6),
                0.0 if theta is None else number("~theta", as_number(theta), "rad", -1e6, 1e6),
            )
            self._position = _number("position_tolerance", 0.05, "m")
            angle = _number("angle_tolerance", 0.05, "rad")
            self._angle = None if theta is None else angle
            self._passes = flag("~passes", rospy.get_param("~passes", False))
            self._duration = _number("test_duration", 5.0, "s")
            self._patience = _number("wait_time", 20.0, "s")
            if rospy.has_param("~topic"):
                self._topic = text("~topic", rospy.get_param("~topic"))
            else:
                self._topic = ""
                self._frame = text("~frame", rospy.get_param("~frame", None))
                self._child = text("~child_frame", rospy.get_param("~child_frame", None))
        except ParameterError as error:
            self.fail(str(error))

    def test_pose(self) -> None:
        """The pose is as it is to be, at the end or once."""
        if self._topic:
            self._subscribe()
            what = f"a pose on {self._topic}"
        else:
            buffer = tf2_ros.Buffer()
            listener = tf2_ros.TransformListener(buffer)
            self.addCleanup(listener.unregister)
            self.addCleanup(rospy.Timer(rospy.Duration(0.01), self._look_up(buffer)).shutdown)
            what = f"a transform from {self._frame} to {self._child}"
        wait_for(lambda: self._poses.entries or self._broken, what, self._patience)
        wait_for(
            lambda: self._poses.covers(from_seconds(self._duration), rospy.get_rostime().to_nsec())
            or self._broken
            or (self._passes and not self._fault()),
            f"{self._duration:g} s to pass on the clock",
            self._patience + 10.0 * self._duration,
        )
        if self._broken:
            self.fail(f"{what}: {self._broken}")
        fault = self._fault()
        if fault and self._passes:
            self.fail(f"in {self._duration:g} s it did not pass; at its nearest {fault}")
        if fault:
            self.fail(f"after {self._duration:g} s {fault}")

    def _fault(self) -> str:
        """Say what is wrong with the last pose, or with the nearest if passing is enough."""
        poses = [pose for _, pose in self._poses.entries]
        pose = poses[-1]
        if self._passes:
            for each in poses:
                if not pose_fault(each, self._wanted, self._position, self._angle):
                    return ""
            pose = min(poses, key=lambda each: abs(complex(*each[:2]) - complex(*self._wanted[:2])))
        return pose_fault(pose, self._wanted, self._position, self._angle)

    def _subscribe(self) -> None:
        """Subscribe to the topic, of whatever kind it is."""
        topic = rospy.resolve_name(self._topic)

        def kind() -> Optional[str]:
            return dict(map(tuple, rospy.get_published_topics())).get(topic)

        found = wait_for(kind, f"a publisher of {topic}", self._patience)
        if found not in _KINDS:
            self.fail(f"{topic} is a {found}; expected one of {', '.join(_KINDS)}")
        message, pose_of = _KINDS[found]
        subscriber = rospy.Subscriber(
            topic, message, lambda msg: self._take(msg.header, pose_of(msg))
        )
        self.addCleanup(subscriber.unregister)

    def _look_up(self, buffer: tf2_ros.Buffer) -> Callable[[Any], None]:
        """Return a callback that takes the latest transform."""

        def take(_: Any) -> None:
            try:
                found = buffer.lookup_transform(self._frame, self._child, rospy.Time(0))
            except tf2_ros.TransformException:
                return
            msg = PoseMsg()
            msg.position = found.transform.translation
            msg.orientation = found.transform.rotation
            self._take(found.header, msg)

        return take

    def _take(self, header: Header, msg: PoseMsg) -> None:
        """Note a pose, which counts as of now if it has no stamp."""
        stamp = header.stamp.to_nsec() or rospy.get_rostime().to_nsec()
        try:
            self._poses.add(stamp, pose_from_msg(msg))
        except MessageError as error:
            self._broken = str(error)


if __name__ == "__main__":
    init_node("posetest")
    rostest.rosrun("mushr_ros_intro", "posetest", PoseTest)
