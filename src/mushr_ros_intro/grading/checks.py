"""Find faults in series of messages, for the test nodes.

Stamps and durations are integer nanoseconds; messages for users show them in seconds. A series
without enough data is a fault.
"""

import math
import threading
import time
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, compose, inverse
from mushr_ros_intro.errors import counted
from mushr_ros_intro.sim.stamps import NANOSECONDS


class Motion(NamedTuple):
    """One odometry message."""

    stamp: int
    """[ns]"""
    pose: Pose
    """Of the child frame in the odometry frame."""
    speed: float
    """Forward, in the child frame [m/s]."""
    lateral_speed: float
    """To the left, in the child frame [m/s]."""
    turn_rate: float
    """Counter-clockwise [rad/s]."""


class Series:
    """The items of a topic with their stamps, in order of arrival; thread-safe."""

    _QUIET = 1.0
    """After so long without a message [s of wall-clock time] none is in transit any more."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: List[Tuple[int, Any]] = []
        self._last_arrival = 0.0

    def add(self, stamp: int, item: Any) -> None:
        """Add an item with its stamp [ns]."""
        with self._lock:
            self._entries.append((stamp, item))
            self._last_arrival = time.monotonic()

    @property
    def entries(self) -> List[Tuple[int, Any]]:
        """All pairs of stamp [ns] and item, in order of arrival."""
        with self._lock:
            return list(self._entries)

    def covers(self, duration: int, now: int) -> bool:
        """Return whether the first `duration` [ns] of the series is complete at `now` [ns].

        This depends on the stamps, because a fast clock can be ahead of messages in transit. Only
        if no message arrives any more it depends on the clock.
        """
        with self._lock:
            if not self._entries:
                return False
            end = self._entries[0][0] + duration
            is_quiet = time.monotonic() > self._last_arrival + self._QUIET
            return self._entries[-1][0] >= end or (now >= end and is_quiet)


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


def odometry_faults(
    motions: Sequence[Motion], max_gap: int, position: float, angle: float
) -> List[str]:
    """Return where the pose of odometry does not move as its twist says.

    Args:
        motions: in the order of their stamps.
        max_gap: messages further apart than this [ns] are not compared.
        position: tolerance [m].
        angle: tolerance [rad].
    """
    pairs = [
        (one, other)
        for one, other in zip(motions, motions[1:])
        if 0 < other.stamp - one.stamp <= max_gap
    ]
    if not pairs:
        received = counted(len(motions), "message")
        gap = f"{max_gap / NANOSECONDS:g} s"
        expected = f"expected at least two with stamps up to {gap} apart"
        return [f"odometry not judged: {received} received; {expected}"]
    faults = (_motion_fault(one, other, position, angle) for one, other in pairs)
    return [fault for fault in faults if fault]


def _motion_fault(one: Motion, other: Motion, position: float, angle: float) -> str:
    """Return how two odometry messages contradict each other; empty if they do not.

    The twist that moves the child frame from one pose to the other must be between those of the two
    messages. It is the logarithm of the motion; see Lynch and Park, "Modern Robotics", section 3.3.
    """
    seconds = (other.stamp - one.stamp) / NANOSECONDS
    moved = compose(inverse(one.pose), other.pose)
    turn = math.remainder(moved.theta, math.tau)
    half = 0.5 * turn
    scale = half / math.tan(half) if half else 1.0
    ahead, left = scale * moved.x + half * moved.y, scale * moved.y - half * moved.x
    # A turn rate that changes on the way also moves the child frame sideways.
    slack = position + abs(ahead) * abs(other.turn_rate - one.turn_rate) * seconds
    for name, unit, change, tolerance, rates in (
        ("to the left", "m", left, slack, (one.lateral_speed, other.lateral_speed)),
        ("ahead", "m", ahead, position, (one.speed, other.speed)),
        ("counter-clockwise", "rad", turn, angle, (one.turn_rate, other.turn_rate)),
    ):
        low, high = sorted(rates)
        if not low * seconds - tolerance <= change <= high * seconds + tolerance:
            twist = f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
            return (
                f"in the {seconds:g} s before {other.stamp / NANOSECONDS:.3f} the pose moves by "
                f"{change:.6g} {unit} {name}, which is {change / seconds:.6g} {unit}/s; "
                f"the twist says {twist} {unit}/s"
            )
    return ""


def pose_fault(pose: Pose, wanted: Pose, position: float, angle: Optional[float]) -> str:
    """Return how a pose differs from the wanted one; empty if it is within the tolerances.

    The tolerances are `position` [m] and `angle` [rad]; without an angle any heading is right.
    """
    distance, turn = pose.distance_to(wanted), pose.angle_to(wanted)
    if distance <= position and (angle is None or turn <= angle):
        return ""
    message = f"the pose {pose} is {distance:.3g} m and {turn:.3g} rad from {wanted}"
    tolerances = f"{position:g} m" if angle is None else f"{position:g} m and {angle:g} rad"
    return f"{message}; tolerance {tolerances}"
