"""Find what is wrong with a series of messages: what the test nodes ask of poses and stamps.

Stamps are integer nanoseconds, and differences between them are said in seconds.
"""

import bisect
import math
import threading
import time
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.car.bicycle import Pose, compose, drive_arc, inverse
from mushr_ros_intro.sim.stamps import NANOSECONDS


class Motion(NamedTuple):
    """One odometry message."""

    stamp: int
    """[ns]"""
    pose: Pose
    """Of the child frame in the odometry frame."""
    speed: float
    """Forward, in the child frame [m/s]."""
    side_speed: float
    """To the left, in the child frame [m/s]."""
    turn_rate: float
    """Counter-clockwise [rad/s]."""


def as_number(value: Any) -> Any:
    """Return the number that text stands for: YAML takes 1e-6 for text. Anything else stays."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def apart(one: Pose, other: Pose) -> float:
    """Return how far two poses are apart [m]."""
    return math.hypot(one.x - other.x, one.y - other.y)


def turned(one: Pose, other: Pose) -> float:
    """Return the angle between two headings [rad], not negative."""
    return abs(math.remainder(one.theta - other.theta, math.tau))


def shown(pose: Pose) -> str:
    """Return a pose as text."""
    theta = math.remainder(pose.theta, math.tau)
    return f"({pose.x:.4f} m, {pose.y:.4f} m, {theta:.4f} rad)"


def wait_for(condition: Callable[[], Any], what: str, patience: float) -> Any:
    """Return the first true value of `condition`.

    Args:
        condition: asked again and again.
        what: is waited for.
        patience: how long [s of wall-clock time].

    Raises:
        AssertionError: it was waited for in vain.
    """
    deadline = time.monotonic() + patience
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {patience:g} s for {what}")
        time.sleep(0.01)


class Series:
    """What came on a topic, with its stamps; a thread may add while another looks."""

    _QUIET = 1.0
    """After so long without a message [s of wall-clock time] none is on its way any more."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._lock = threading.Lock()
        self._entries: List[Tuple[int, Any]] = []
        self._heard = 0.0

    def add(self, stamp: int, item: Any) -> None:
        """Add what is stamped `stamp` [ns]."""
        with self._lock:
            self._entries.append((stamp, item))
            self._heard = time.monotonic()

    @property
    def entries(self) -> List[Tuple[int, Any]]:
        """All that came, as (stamp [ns], item), in the order in which it came."""
        with self._lock:
            return list(self._entries)

    def covers(self, duration: int, now: int) -> bool:
        """Say whether nothing more will come from the first `duration` [ns].

        Judged by the stamps, because the clock, which is at `now` [ns], may run fast and ahead of
        messages that are on their way; by the clock only where they have ceased to come.
        """
        with self._lock:
            if not self._entries:
                return False
            end = self._entries[0][0] + duration
            is_quiet = time.monotonic() > self._heard + self._QUIET
            return self._entries[-1][0] >= end or (now >= end and is_quiet)


