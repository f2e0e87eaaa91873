"""Find faults in series of messages, for the test nodes.

Stamps and durations are integer nanoseconds; messages for users show them in seconds. A series
without enough data is a fault.
"""

import time
from typing import Any, List, Sequence, Tuple

import numpy as np

from mushr_ros_intro.errors import counted
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.stamps import NANOSECONDS


class Series:
    """The items of a topic with their stamps."""

    _QUIET = 1.0
    """After so long without a message [s of wall-clock time] none is in transit any more."""

    def __init__(self) -> None:
        self.entries: List[Tuple[int, Any]] = []
        """All pairs of stamp [ns] and item, in order of arrival."""
        self._last_arrival = 0.0

    def add(self, stamp: int, item: Any) -> None:
        """Add an item with its stamp [ns]."""
        self.entries.append((stamp, item))
        self._last_arrival = time.monotonic()

    def covers(self, duration: int, now: int) -> bool:
        """Return whether the first `duration` [ns] of the series is complete at `now` [ns].

        This depends on the stamps, because a fast clock can be ahead of messages in transit. Only
        if no message arrives any more it depends on the clock.
        """
        if not self.entries:
            return False
        end = self.entries[0][0] + duration
        is_quiet = time.monotonic() > self._last_arrival + self._QUIET
        return self.entries[-1][0] >= end or (now >= end and is_quiet)


def step_faults(stamps: Sequence[int], period: int, jitter: int) -> List[str]:
    """Return the gaps and backward steps in stamps that should be one `period` apart.

    Args:
        stamps: of the messages in order of arrival [ns].
        period: expected time between two stamps [ns]; a shorter time is no fault.
        jitter: tolerance [ns].
    """
    faults = []
    for number, (earlier, later) in enumerate(zip(stamps, stamps[1:]), 2):
        step = (later - earlier) / NANOSECONDS
        if step < 0.0:
            faults.append(
                f"message {number} is stamped {-step:.6g} s before message {number - 1}; "
                "expected rising stamps"
            )
        elif later - earlier > period + jitter:
            faults.append(
                f"{step:.6g} s between the stamps of messages {number - 1} and {number}; "
                f"expected {period / NANOSECONDS:g} s"
            )
    return faults


def rate_faults(stamps: Sequence[int], duration: int, period: int, jitter: int) -> List[str]:
    """Return what is wrong with the stamps of messages that should arrive at a fixed rate.

    They were recorded for `duration` [ns]. The other arguments are those of `step_faults`.
    """
    faults = step_faults(stamps, period, jitter)
    expected = max(2, duration // period - 2)
    if len(stamps) < expected:
        faults.append(
            f"{counted(len(stamps), 'message')} received in {duration / NANOSECONDS:g} s; "
            f"expected at least {expected}"
        )
    return faults


def plan_faults(stamps: Sequence[int], rows: Sequence[int], period: int, jitter: int) -> List[str]:
    """Return what is wrong with the stamps of commands that should follow the rows of a plan.

    Args:
        stamps: of the commands in order of arrival [ns]. The first one begins the first row; those
            after the last row are ignored.
        rows: durations of the rows [ns]; each row begins with a command.
        period: expected time between the commands of a row [ns].
        jitter: tolerance of this time [ns].
    """
    if not stamps:
        return ["no message received"]
    end = stamps[0] + sum(rows)
    faults = step_faults([stamp for stamp in stamps if stamp <= end], period, jitter)
    for row, (count, duration) in enumerate(zip(_count_by_row(stamps, rows, period), rows), 1):
        expected = -(-duration // period)
        if count != expected:
            faults.append(
                f"row {row} ({duration / NANOSECONDS:g} s): {counted(count, 'message')} received; "
                f"expected {expected}"
            )
    return faults


def _count_by_row(stamps: Sequence[int], rows: Sequence[int], period: int) -> List[int]:
    """Return the number of messages of each row, each assigned to the nearest due time."""
    begins = np.cumsum([0, *rows])
    dues = [np.arange(begin, begin + duration, period) for begin, duration in zip(begins, rows)]
    row_of_due = np.repeat(np.arange(len(rows) + 1), [*map(len, dues), 1])
    instants = np.concatenate([*dues, begins[-1:]])  # the last one is for messages after the plan
    middles = instants[:-1] + np.diff(instants) // 2
    nearest = np.searchsorted(middles, np.array(stamps) - stamps[0], side="right")
    return np.bincount(row_of_due[nearest], minlength=len(rows) + 1)[:-1].tolist()


def compare(pose: Pose, wanted: Pose, position: float, angle: float) -> Tuple[bool, str]:
    """Return whether a pose is the wanted one, and a description of their difference.

    The tolerances are `position` [m] and `angle` [rad].
    """
    distance, turn = pose.distance_to(wanted), pose.angle_to(wanted)
    difference = (
        f"{pose}, {distance:.3g} m and {turn:.3g} rad from the expected {wanted}; "
        f"tolerances {position:.3g} m and {angle:.3g} rad"
    )
    return distance <= position and turn <= angle, difference
