"""Watch whether a car reports its pose."""

import time
from collections import deque
from typing import Deque, List, Optional

from geometry_msgs.msg import PoseStamped

from mushr_ros_intro.monitor.drive import KEPT, Report
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.ros.connections import is_dead
from mushr_ros_intro.stamps import STAMP_TOLERANCE

MAX_SILENCE = 0.4
"""If no report comes for this time, it is checked whether the car responds [s of wall-clock time].

A simulated car also is silent while its clock is held.
"""


class CarWatch:
    """The reports of a car."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._reports: Deque[Report] = deque(maxlen=KEPT)
        self.lost_since: Optional[float] = None
        """When the car was found to be lost [s, monotonic]; None if it is not."""
        self._arrival = 0.0
        self._sequence = 0
        self._is_new = False

    def report(self, msg: PoseStamped, arrival: int) -> Report:
        """Return the report in a message of the car that arrived at `arrival` [ns].

        Raises:
            conversions.MessageError: the pose is not valid.
        """
        pose = conversions.pose_from_msg(msg.pose)
        self._arrival = time.monotonic()
        # rospy numbers the messages of a publisher.
        self._is_new |= msg.header.seq < self._sequence
        self._sequence = msg.header.seq
        stamp = ros_time.received_stamp(msg.header.stamp.to_nsec(), arrival)
        self._reports.append(Report(stamp, pose))
        return self._reports[-1]

    @property
    def last(self) -> Optional[Report]:
        """The newest report, None if there is none."""
        return self._reports[-1] if self._reports else None

    def before(self, stamp: int) -> List[Report]:
        """Return the reports of the second before `stamp` [ns], at least the newest one if any."""
        older = [each for each in self._reports if each.stamp <= stamp]
        return [each for each in older if each.stamp >= stamp - STAMP_TOLERANCE] or older[-1:]

    def change(self) -> str:
        """Return what has happened to the car since the last call, or an empty text."""
        was_lost, is_lost = self.lost_since is not None, self._is_lost()
        is_new, self._is_new = self._is_new, False
        if is_lost and not was_lost:
            self.lost_since = time.monotonic()
            text = f"the car no longer reports its pose on {self.topic}"
            return f"{text}. Is it still running (rosnode list)?"
        if was_lost and not is_lost:
            self.lost_since = None
            return "the car has been restarted" if is_new else "the car reports its pose again"
        return "the car has been restarted" if is_new else ""

    def _is_lost(self) -> bool:
        """Return whether the reports have stopped, and no node that publishes them responds."""
        if self.last is None or time.monotonic() < self._arrival + MAX_SILENCE:
            return False
        return is_dead(self.topic)
