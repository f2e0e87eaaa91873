"""Follow the pose that a car reports."""

import math
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Deque, NamedTuple, Optional

import rosgraph
import rospy
from geometry_msgs.msg import PoseStamped

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.ros.connections import (
    is_published,
    registered_nodes,
    responds,
    wait_until_connected,
)

POSE_TOLERANCE = 1e-3
"""How far the reported pose may differ from the start pose [m, rad]."""

MAX_SILENCE = 0.4
"""If no report comes for this time, it is checked whether the car responds [s of wall-clock time].

A simulated car also is silent while its clock is held.
"""

_REPOSITION = "/mushr_sim/reposition"
"""The topic on which the simulator of MuSHR's branch noetic is placed."""


class ReportedPose(NamedTuple):
    """The pose in one message of the car."""

    stamp: int
    """[ns]"""
    pose: Pose
    """base_footprint in the map frame."""


class CarPose:
    """The pose that /CAR_NAME/car_pose (geometry_msgs/PoseStamped) reports."""

    def __init__(self, car_name: str) -> None:
        self._lock = threading.Lock()
        self._reports: Deque[ReportedPose] = deque(maxlen=2)
        self._arrival = 0.0
        self._sequence = 0
        self.restarts = 0
        """How often the node that reports the pose has been restarted."""
        # Of the poses that arrive together in lock-step, only the newest one is read: the clock
        # waits at the first report of an initial pose.
        self._subscriber = rospy.Subscriber(
            f"/{car_name}/car_pose", PoseStamped, self._on_pose, queue_size=1, tcp_nodelay=True
        )
        self.topic = self._subscriber.resolved_name

    @property
    def last(self) -> Optional[ReportedPose]:
        """The newest report, None if there is none."""
        with self._lock:
            return self._reports[-1] if self._reports else None

    def stands(self) -> bool:
        """Return whether the newest two reports have the same pose."""
        with self._lock:
            poses = [report.pose for report in self._reports]
        return len(poses) > 1 and poses[-1] == poses[-2]

    def is_lost(self) -> bool:
        """Return whether the reports have stopped, and no node that publishes them responds."""
        with self._lock:
            if not self._reports or time.monotonic() < self._arrival + MAX_SILENCE:
                return False
        try:
            return not any(map(responds, registered_nodes(self.topic, "publishers")))
        except (rosgraph.MasterException, OSError):
            return False  # the next call to the master reports the error

    def wait_until_reported(self, seconds: float) -> None:
        """Wait until the car reports its pose, at most `seconds`; then it has subscribed, too.

        On a busy machine, the mux and click_planner can be ready before the car.
        """
        if wait_until_connected(self._subscriber, "publishers", seconds, minimum=1):
            ros_time.wait_for(lambda: self.last, seconds)

    def wait_until_at(self, pose: Pose, since: int, seconds: float) -> int:
        """Wait until the car reports the start pose.

        Args:
            pose: the start pose in the map frame.
            since: the stamp of the initial pose that was sent [ns].
            seconds: timeout [s of wall-clock time].

        Returns:
            The stamp of such a report [ns], in lock-step of the first one; `since` if no node
            publishes the car's pose.

        Raises:
            UserError: the car does not report the start pose in time.
            rospy.ROSInterruptException: the node is shut down.
        """
        if not self._subscriber.get_num_connections() and not is_published(self.topic):
            rospy.loginfo("no node publishes %s, so the start pose is not checked", self.topic)
            return since

        def find() -> Optional[ReportedPose]:
            last = self.last
            is_there = last and last.stamp >= since and last.pose.is_close_to(pose, POSE_TOLERANCE)
            return last if is_there else None

        report = ros_time.wait_for(find, seconds)
        if report is None:
            last = self.last
            raise UserError(
                f"the car was not at the start pose {pose} within {seconds:g} s; {self.topic} "
                f"reports {last.pose if last else 'nothing'}. {_why_not_at(pose)}"
            )
        return report.stamp

    @conversions.ignore_bad_messages
    def _on_pose(self, msg: PoseStamped) -> None:
        pose = conversions.pose_from_msg(msg.pose)
        stamp = ros_time.received_stamp(msg.header.stamp.to_nsec())
        with self._lock:
            self._arrival = time.monotonic()
            # rospy numbers the messages of a publisher.
            self.restarts += msg.header.seq < self._sequence
            self._sequence = msg.header.seq
            self._reports.append(ReportedPose(stamp, pose))


def _why_not_at(pose: Pose) -> str:
    """Return the likely reason why a car does not report its start pose, with the remedy."""
    names = []
    with suppress(rosgraph.MasterException, OSError):
        # car_sim can be placed on both topics.
        placed = registered_nodes("/initialpose", "subscribers")
        both = {each for each in placed if each.endswith("/car_sim")}
        names = [n for n in registered_nodes(_REPOSITION, "subscribers") if n not in both]
    if not names:
        return (
            "Is the start pose inside a wall, is the clock held, or does another node place or "
            "drive the car?"
        )
    z, w = math.sin(pose.theta / 2.0), math.cos(pose.theta / 2.0)
    return (
        f"The car of {names[0]} is placed on {_REPOSITION} (MuSHR, branch noetic). Type: rostopic "
        f"pub -1 {_REPOSITION} geometry_msgs/PoseStamped '{{pose: {{position: {{x: {pose.x:g}, "
        f"y: {pose.y:g}}}, orientation: {{z: {z:g}, w: {w:g}}}}}}}' and then start path_publisher "
        "again"
    )
