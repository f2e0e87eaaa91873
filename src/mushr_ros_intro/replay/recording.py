"""The recording of a replay, and the driven and the predicted path that follow from it.

Stamps are integer nanoseconds of simulated time; poses are in the map frame.
"""

import math
from itertools import groupby
from typing import Any, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import rest, states_at
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from mushr_ros_intro.world.grid import Grid

START_TOLERANCE = 1e-3
"""Allowed difference between the start poses of node and plan [m, rad]: a node may round."""

MAX_SHIFT = 1
"""Number of commands by which the end of a row may be early or late.

Two threads of a node, one of which changes the row, may wake up at the same time.
"""


_BORDER = COMMAND_PERIOD // 2
"""The end of a row is rounded to this time, so that the number of commands is right [ns]."""


class Sent(NamedTuple):
    """One command as the node sent it."""

    time: int
    """Its stamp, or the time of arrival if the stamp is not valid [ns]."""
    has_stamp: bool
    """Whether `time` is the stamp."""
    speed: float
    """[m/s]"""
    steering_angle: float
    """[rad]"""
    arrived: int
    """When it arrived [ns]."""
    stamp: int
    """Its stamp, also if it is not valid [ns]."""

    @property
    def values(self) -> Tuple[float, float]:
        """The speed [m/s] and the steering angle [rad]."""
        return self.speed, self.steering_angle


class Recorded(NamedTuple):
    """Everything that was recorded in a replay."""

    plan: Any
    """The `Plan`, or the `Reference` that a controller follows."""
    car: Car
    outcome: str
    """How the node failed to run or to exit; empty if it did not fail."""
    start: Optional[Pose]
    """The last initial pose before the first command; NaN if its numbers are unusable."""
    sent: Tuple[Sent, ...]
    """The commands in order of arrival."""
    stamps: np.ndarray
    """When the car reported its pose [ns]; N, rising, at least one."""
    poses: np.ndarray
    """The reported poses: x [m], y [m], theta [rad]; N x 3."""
    collisions: Tuple[Pose, ...]
    """The poses at which the car hit a wall."""
    grid: Optional[Grid]
    """The map, or None if there is none."""
    actions: Tuple[str, ...] = ()
    """What the node did besides driving the car, such as "publishes on /clock"."""
    ignored: str = ""
    """The first message that the car ignored, and the reason; empty if there was none."""
    limit: str = ""
    """The first limit on a rate of change in a command; empty if there was none."""
    output: str = ""
    """The end of the node's output."""
    error: str = ""
    """The last exception that the node printed before the replay ended it; empty if none."""
    seconds: float = 0.0
    """The duration of the replay [s of wall-clock time]."""
    start_delay: int = 0
    """The delay of the start pose if it arrived after the first command to drive [ns]."""
    published: Tuple[Tuple[str, str], ...] = ()
    """The topics on which the node has published, and their types."""
    plan_is_read: bool = True
    """Whether the node has read its parameter ~plan_file."""

    @property
    def commands(self) -> Tuple[Sent, ...]:
        """The commands without the stops before the plan; all of them if there are only stops."""
        return self.sent[count_leading_stops(self.sent, self.plan) :] or self.sent

    @property
    def begin(self) -> int:
        """The time of the first command, or of the last pose if there is no command [ns]."""
        return self.commands[0].time if self.sent else int(self.stamps[-1])


class Run(NamedTuple):
    """Consecutive rows of a plan with the same command."""

    speed: float
    """[m/s]"""
    steering_angle: float
    """[rad]"""
    first: int
    """The number of its first row, from 1."""
    last: int
    """The number of its last row."""
    duration: int
    """[ns]"""
    expected: int
    """The number of commands that the node should send."""

    def __str__(self) -> str:
        rows = f"row {self.first}"
        if self.last > self.first:
            rows = f"rows {self.first} to {self.last}"
        return f"{rows} ({self.duration / NANOSECONDS:g} s)"


