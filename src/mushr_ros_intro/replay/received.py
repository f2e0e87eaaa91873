"""What the car receives from the node under test in a replay."""

import math
from typing import List, Optional

from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.mistakes import INITIAL_POSES
from mushr_ros_intro.replay.recording import Sent
from mushr_ros_intro.replay.replay_car import MUX
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.stamps import effective_stamp

CONTROL = f"{MUX}/input/navigation"
"""The topic of the commands."""


_UNUSABLE = Pose(*3 * [math.nan])


class Received:
    """The commands and the initial poses that the node has sent."""

    def __init__(self, start: Optional[Pose] = None, begin: Optional[int] = None) -> None:
        """Begin without messages.

        Args:
            start: the pose at which a car is placed that already drives; None if it does not.
            begin: when it began to drive [ns].
        """
        self.commands: List[Sent] = []
        """Those on CONTROL in order of arrival."""
        self.start = start
        """The last initial pose before the first command to drive; NaN if it is unusable."""
        self.start_delay = 0
        """If the first initial pose arrives after the first command to drive: its delay [ns]."""
        self.ignored = ""
        """The first message that the car ignored, and the reason; empty if there was none."""
        self.limit = ""
        """The first limit on a rate of change in a command; empty if there was none."""
        self._begin = begin  # the time of the first command to drive
        self._is_ahead = False  # whether the stamp of an initial pose was ahead of its arrival

    def add_initial_pose(self, msg: PoseWithCovarianceStamped, now: int) -> str:
        """Add an initial pose that arrives at a time [ns].

        Return a description if it places the car again; empty if it does not.
        """
        try:
            pose = conversions.initial_pose_from_msg(msg).pose
        except conversions.MessageError as error:
            pose = _UNUSABLE
            self._ignore(INITIAL_POSES, error)
        # A node may send stops first, or its start pose several times; but without this, stops and
        # poses along the path would look like a drive. A pose with a later stamp applies later.
        self._is_ahead |= effective_stamp(msg.header.stamp.to_nsec(), now) > now
        is_late = bool(self.commands) or self._is_ahead
        if self.start and (self._begin is not None or (is_late and pose != self.start)):
            return f"places the car again, at {pose}"
        if self._begin is None:
            self.start = pose
        else:
            self.start_delay = self.start_delay or max(1, now - self._begin)
        return ""

    def add_command(self, msg: AckermannDriveStamped, now: int) -> None:
        """Add a command that arrives at a time [ns]."""
        stamp = msg.header.stamp.to_nsec()
        taken = effective_stamp(stamp, now)
        sent = Sent(taken, taken == stamp, msg.drive.speed, msg.drive.steering_angle, now, stamp)
        self.commands.append(sent)
        if self._begin is None and sent.speed != 0.0:
            self._begin = now
        try:
            command = conversions.command_from_msg(msg)
        except conversions.MessageError as error:
            self._ignore(CONTROL, error)
            return
        for name, unit in (("acceleration", "m/s^2"), ("steering_angle_velocity", "rad/s")):
            if value := getattr(command, name):
                self.limit = self.limit or f"drive.{name} of a command is {value:g} {unit}"

    def _ignore(self, topic: str, error: conversions.MessageError) -> None:
        self.ignored = self.ignored or f"a message on {topic}: {error}"