def rate_faults(
    stamps: Sequence[int], durations: Sequence[int], period: int, jitter: int
) -> List[str]:
    """Say what is wrong with the stamps of messages that are to come evenly, row by row.

    Args:
        stamps: of the messages [ns], in the order in which they came.
        durations: of the rows of a plan [ns], of which the first begins with the first message;
            none: only gaps and the order are judged.
        period: from one message to the next [ns]; a row begins with a message.
        jitter: how far a stamp may be from where it belongs [ns].
    """
    faults = []
    for number, (earlier, later) in enumerate(zip(stamps, stamps[1:]), 2):
        step = (later - earlier) / NANOSECONDS
        if step < 0.0:
            faults.append(f"message {number} is stamped {-step:g} s before the one before it")
        elif later - earlier > period + jitter:
            faults.append(
                f"there are {step:g} s between the stamps of messages {number - 1} and {number}; "
                f"expected {period / NANOSECONDS:g} s"
            )
    counts = _count_by_row(stamps, durations, period) if stamps else [0] * len(durations)
    for row, (count, duration) in enumerate(zip(counts, durations), 1):
        expected = -(-duration // period)
        if count != expected:
            faults.append(
                f"row {row} ({duration / NANOSECONDS:g} s) has {count} messages; "
                f"expected {expected}"
            )
    return faults


def _count_by_row(stamps: Sequence[int], durations: Sequence[int], period: int) -> List[int]:
    """Return how many messages each row has: those that are nearest to one of its due instants."""
    dues: List[int] = []
    rows: List[int] = []
    begin = stamps[0]
    for row, duration in enumerate(durations):
        row_dues = range(begin, begin + duration, period)
        dues += row_dues
        rows += [row] * len(row_dues)
        begin += duration
    dues.append(begin)
    rows.append(len(durations))  # what comes after the plan
    counts = [0] * (len(durations) + 1)
    for stamp in stamps:
        place = min(bisect.bisect_left(dues, stamp), len(dues) - 1)
        if place > 0 and stamp - dues[place - 1] < dues[place] - stamp:
            place -= 1
        counts[rows[place]] += 1
    return counts[:-1]


def odometry_faults(
    motions: Sequence[Motion], longest: int, position: float, angle: float
) -> List[str]:
    """Say where odometry is not what its own twist makes of it.

    From one message to the next the child frame moves along an arc, whose speed and turn rate are
    between those of the two messages.

    Args:
        motions: in the order of their stamps.
        longest: messages further apart than this [ns] are not compared.
        position: tolerance [m].
        angle: tolerance [rad].
    """
    faults = []
    for one, other in zip(motions, motions[1:]):
        seconds = (other.stamp - one.stamp) / NANOSECONDS
        if not 0 < other.stamp - one.stamp <= longest:
            continue
        moved = compose(inverse(one.pose), other.pose)
        turn = math.remainder(moved.theta, math.tau)
        way = math.copysign(math.hypot(moved.x, moved.y), moved.x)
        way /= math.sin(turn / 2.0) / (turn / 2.0) if turn else 1.0
        where = f"in the {seconds:g} s before {other.stamp / NANOSECONDS:.3f}"
        speeds = sorted((one.speed, other.speed))
        rates = sorted((one.turn_rate, other.turn_rate))
        if not speeds[0] * seconds - position <= way <= speeds[1] * seconds + position:
            faults.append(
                f"{where} the pose moves by {way:.6g} m, that is {way / seconds:.6g} m/s, but the "
                f"twist says {_range(speeds)} m/s in the child frame"
            )
        elif not rates[0] * seconds - angle <= turn <= rates[1] * seconds + angle:
            faults.append(
                f"{where} the pose turns by {turn:.6g} rad, that is {turn / seconds:.6g} rad/s, "
                f"but the twist says {_range(rates)} rad/s"
            )
        elif abs(aside := max(one.side_speed, other.side_speed, key=abs)) * seconds > position:
            faults.append(
                f"{where} the twist says {abs(aside):.6g} m/s to the "
                f"{'left' if aside > 0.0 else 'right'}; a car has none"
            )
        else:
            # The direction of the chord is known exactly only while the turn rate is constant.
            slack = position + abs(way) * (rates[1] - rates[0]) * seconds
            end = drive_arc(one.pose, way, turn / way if way else 0.0)
            if apart(end, other.pose) > slack:
                faults.append(
                    f"{where} the pose moves sideways: to {shown(other.pose)}; expected "
                    f"{shown(end)}"
                )
    return faults


def pose_fault(pose: Optional[Pose], wanted: Pose, position: float, angle: Optional[float]) -> str:
    """Say how a pose is not the wanted one; nothing if it is.

    Args:
        pose: what there is, None if there is nothing.
        wanted: what there is to be.
        position: tolerance [m].
        angle: tolerance [rad]; None: any heading will do.
    """
    if pose is None:
        return f"there is no pose; expected {shown(wanted)}"
    distance, angle_off = apart(pose, wanted), turned(pose, wanted)
    if distance <= position and (angle is None or angle_off <= angle):
        return ""
    return (
        f"the pose {shown(pose)} is {distance:.3g} m and {angle_off:.3g} rad from "
        f"{shown(wanted)}; allowed are {position:g} m"
        + ("" if angle is None else f" and {angle:g} rad")
    )


def _range(values: Sequence[float]) -> str:
    """Return two values as text, or one if they are the same."""
    low, high = values
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
