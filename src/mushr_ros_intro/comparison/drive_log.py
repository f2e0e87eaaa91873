"""A recorded drive: the commands that reached the car, and the poses that it reported."""

from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.authoring.recorder import rows_from
from mushr_ros_intro.car.model import Command
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import ORIGIN, Pose
from mushr_ros_intro.plan.plan import Plan, Row, shortest_decimal
from mushr_ros_intro.preview.prediction import length
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE, effective_stamp
from mushr_ros_intro.wording import counted

_BEFORE, _AFTER = 2 * NANOSECONDS, 3 * NANOSECONDS
"""Poses are used from before the first command that moves the car until after the last one [ns]."""

_MIN_POSES = 20

_MAX_JUMP = 0.5
"""A pose further than this from the one before is a fault, apart from the driven distance [m]."""

_PLACED = 0.2
"""A car that moves by more than this before the first command was placed [m, rad]."""

_STANDING = NANOSECONDS // 2
"""The start pose is the mean of the poses of this time [ns]."""

_MOVED = 0.2
"""A car that drives moves by this share of the commanded distance, or of 1 m, at least."""

_MAX_GAP = 2 * NANOSECONDS
"""Longest time without a pose during the drive [ns]."""

_PLAN_TOLERANCE = NANOSECONDS // 5
"""The time by which a row of the plan and its commands may differ [ns]."""


class DriveLog(NamedTuple):
    """A recorded drive. Its times count from the first command that moves the car."""

    name: str
    """The file that it comes from."""
    plan: Plan
    """The commands as rows; the start pose is not known here, and is the origin."""
    stamps: np.ndarray
    """The stamps of the poses [ns], (N,), rising; apart from the delay to be found."""
    poses: np.ndarray
    """The reported poses: x [m], y [m], theta [rad], (N, 3)."""
    notes: Tuple[str, ...]
    """What the user should know about the recording."""

    @property
    def unit(self) -> str:
        """What a row is called: "line" of the plan's file, or "row" of the commands."""
        return "line" if self.plan.rows[0].line else "row"

    def number(self, index: int) -> int:
        """Return the number of a row: its line in the plan's file, or its place from 1."""
        return self.plan.rows[index].line or index + 1

    def until(self, stamp: int) -> "DriveLog":
        """Return the drive with the poses until an instant [ns]."""
        count = int(np.searchsorted(self.stamps, stamp))
        return self._replace(stamps=self.stamps[:count], poses=self.poses[:count])


class Received(NamedTuple):
    """The messages of one topic."""

    topic: str
    arrivals: Sequence[int]
    """When they were recorded [ns], rising."""
    stamps: Sequence[int]
    """Their stamps [ns]; 0 if there is none."""
    values: Sequence[Tuple[float, ...]]
    """Speed [m/s] and steering angle [rad], or x [m], y [m] and theta [rad]."""
    ignored: Tuple[str, ...] = ()
    """For each message that cannot be used, the reason."""


def drive_log(name: str, commands: Received, poses: Received, timeout: int) -> DriveLog:
    """Return the drive in recorded messages.

    Args:
        name: of the recording, for messages.
        commands: the commands that reached the car.
        poses: the poses of the car.
        timeout: how long the car follows a command [ns].

    Raises:
        UserError: there is no drive in them, or the poses cannot be used.
    """
    notes: List[str] = []
    moving = [bool(speed) for speed, _ in commands.values]
    if not any(moving):
        raise UserError(
            f"{name}: {commands.topic} has {counted(len(moving), 'command')}, and none of them "
            "moves the car; expected the commands of a drive"
        )
    times = _times(commands, moving, notes)
    begin = min(time for time, moves in zip(times, moving) if moves)
    end = max(time for time, moves in zip(times, moving) if moves)
    events = sorted(
        Command(time - begin, speed, angle)
        for time, (speed, angle) in zip(times, commands.values)
        if time >= begin
    )
    rows = rows_from(events, timeout)

    arrived = _times(poses, [True] * len(poses.values), notes)
    table = {
        time - begin: value
        for time, value in zip(arrived, poses.values)
        if begin - _BEFORE <= time <= end + _AFTER
    }
    stamps = np.array(sorted(table), np.int64)
    values = np.array([table[stamp] for stamp in stamps.tolist()], float).reshape(-1, 3)
    placed = _last_jump(stamps, values)
    stamps, values = stamps[placed:], values[placed:]
    _check_poses(name, poses.topic, stamps, values, rows)
    for received in (commands, poses):
        if received.ignored:
            what = counted(len(received.ignored), "message")
            notes.append(f"{received.topic}: ignored {what}; the first: {received.ignored[0]}")
    return DriveLog(name, Plan(name, ORIGIN, rows), stamps, values, tuple(notes))


def _times(received: Received, counts: Sequence[bool], notes: List[str]) -> List[int]:
    """Return when messages apply [ns]: at their stamps, or when they were recorded.

    The stamps of another clock are corrected by the median difference of those messages that count.
    """
    differences = [
        stamp - arrival
        for stamp, arrival, is_used in zip(received.stamps, received.arrivals, counts)
        if is_used and stamp
    ]
    shift = int(np.median(differences)) if differences else 0
    if abs(shift) <= STAMP_TOLERANCE:
        shift = 0
    else:
        notes.append(
            f"{received.topic}: the stamps are {shift / NANOSECONDS:+.3f} s from the clock of the "
            "recording; corrected"
        )
    return [
        effective_stamp(stamp - shift if stamp else 0, arrival)
        for stamp, arrival in zip(received.stamps, received.arrivals)
    ]


