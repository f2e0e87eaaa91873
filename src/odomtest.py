#!/usr/bin/python3
"""Test node: is odometry true to itself, to TF and to the pose? For .test files of any package.

The pose is to move as its twist says, in the child frame and without a jump; TF is to say the same
as the odometry; and where there is a pose topic, TF is to say the same as that.

Parameters, all private:
    odom_topic: of nav_msgs/Odometry, default odom
    pose_topic: of geometry_msgs/PoseStamped, for the odometry's child frame; none, if not given
    tf: whether TF has the odometry's frames, default true
    position_tolerance: [m], default 1e-6
    angle_tolerance: [rad], default 1e-6
    max_gap: odometry messages further apart are not compared with one another [s], default 0.1
    test_duration: for how long to listen [s by the stamps from the first message on], default 5.0
    wait_time: for how long to wait for the first message of each [s of wall-clock time], default
        20.0
"""

import unittest
from typing import Any, List, Tuple

import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.grading.checks import (
    Motion,
    Series,
    as_number,
    odometry_faults,
    pose_fault,
    wait_for,
)
from mushr_ros_intro.parameters import ParameterError, flag, number, text
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg, time_from
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import from_seconds

_SHOWN = 5
"""How many faults are said."""


class OdomTest(unittest.TestCase):
    """The test node."""

    def setUp(self) -> None:
        """Read the parameters, and listen."""
        self._odometry, self._poses = Series(), Series()

        def parameter(name: str, default: float, unit: str) -> float:
            value = as_number(rospy.get_param(f"~{name}", default))
            return number(f"~{name}", value, unit, 0.0, 1e6)

        try:
            odom_topic = text("~odom_topic", rospy.get_param("~odom_topic", "odom"))
            self._pose_topic = rospy.get_param("~pose_topic", "")
            self._has_tf = flag("~tf", rospy.get_param("~tf", True))
            self._position = parameter("position_tolerance", 1e-6, "m")
            self._angle = parameter("angle_tolerance", 1e-6, "rad")
            self._gap = from_seconds(parameter("max_gap", 0.1, "s"))
            self._duration = parameter("test_duration", 5.0, "s")
            self._patience = parameter("wait_time", 20.0, "s")
        except ParameterError as error:
            self.fail(str(error))
        self._odom_topic = rospy.resolve_name(odom_topic)
        self._buffer = tf2_ros.Buffer(rospy.Duration.from_sec(2.0 * self._duration + 10.0))
        listener = tf2_ros.TransformListener(self._buffer)
        self.addCleanup(listener.unregister)
        self._listen(odom_topic, Odometry, self._odometry)
        if self._pose_topic:
            self._listen(text("~pose_topic", self._pose_topic), PoseStamped, self._poses)

    def _listen(self, topic: str, kind: Any, messages: Series) -> None:
        """Collect the messages of a topic."""
        subscriber = rospy.Subscriber(
            topic, kind, lambda msg: messages.add(msg.header.stamp.to_nsec(), msg), tcp_nodelay=True
        )
        self.addCleanup(subscriber.unregister)

    def test_odometry(self) -> None:
        """Twist, odometry, TF and pose agree."""
        self._wait()
        try:
            faults = self._faults()
        except MessageError as error:
            self.fail(str(error))
        if faults:
            more = [f"and {len(faults) - _SHOWN} more"] if len(faults) > _SHOWN else []
            self.fail("\n".join([*faults[:_SHOWN], *more]))

    def _faults(self) -> List[str]:
        """Say what does not agree."""
        odometry = [msg for _, msg in self._odometry.entries]
        poses = [msg for _, msg in self._poses.entries]
        motions = [
            Motion(
                msg.header.stamp.to_nsec(),
                pose_from_msg(msg.pose.pose),
                msg.twist.twist.linear.x,
                msg.twist.twist.linear.y,
                msg.twist.twist.angular.z,
            )
            for msg in odometry
        ]
        faults = []
        if len(motions) < 2:
            faults.append("a single odometry message came; expected some")
        faults += odometry_faults(motions, self._gap, self._position, self._angle)
        if self._has_tf:
            frames = {(msg.header.frame_id, msg.child_frame_id) for msg in odometry}
            if len(frames) > 1:
                faults.append(f"the odometry's frames change: {sorted(frames)}")
            frame, child = (odometry[0].header.frame_id, odometry[0].child_frame_id)
            faults += self._tf_faults(
                "the odometry", frame, child, [(each.stamp, each.pose) for each in motions]
            )
            if poses:
                faults += self._tf_faults(
                    "the pose",
                    poses[0].header.frame_id,
                    child,
                    [(msg.header.stamp.to_nsec(), pose_from_msg(msg.pose)) for msg in poses],
                )
        return faults

    def _wait(self) -> None:
        """Wait until all has come that is to be compared."""
        wait_for(lambda: self._odometry.entries, f"odometry on {self._odom_topic}", self._patience)
        if self._pose_topic:
            topic = rospy.resolve_name(self._pose_topic)
            wait_for(lambda: self._poses.entries, f"a pose on {topic}", self._patience)
        first = self._odometry.entries[0][1]
        frames = (first.header.frame_id, first.child_frame_id)
        if self._has_tf:
            wait_for(
                lambda: self._buffer.can_transform(*frames, rospy.Time(0)),
                f"a transform from {frames[0]!r} to {frames[1]!r}",
                self._patience,
            )
        duration = from_seconds(self._duration)
        wait_for(
            lambda: self._odometry.covers(duration, rospy.get_rostime().to_nsec()),
            f"{self._duration:g} s to pass on the clock",
            self._patience + 10.0 * self._duration,
        )

    def _tf_faults(
        self, what: str, frame: str, child: str, poses: List[Tuple[int, Pose]]
    ) -> List[str]:
        """Say where TF says something else than `poses`, of which the ends may be missing."""
        faults, found = [], 0
        for stamp, pose in poses:
            try:
                transform = self._buffer.lookup_transform(frame, child, time_from(stamp)).transform
            except tf2_ros.TransformException as error:
                reason = str(error)
                continue
            found += 1
            msg = PoseMsg()
            msg.position, msg.orientation = transform.translation, transform.rotation
            fault = pose_fault(pose_from_msg(msg), pose, self._position, self._angle)
            if fault:
                faults.append(f"TF says something else than {what}: {fault}")
        if found < len(poses) / 2:
            faults.append(f"TF has {found} of {len(poses)} poses of {child} in {frame}: {reason}")
        return faults


if __name__ == "__main__":
    init_node("odomtest")
    rostest.rosrun("mushr_ros_intro", "odomtest", OdomTest)
