"""A recorded drive: the commands that reached the car, and the poses that it reported.

Times count from the first command that moves the car.
"""

from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.authoring.recorder import rows_from
from mushr_ros_intro.car.model import Car, Command
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import ORIGIN, Pose
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.preview.prediction import length, rest, states_at
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE, effective_stamp, from_seconds
from mushr_ros_intro.wording import counted

_BEFORE, _AFTER = 2 * NANOSECONDS, 3 * NANOSECONDS
"""Poses are used from before the first command that moves the car until after the last one [ns]."""

_MIN_POSES = 20

_PLACED = 0.2
"""A pose that is further from the one at the first command is not the start pose [m, rad]."""

_STANDING = NANOSECONDS // 2
"""The start pose is the mean of the poses of this time [ns]."""

_MOVED = 0.2
"""A car that drives moves by this share of the commanded distance, or of 1 m, at least."""

_SETTLED = NANOSECONDS * 3 // 10
"""Time after the predicted rest at which the car counts as standing [ns]."""

_MAX_GAP = 2 * NANOSECONDS
"""Longest time without a pose during the drive [ns]."""


class DriveLog(NamedTuple):
    """A recorded drive."""

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
    events = [
        Command(time - begin, speed, angle)
        for time, (speed, angle) in zip(times, commands.values)
        if time >= begin
    ]
    events.sort(key=lambda each: each.stamp)  # of two with one stamp, the later one applies
    rows = rows_from(events, timeout)

    arrived = _times(poses, [True] * len(poses.values), notes)
    table = {
        time - begin: value
        for time, value in zip(arrived, poses.values)
        if begin - _BEFORE <= time <= end + _AFTER
    }
    stamps = np.array(sorted(table), np.int64)
    values = np.array([table[stamp] for stamp in stamps.tolist()], float).reshape(-1, 3)
    _check_poses(name, poses.topic, stamps, values, rows)
    if stamps[-1] < end - begin:
        missing = (end - begin - stamps[-1]) / NANOSECONDS
        notes.append(f"{poses.topic}: the poses end {missing:.1f} s before the commands")
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


def start_pose(log: DriveLog, delay: int) -> Pose:
    """Return the mean of the poses just before the first command, or the first pose.

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
    return Pose(*poses.mean(axis=0).tolist())


def compare(log: DriveLog, car: Car, delay: float) -> Drive:
    """Compare a drive with what a car would have done from its start pose.

    The last pose is the mean of the poses after the car has come to rest.

    Args:
        log: the drive.
        car: of the prediction; its noise is not used.
        delay: from a command to its effect on the pose [s].
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    stamps = log.stamps - from_seconds(delay)
    plan = log.plan._replace(start=start_pose(log, from_seconds(delay)))
    end, _ = rest(plan, car)
    driven = log.poses.copy()
    driven[:, 2] = np.unwrap(driven[:, 2])
    is_after = stamps >= max(end, min(end + _SETTLED, stamps[-1]))
    is_used = (stamps >= 0) & (stamps < end)
    final = driven[is_after].mean(axis=0, keepdims=True) if is_after.any() else driven[:0]
    stamps = np.append(stamps[is_used], [end] * len(final))
    driven = np.vstack([driven[is_used], final])
    states = states_at(plan, car, stamps.tolist())
    predicted = np.array([state.pose for state in states], float)
    turns = np.round((driven[0, 2] - predicted[0, 2]) / (2.0 * np.pi))
    driven[:, 2] -= 2.0 * np.pi * turns
    return Drive(stamps / NANOSECONDS, driven, predicted)