def _check_poses(
    name: str, topic: str, stamps: np.ndarray, poses: np.ndarray, rows: Sequence[Row]
) -> None:
    """Raise a UserError if poses do not show a drive."""
    count = int(np.count_nonzero(stamps > 0))
    if count < _MIN_POSES:
        raise UserError(
            f"{name}: {topic} has {counted(count, 'pose')} after the first command that moves the "
            f"car; expected at least {_MIN_POSES}"
        )
    gaps = np.diff(stamps)
    without = np.append(stamps[0], gaps)  # the first one begins with the first command
    longest = int(np.argmax(without))
    if without[longest] > _MAX_GAP:
        begin = stamps[longest - 1] if longest else 0
        raise UserError(
            f"{name}: {topic} has no pose for {without[longest] / NANOSECONDS:.1f} s from "
            f"{begin / NANOSECONDS:.1f} s after the first command on; expected poses "
            "during the whole drive"
        )
    extent = float(np.hypot(*np.ptp(poses[:, :2], axis=0)))
    commanded = length(Plan(name, ORIGIN, tuple(rows)))
    if extent < _MOVED * min(commanded, 1.0):
        raise UserError(
            f"{name}: the poses on {topic} stay within {extent:.3f} m, and the commands ask for "
            f"{commanded:.2f} m; expected the poses of a car that drives"
        )
    fastest = max(abs(row.speed) for row in rows)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    excess = steps - 2.0 * fastest * gaps / NANOSECONDS
    jump = int(np.argmax(excess))
    if excess[jump] > _MAX_JUMP:
        raise UserError(
            f"{name}: the pose on {topic} jumps by {steps[jump]:.2f} m at "
            f"{stamps[jump + 1] / NANOSECONDS:.1f} s after the first command; expected the poses "
            "of a localisation that does not lose the car, and of one drive"
        )


def with_rows_of(log: DriveLog, plan: Plan) -> DriveLog:
    """Return a drive with the rows of the plan that was driven.

    path_publisher may have slowed rows down; then the speeds are those of the commands.

    Raises:
        UserError: the commands do not belong to the plan.
    """
    commanded = log.plan.rows
    ends = np.cumsum([row.duration for row in commanded])
    rows: List[Row] = []
    now = 0
    for row in plan.rows:
        if not row.speed and not rows:
            continue  # the drive begins with the first command that moves the car
        middle = now + row.duration // 2
        index = min(int(np.searchsorted(ends, middle, side="right")), len(commanded) - 1)
        sent = commanded[index] if middle < ends[-1] + _PLAN_TOLERANCE else None
        is_slowed = sent is not None and 0.0 < sent.speed / (row.speed or 1.0) <= 1.0
        if sent is None or not (sent[:2] == row[:2] or (is_slowed and sent[1] == row[1])):
            shown = (
                "ended"
                if sent is None
                else "were {:g} m/s and {:g} rad".format(*map(shortest_decimal, sent[:2]))
            )
            if not row.speed and sent is None:
                break
            raise UserError(
                f"{plan.path}:{row.line}:1: the plan asks for {shortest_decimal(row.speed):g} m/s "
                f"and {shortest_decimal(row.steering_angle):g} rad, but the commands in {log.name} "
                f"{shown} {middle / NANOSECONDS:.2f} s after the first one; expected the plan that "
                "was driven to its end, or no --plan"
            )
        rows.append(row._replace(speed=sent.speed))
        now += row.duration
    if ends[-1] > now + _PLAN_TOLERANCE:
        raise UserError(
            f"{log.name}: the commands last {ends[-1] / NANOSECONDS:.1f} s, and {plan.path} "
            f"{now / NANOSECONDS:.1f} s; expected the plan that was driven, once"
        )
    return log._replace(plan=plan._replace(rows=tuple(rows)))


def _last_jump(stamps: np.ndarray, poses: np.ndarray) -> int:
    """Return the index of the first pose after the car was placed; see `_PLACED`."""
    before = poses[stamps <= 0]
    steps = np.diff(before, axis=0)
    angles = np.abs(np.angle(np.exp(1j * steps[:, 2])))
    jumps = np.flatnonzero(np.maximum(np.hypot(*steps[:, :2].T), angles) > _PLACED)
    return int(jumps[-1]) + 1 if len(jumps) else 0


def start_pose(log: DriveLog, delay: int) -> Tuple[Pose, int]:
    """Return the mean of the poses just before the first command, and their number.

    Without such poses, it is the first pose, and the number is 0.

    Args:
        log: the drive.
        delay: from a command to its effect on the pose [ns].
    """
    stamps = log.stamps - delay
    count = int(np.searchsorted(stamps, 0, side="right"))
    poses = log.poses[max(0, int(np.searchsorted(stamps, -_STANDING))) : count]
    if len(poses):
        apart = poses - poses[-1]
        apart[:, 2] = np.angle(np.exp(1j * apart[:, 2]))
        poses = poses[-1] + apart[np.abs(apart).max(axis=1) < _PLACED]
    else:
        poses = log.poses[:1]
    return Pose(*poses.mean(axis=0).tolist()), count and len(poses)
