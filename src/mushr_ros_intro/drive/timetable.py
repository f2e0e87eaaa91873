"""Compute the due time of each command of a plan, and wait for it."""

import time
from bisect import bisect_right
from itertools import accumulate
from typing import Iterator

import rospy

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.stamps import (
    COMMAND_PERIOD,
    MAX_LEAD,
    NANOSECONDS,
    STAMP_TOLERANCE,
)

LOG_PERIOD = 0.05
"""Minimum time between two progress lines [s of wall-clock time]; simulated time may run fast."""


class Timetable:
    """The due times of one drive of a plan [ns].

    In simulated time, each command is sent one period before it is due, and the drive begins up to
    0.9 s ahead of the clock. The simulated clock does not pass the newest stamp that is ahead of
    it, so it never passes a command that has not been sent yet. In wall-clock time, commands are
    not sent early.
    """

    def __init__(self, plan: Plan, has_laps: bool = False) -> None:
        self._plan = plan
        self._row_ends = list(accumulate(row.duration for row in plan.rows))
        self._has_laps = has_laps
        self._lap = 0
        is_simulated = ros_time.is_simulated()
        self._lead = COMMAND_PERIOD if is_simulated else 0
        self._begin_lead = MAX_LEAD if is_simulated else 0
        self._next_log = 0.0
        self.start = 0
        """When the first command is due [ns]; 0 before the first drive."""
        self.due = 0
        """When the next row begins [ns]."""
        self.end = 0
        """When the plan ends [ns]; the stamp of the stop."""
        self._newest = 0
        """When the newest command is due [ns]."""

    def begin(self) -> int:
        """Return the stamp for the initial pose [ns]; it is later than the end of the last drive.

        Raises:
            rospy.ROSInterruptException: the node is shut down.
        """
        # Then the car has received the stop of the last drive.
        ros_time.sleep_until(self.end, ros_time.now())
        self._lap += 1
        return max(ros_time.now() + self._begin_lead, self.end + 1)

    def start_after(self, stamp: int) -> None:
        """Make the first command due one period after `stamp` [ns], or now if that is later.

        Raises:
            rospy.ROSInterruptException: the node is shut down.
        """
        # In simulated time, the car's report arrives before the clock reaches the report's stamp.
        ros_time.sleep_until(stamp, ros_time.now())
        self.due = max(stamp + COMMAND_PERIOD, ros_time.now())
        self.end = self.due + self._plan.duration
        self.start = self.due

    def instants(self, row: Row) -> Iterator[int]:
        """Yield the due time of each command of the next row [ns] when it has to be sent.

        Raises:
            UserError: see `wait_until`.
            rospy.ROSInterruptException: the node is shut down.
        """
        begin, self.due = self.due, self.due + row.duration
        next_line = begin
        for due in range(begin, self.due, COMMAND_PERIOD):
            self.wait_until(due)
            self._newest = due
            yield due
            if due >= next_line:
                next_line += NANOSECONDS
                self._log_progress(row, due)

    def position(self, instant: int) -> str:
        """Return the lap and the line of the plan's file at an instant [ns]: "line 4 of 23"."""
        rows = self._plan.rows
        index = bisect_right(self._row_ends, instant - self.start)
        lap = f"lap {self._lap}, " if self._has_laps else ""
        return f"{lap}line {rows[min(index, len(rows) - 1)].line} of {rows[-1].line}"

    def stop_position(self) -> str:
        """Return the position now, or that of the newest command if the node was suspended."""
        return self.position(min(ros_time.now(), self._newest + COMMAND_PERIOD - 1))

    def wait_until(self, due: int) -> None:
        """Sleep until a command that is due at `due` [ns] has to be sent.

        Raises:
            UserError: the clock differs from that instant by more than 1 s, so the rest of the
                plan would be wrong.
            rospy.ROSInterruptException: the node is shut down.
        """
        wake = due - self._lead
        while True:
            now = ros_time.now()
            early = wake - now
            if abs(early) > STAMP_TOLERANCE:
                seconds = abs(early) / NANOSECONDS
                when = f"is due in {seconds:.1f} s" if early > 0 else f"was due {seconds:.1f} s ago"
                raise UserError(
                    f"the next command {when}; expected at most 1 s. Either the clock was set, or "
                    "this machine or node was suspended. The drive ends"
                )
            if early <= 0:
                return
            ros_time.sleep_until(wake, now)  # returns early if the clock is set back

    def _log_progress(self, row: Row, due: int) -> None:
        if time.monotonic() < self._next_log:
            return
        self._next_log = time.monotonic() + LOG_PERIOD
        left = (self.end - due) / NANOSECONDS
        command = f"{row.speed:g} m/s, {row.steering_angle:g} rad"
        rospy.loginfo(f"{self.position(due)}: {command}; {left:.2f} s left")
