"""Turn a drive into a plan: its commands become rows, a reported pose becomes the start pose.

Every event counts at its stamp, in whatever order the messages arrive, as in the simulated car. A
command is valid for the car's command timeout; after that the car stands until the next one. All
instants are integer nanoseconds.
"""

import bisect
import math
from itertools import takewhile, zip_longest
from typing import List, Optional, Sequence, Tuple

from mushr_ros_intro.car.model import Command, InitialPose
from mushr_ros_intro.car.motion import changes_nothing
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.stamps import effective_stamp

AT_REST = 1e-3
"""A car that moves less than this between two reported poses stands [m]."""


class Recording:
    """The commands of one drive, and the pose at which it begins.

    The drive begins with the first command that is not a plain stop (speed and steering angle
    zero) and before which a pose was reported. The last such pose is the start pose.

    Args:
        command_timeout: how long a command is valid after its stamp [ns].
        tolerance: the largest plausible difference of a stamp from the clock [ns]; see
            `effective_stamp`.
    """

    def __init__(self, command_timeout: int, tolerance: int) -> None:
        self._timeout = command_timeout
        self._tolerance = tolerance
        self._since = 0  # the stamp of the initial pose; older events do not count
        self._initial_pose: Optional[Pose] = None
        self._commands: List[Command] = []  # sorted by stamp
        self._poses: List[Tuple[int, Pose]] = []

    @property
    def begin(self) -> Optional[int]:
        """The stamp of the first command [ns], or None if the drive has not begun."""
        return next((each.stamp for each in self._commands if self._can_begin(each)), None)

    @property
    def is_start_exact(self) -> bool:
        """Whether the car stands at the start pose until the drive begins.

        It does not if it moved between the last two reported poses, except to its initial pose,
        or if there was a command to drive before its pose was reported.
        """
        begin = self.begin
        first = next(filter(_drives, self._commands), None)
        if begin is None or first is None or first.stamp != begin:
            return False
        end = self._count_until(begin)
        earlier, start = self._poses[max(0, end - 2)][1], self._poses[end - 1][1]
        return any(
            start.distance_to(each) <= AT_REST for each in (earlier, self._initial_pose or earlier)
        )

    def add_command(self, command: Command, now: int) -> bool:
        """Insert a command that arrives at `now` [ns], after those with the same stamp.

        Returns:
            False if commands to drive were dropped, because no pose was reported before them.
        """
        stamp = effective_stamp(command.stamp, now, self._tolerance)
        if stamp < self._since:
            return True
        command = command._replace(stamp=stamp, has_stamp=stamp == command.stamp)
        if command.has_stamp:  # see car/history.py
            self._commands = [
                each for each in self._commands if each.has_stamp or each.stamp < stamp
            ]
        place = len(self._commands)
        while place and self._commands[place - 1].stamp > stamp:
            place -= 1
        self._commands.insert(place, command)
        horizon = now - self._tolerance
        unused = list(
            takewhile(lambda c: c.stamp < horizon and not self._can_begin(c), self._commands)
        )
        del self._commands[: len(unused)]
        return not any(map(_drives, unused))

    def add_pose(self, stamp: int, pose: Pose, now: int) -> None:
        """Add a reported pose with its stamp [ns], which arrives at `now` [ns]."""
        stamp = effective_stamp(stamp, now, self._tolerance)
        if stamp < self._since:
            return
        self._poses.append((stamp, pose))
        # Events can still arrive that are older than `now` by the tolerance.
        begin = self.begin
        horizon = now - self._tolerance
        needed = self._count_until(horizon if begin is None else min(begin, horizon))
        del self._poses[: max(0, needed - 2)]

    def place(self, initial_pose: InitialPose, now: int) -> Optional[Plan]:
        """Forget all events before an initial pose, which arrives at `now` [ns].

        Returns:
            The plan of the drive that it ends, or None.
        """
        since = effective_stamp(initial_pose.stamp, now, self._tolerance)
        ended = self.plan(before=since)
        self._since, self._initial_pose = since, initial_pose.pose
        self._commands = [each for each in self._commands if each.stamp >= since]
        self._poses = [each for each in self._poses if each[0] >= since]
        return ended

    def plan(self, before: float = math.inf) -> Optional[Plan]:
        """Return the plan of the commands stamped before an instant [ns]; None if it has no rows.

        Rows at the end in which the car stands are left out.
        """
        begin = self.begin
        if begin is None:
            return None
        commands = [each for each in self._commands if begin <= each.stamp < before]
        rows = rows_from(commands, self._timeout)
        return Plan("", self._poses[self._count_until(begin) - 1][1], rows) if rows else None

    def _can_begin(self, command: Command) -> bool:
        return _drives(command) and self._count_until(command.stamp) > 0

    def _count_until(self, stamp: int) -> int:
        """Return the number of poses at or before an instant [ns]."""
        return bisect.bisect_left(self._poses, (stamp + 1,))


def _drives(command: Command) -> bool:
    """Return whether a command is anything but a plain stop."""
    return command.speed != 0.0 or command.steering_angle != 0.0


def rows_from(commands: Sequence[Command], timeout: int) -> Tuple[Row, ...]:
    """Return the rows of commands that are sorted by stamp and valid for `timeout` [ns] each."""
    rows: List[Row] = []

    def append(speed: float, steering_angle: float, duration: int) -> None:
        if rows and rows[-1][:2] == (speed, steering_angle):
            duration += rows.pop().duration
        if duration:
            rows.append(Row(speed, steering_angle, duration, 0))

    effective: List[Command] = []
    for command in commands:
        if not effective or not changes_nothing(command, effective[-1], timeout):
            effective.append(command)
    for command, following in zip_longest(effective, effective[1:]):
        valid = timeout if following is None else min(timeout, following.stamp - command.stamp)
        append(command.speed, command.steering_angle, valid)
        if following is not None:
            append(0.0, command.steering_angle, following.stamp - command.stamp - valid)
    while rows and rows[-1].speed == 0.0:
        rows.pop()
    return tuple(rows)
