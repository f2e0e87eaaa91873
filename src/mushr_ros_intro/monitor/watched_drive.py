"""One drive while it is watched: its node, its progress, and its end."""

import time
from typing import Iterable, Optional

import rospy

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.monitor.car_watch import CarWatch
from mushr_ros_intro.monitor.drive import Drive, Expectation, PlannedDrive, Report, shown
from mushr_ros_intro.monitor.senders import Sender
from mushr_ros_intro.monitor.verdict import (
    POSE_TOLERANCE,
    TOLERANCE,
    Verdict,
    settled,
    verdict,
)
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.stamps import (
    COMMAND_PERIOD,
    NANOSECONDS,
    SETTLING,
    STAMP_TOLERANCE,
    from_seconds,
)

SILENCE = 1.5
"""A drive has ended if no command has moved the car for this time [s].

A command may come up to a second late, for example because its node was suspended.
"""

REPORT_TIMEOUT = 10.0
"""Longest wait for the car's report after the plan, or for its clock [s of wall-clock time]."""

LOG_PERIOD = 0.7
"""Minimum time between two progress lines [s of wall-clock time]."""


class WatchedDrive:
    """A drive, from its first command on.

    Args:
        first: the first command that moves the car.
        car: its reports; the newest one may be older than the command, or newer.
    """

    def __init__(self, first: Command, car: CarWatch) -> None:
        self.drive = Drive(first, car.before(first.stamp))
        self.is_identified = False
        """Whether the monitor has looked for the node of the drive."""
        self.sender: Optional[Sender] = None
        """The node of the drive; None if it is not known."""
        self.why_not = ""
        """Why the drive is not judged."""
        self.planned: Optional[PlannedDrive] = None
        self._car = car
        self.began = self._arrival = time.monotonic()
        self._next_line = 0
        self._next_log = 0.0

    @property
    def name(self) -> str:
        """The name of the node of the drive, for messages."""
        return self.sender.name if self.sender else "an unknown node"

    def identified(self, expected: Optional[Expectation]) -> None:
        """Note that the monitor has looked for the node and its plan, and what is expected."""
        self.is_identified = True
        if expected:
            self.planned = PlannedDrive(expected, self.drive)
            self._log_progress(self.drive.newest)

    def note_car(self, change: str) -> None:
        """Note and log what has happened to the car."""
        self.drive.lost = self.drive.lost or self.position()
        rospy.logwarn("%s: %s", self.position(), change)

    def note_others(self, senders: Iterable[Sender]) -> None:
        """Note other nodes that publish on the topic of the node of the drive."""
        for each in senders:
            if self.sender and each.topic == self.sender.topic:
                self.note_other(each.name)

    def note_other(self, name: str) -> None:
        """Note and log another node or input of the mux whose commands the car gets, or may get."""
        if name not in (self.name, *self.drive.others):
            self.drive.others.add(name)
            rospy.logwarn("%s also publishes commands. The car gets those of both", name)

    def note_wall(self, contact: Report) -> None:
        """Note and log a contact with a wall."""
        if contact.stamp >= self.drive.first:
            self.drive.wall = contact
            rospy.logwarn("the car stopped at a wall at %s", contact.pose)

    def is_next(self, command: Command) -> bool:
        """Return whether a command belongs to the next drive."""
        is_over = self.planned is not None and self.planned.is_complete
        moves = bool(command.speed or command.steering_angle)
        return is_over and moves and command.stamp > self.planned.end  # type: ignore

    def continues(self, command: Command) -> bool:
        """Return whether a command moves the car after it has stood longer than in the plan."""
        stop, pause = self.drive.stop, self.planned.longest_stop if self.planned else 0
        moves = bool(command.speed or command.steering_angle)
        return moves and stop is not None and command.stamp > stop + pause + 3 * COMMAND_PERIOD

    def add(self, command: Command) -> None:
        """Add a command, which may be a stop."""
        self.drive.add(command)
        if command.speed or command.steering_angle or self.drive.stop == command.stamp:
            self._arrival = time.monotonic()
        self._log_progress(command.stamp)

    def begins_again(self, report: Report) -> bool:
        """Add a report. Return whether it shows that the node has placed the car for a next lap."""
        was_placed = self.drive.placed
        self.drive.report(report)
        if not self.planned or was_placed or self.drive.placed is not report:
            return False
        is_start = report.pose.is_close_to(self.planned.plan.start, TOLERANCE)
        return is_start and self.planned.reaches_end

    def position(self) -> str:
        """Return where the drive is, such as "line 4 of 23"; with its time if it has no plan."""
        if self.planned:
            return self.planned.position(ros_time.now())
        return f"{(ros_time.now() - self.drive.first) / NANOSECONDS:.1f} s after the first command"

    def ended(self) -> Optional[Verdict]:
        """Return the verdict if the drive has ended, else None."""
        if self.planned and self.planned.is_complete:
            report = settled(self.planned)
            is_settled = report or not self.planned.expected.is_placed or not self._car.last
            limit = REPORT_TIMEOUT + self.planned.braking / NANOSECONDS + 1.0
            latest = self.planned.rest + SETTLING + STAMP_TOLERANCE
            if is_settled or self._has_passed(limit, latest):
                return self._judge(report)
        elif self._is_silent():
            return self._judge(None)
        return None

    def overtaken(self) -> Optional[Verdict]:
        """Return the verdict when the next drive begins; None if the car has not come to rest."""
        if not self.planned or not self.planned.is_complete:
            return self._judge(None)
        for report in self.drive.reports:
            is_there = report.pose.is_close_to(self.planned.expected.pose, POSE_TOLERANCE)
            if report.stamp >= self.planned.rest and is_there:
                return self._judge(report)
        return None

    def _is_silent(self) -> bool:
        pause = self.planned.longest_stop if self.planned else 0
        allowed = SILENCE + pause / NANOSECONDS
        return self._has_passed(allowed, self.drive.newest + from_seconds(allowed))

    def _has_passed(self, seconds: float, instant: int) -> bool:
        """Return whether a time since the newest command, and an instant [ns], have passed."""
        if time.monotonic() < self._arrival + seconds:
            return False
        if ros_time.now() > instant:
            return True
        lost = self._car.lost_since  # then simulated time stands still
        return lost is not None and time.monotonic() > lost + REPORT_TIMEOUT

    def _judge(self, report: Optional[Report]) -> Verdict:
        last = self._car.last
        if self.planned:
            return verdict(self.name, self.planned, report, last is not None)
        where = f"; the car stopped at {last.pose}" if last else ""
        return Verdict(
            False, [f"the drive of {self.name} has ended{where}. It is not judged: {self.why_not}"]
        )

    def _log_progress(self, instant: int) -> None:
        """Log the row that is driven at an instant [ns], at most once per second."""
        if not self.planned or self.drive.stop is not None:
            return
        driven = self.planned.time(instant)
        if driven < self._next_line or time.monotonic() < self._next_log:
            return
        self._next_line = (driven // NANOSECONDS + 1) * NANOSECONDS
        self._next_log = time.monotonic() + LOG_PERIOD
        left = (self.planned.plan.duration - driven) / NANOSECONDS
        command = shown(self.drive.runs[-1])
        rospy.loginfo("%s: %s; %.2f s left", self.planned.position(instant), command, left)
