#!/usr/bin/python3
"""Test node: check odometry against itself, TF and a pose. For .test files of any package.

The pose of the odometry must move as its twist says, without jumps. TF must have the same pose. If
there is a pose topic, TF must agree with it as well.

Parameters, all private:
    odom_topic: of nav_msgs/Odometry, default odom
    pose_topic: of geometry_msgs/PoseStamped, the pose of the odometry's child frame; if not set, no
        pose is compared with TF
    tf: whether TF has the odometry's frames, default true
    position_tolerance: [m], default 1e-6
    angle_tolerance: [rad], default 1e-6
    max_gap: odometry messages further apart than this are not compared [s], default 0.1
    test_duration: how long to listen from the first message on, by the stamps [s], default 5.0
    wait_time: how long to wait for the first message of each topic [s of wall-clock time], default
        20.0
"""

from typing import List, Tuple

import rospy
import tf2_ros
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.grading.checks import Motion, Series, odometry_faults, pose_fault
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros.conversions import MessageError, pose_from_msg, time_from
from mushr_ros_intro.ros.node_test_case import NodeTestCase, main
from mushr_ros_intro.sim.stamps import from_seconds


class OdomTest(NodeTestCase):
    """The test node."""

    def configure(self, parameters: Parameters) -> None:
        """Read the parameters, and subscribe."""
        self._odom_topic = rospy.resolve_name(parameters.text("odom_topic", "odom"))
        pose_topic = parameters.optional_text("pose_topic")
        self._pose_topic = pose_topic and rospy.resolve_name(pose_topic)
        self._has_tf = parameters.flag("tf", True)
        if self._pose_topic and not self._has_tf:
            raise parameters.error("tf", "true, because the pose topic is compared with TF")
        self._position = parameters.number("position_tolerance", 1e-6, "m", 0.0, 1e6)
        self._angle = parameters.number("angle_tolerance", 1e-6, "rad", 0.0, 1e6)
        self._max_gap = from_seconds(parameters.number("max_gap", 0.1, "s", 0.0, 1e6))
        self._duration = parameters.number("test_duration", 5.0, "s", 0.0, 1e6)

        self._motions, self._poses = Series(), Series()
        """Motions, and poses in their frame."""
        self._frames: List[Tuple[str, str]] = []
        """The odometry's frame and child frame; several if they change."""
        self._pose_frame = ""
        self._buffer = tf2_ros.Buffer(rospy.Duration.from_sec(2.0 * self._duration + 10.0))
        self.addCleanup(tf2_ros.TransformListener(self._buffer).unregister)
        self.subscribe(self._odom_topic, Odometry, self._take_odometry)
        if self._pose_topic:
            self.subscribe(self._pose_topic, PoseStamped, self._take_pose)

    def test_odometry(self) -> None:
        """Twist, odometry, TF and pose agree."""
        self._wait()
        motions = [motion for _, motion in self._motions.entries]
        faults = odometry_faults(motions, self._max_gap, self._position, self._angle)
        if len(self._frames) > 1:
            faults.append(f"the odometry has several frames: {self._frames}; expected one pair")
        if self._has_tf:
            frame, child = self._frames[0]
            odometry = [(motion.stamp, motion.pose) for motion in motions]
            faults += self._tf_faults("the odometry", frame, child, odometry)
            if self._pose_topic:
                poses = self._poses.entries
                faults += self._tf_faults("the pose topic", self._pose_frame, child, poses)
        self.fail_with(faults)

    def _wait(self) -> None:
        """Wait for all messages that are compared."""
        self.wait_for(lambda: self._motions.entries, f"odometry on {self._odom_topic}")
        if self._pose_topic:
            self.wait_for(lambda: self._poses.entries, f"a pose on {self._pose_topic}")
        if self._has_tf:
            frame, child = self._frames[0]
            self.wait_for(
                lambda: self._buffer.can_transform(frame, child, rospy.Time(0)),
                f"a transform from '{frame}' to '{child}'",
            )
        self.wait_for_series(self._motions, self._duration)

    def _take_odometry(self, msg: Odometry) -> None:
        """Add the motion of an odometry message."""
        frames = (msg.header.frame_id, msg.child_frame_id)
        if frames not in self._frames:
            self._frames.append(frames)
        twist = msg.twist.twist
        stamp = msg.header.stamp.to_nsec()
        try:
            pose = pose_from_msg(msg.pose.pose)
        except MessageError as error:
            self.error = f"odometry on {self._odom_topic}: {error}"
            return
        motion = Motion(stamp, pose, twist.linear.x, twist.linear.y, twist.angular.z)
        self._motions.add(stamp, motion)

    def _take_pose(self, msg: PoseStamped) -> None:
        """Add the pose of a message."""
        self._pose_frame = msg.header.frame_id
        try:
            self._poses.add(msg.header.stamp.to_nsec(), pose_from_msg(msg.pose))
        except MessageError as error:
            self.error = f"a pose on {self._pose_topic}: {error}"

    def _tf_faults(
        self, what: str, frame: str, child: str, poses: List[Tuple[int, Pose]]
    ) -> List[str]:
        """Return where TF differs from `poses`; TF may lack up to half of them."""
        faults, found = [], 0
        for stamp, pose in poses:
            try:
                transform = self._buffer.lookup_transform(frame, child, time_from(stamp)).transform
                in_tf = pose_from_msg(PoseMsg(transform.translation, transform.rotation))
            except (tf2_ros.TransformException, MessageError) as error:
                reason = str(error)
                continue
            found += 1
            fault = pose_fault(in_tf, pose, self._position, self._angle)
            if fault:
                faults.append(f"TF differs from {what}: {fault}")
        if found < len(poses) / 2:
            faults.append(
                f"TF has {found} of {len(poses)} poses of '{child}' in '{frame}'; expected at "
                f"least half of them: {reason}"
            )
        return faults


if __name__ == "__main__":
    main("odomtest", OdomTest)