class Drive(NamedTuple):
    """The driven and the predicted path, sampled at the same N times."""

    times: np.ndarray
    """Since the start of the drive [s]; N."""
    driven: np.ndarray
    """x [m], y [m], theta [rad]; N x 3."""
    predicted: np.ndarray
    """x [m], y [m], theta [rad]; N x 3."""
    frechet_distance: float = math.nan
    """The discrete Frechet distance of the two paths [m]; NaN if it is not needed."""

    @property
    def distances(self) -> np.ndarray:
        """The distance between both positions at each time [m]; N."""
        return np.hypot(*(self.driven - self.predicted)[:, :2].T)


def count_leading_stops(sent: Sequence[Sent], plan: Plan) -> int:
    """Return the number of stops before the first command of a plan."""
    if plan.rows[0][:2] == (0.0, 0.0):
        return 0
    return next((index for index, each in enumerate(sent) if each.values != (0.0, 0.0)), len(sent))


def runs_of(plan: Plan) -> List[Run]:
    """Return the rows of a plan, with consecutive rows of the same command merged."""
    runs: List[Run] = []
    for (speed, angle), group in groupby(enumerate(plan.rows, 1), lambda entry: entry[1][:2]):
        numbers, rows = zip(*group)
        durations = [row.duration for row in rows]
        expected = sum(-(-duration // COMMAND_PERIOD) for duration in durations)
        runs.append(Run(speed, angle, numbers[0], numbers[-1], sum(durations), expected))
    return runs


def groups_of(recorded: Recorded) -> List[List[Sent]]:
    """Return the commands in groups of equal neighbours, without the stop at the end."""
    groups = [list(group) for _, group in groupby(recorded.commands, lambda sent: sent.values)]
    runs = runs_of(recorded.plan)
    has_more = len(groups) == len(runs) + 1 and groups[-1][0].values != runs[-1][:2]
    if has_more and groups[-1][0].speed == 0.0:
        groups.pop()
    return groups


def matched(recorded: Recorded) -> Iterator[Tuple[Run, List[Sent]]]:
    """Yield the runs of the plan with their commands, up to the first run with other commands."""
    for run, group in zip(runs_of(recorded.plan), groups_of(recorded)):
        if group[0].values != run[:2]:
            return
        yield run, group


def driven_plan(recorded: Recorded) -> Plan:
    """Return the plan with its rows as long as the node drove them.

    No row ends earlier or later than in the plan by more than MAX_SHIFT commands. If the node did
    not drive so, return the plan itself.
    """
    rows, due, before, end, number = list(recorded.plan.rows), recorded.begin, 0, 0, 0
    sent = recorded.commands
    for run, group in matched(recorded):
        due, number = due + run.duration, number + len(group)
        if number < len(sent):  # the next command ends the row, but a stop may come late
            left = sent[number].time
            if sent[number].speed == 0.0:
                left = min(left, max(due + before, group[-1].time + COMMAND_PERIOD))
        elif run.speed == 0.0:  # the length of a stop at the end changes nothing
            left = due + before
        else:
            left = group[-1].time + run.duration - (run.expected - 1) * COMMAND_PERIOD
        shift = round((left - due) / _BORDER) * _BORDER
        # All rows of a run have the same command. So only their total duration matters.
        index = max(range(end, run.last), key=lambda each: rows[each].duration)
        duration = rows[index].duration + shift - before
        if abs(shift) > MAX_SHIFT * COMMAND_PERIOD or duration <= 0:
            return recorded.plan
        rows[index] = rows[index]._replace(duration=duration)
        before, end = shift, run.last
    is_complete = end == len(rows)
    return recorded.plan._replace(rows=tuple(rows)) if is_complete else recorded.plan


def drive(recorded: Recorded) -> Drive:
    """Return the driven path from the start pose on, and the predicted path.

    The prediction is for the commands of `driven_plan`. It has the same noise, which depends on the
    car's seed and on the number of a command. If the recording ends before the plan, the car counts
    as standing from there on. Both paths end with the last move of either.
    """
    plan = driven_plan(recorded)
    begin = _first_pose(recorded)
    driven = recorded.poses[begin:]
    instants = (recorded.stamps[begin:] - recorded.begin).tolist()
    end, _ = rest(plan, recorded.car)
    step = max(NANOSECONDS // 50, (end - instants[-1]) // 10_000)
    instants += range(instants[-1] + step, end + step, step)
    standing = np.repeat(driven[-1:], len(instants) - len(driven), axis=0)
    driven = np.concatenate([driven, standing])
    states = states_at(plan, recorded.car, instants)
    predicted = np.array([state.pose for state in states], float)
    moves, _ = np.nonzero(np.diff(np.hstack([driven, predicted]), axis=0))
    last = int(moves[-1]) + 2 if len(moves) else 1
    times, driven, predicted = (
        np.array(instants[:last]) / NANOSECONDS,
        driven[:last],
        predicted[:last],
    )
    return Drive(times, driven, predicted, frechet_distance(driven[:, :2], predicted[:, :2]))


def placed_pose(recorded: Recorded) -> int:
    """Return the index of the pose nearest to the plan's start pose.

    It is at most two command periods after the first command, because the car may be placed late.
    """
    count = int(np.searchsorted(recorded.stamps, recorded.begin + 2 * COMMAND_PERIOD))
    poses = [Pose(*row) for row in recorded.poses[: max(1, count)]]
    start = recorded.plan.start
    return int(np.argmin([each.distance_to(start) + each.angle_to(start) for each in poses]))


def _first_pose(recorded: Recorded) -> int:
    """Return the index of the first pose of the drive: `placed_pose`, or the first command's."""
    placed = placed_pose(recorded)
    if placed and recorded.sent and not recorded.commands[0].has_stamp:
        return placed  # the time of an unstamped command is too rough
    first = int(np.searchsorted(recorded.stamps, recorded.begin))
    return max(placed, min(first, len(recorded.stamps) - 1))


def frechet_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the discrete Frechet distance of two curves [m].

    It is the length of the shortest leash that lets two walkers, one on each curve, go from point
    to point to the end without going back (Eiter and Mannila, "Computing Discrete Frechet
    Distance", CD-TR 94/64). Each anti-diagonal of the recursion's table is computed at once, and
    only where the leash is not longer than that of two walkers who keep pace. So for near curves,
    the time grows with their length, and not with its square.

    Args:
        one: points [m], N x 2, N at least 1.
        other: points [m], M x 2, M at least 1.
    """
    n, m = len(one), len(other)
    steps, count = np.arange(max(n, m)), max(1, n - 1, m - 1)
    pairs = one[steps * (n - 1) // count] - other[steps * (m - 1) // count]
    longest = float(np.max(np.hypot(*pairs.T)))
    # Of anti-diagonal k and the one before: the first i, and the shortest leash to each (i, k - i).
    before, last = (-1, np.array([-np.inf])), (0, np.empty(0))
    for k in range(n + m - 1):
        begin = max(k - m + 1, 0, min(before[0] + 1, last[0]))
        end = min(k + 1, n, max(before[0] + len(before[1]), last[0] + len(last[1])) + 1)
        shortest = np.full(max(0, end - begin), np.inf)
        for start, leashes in ((before[0] + 1, before[1]), last, (last[0] + 1, last[1])):
            low, high = max(begin, start), min(end, start + len(leashes))
            if low < high:
                part = shortest[low - begin : high - begin]
                np.minimum(part, leashes[low - start : high - start], out=part)
        rows = np.arange(begin, begin + len(shortest))
        leashes = np.maximum(shortest, np.hypot(*(one[rows] - other[k - rows]).T))
        near = np.nonzero(leashes <= longest)[0]
        first, stop = (int(near[0]), int(near[-1]) + 1) if len(near) else (0, 0)
        before, last = last, (begin + first, leashes[first:stop])
    return float(last[1][-1])
