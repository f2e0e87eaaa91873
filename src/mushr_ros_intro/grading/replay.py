"""The recording of a replay, and the driven and the predicted path that follow from it.

Stamps are integer nanoseconds of simulated time; poses are in the map frame.
"""

import math
from itertools import groupby
from typing import List, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.model import MAX_STEERING_ANGLE, Plan
from mushr_ros_intro.preview.prediction import rest, states_at
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS
from mushr_ros_intro.world.grid import Grid

START_TOLERANCE = 1e-3
"""Between the start poses of the node and of the plan [m, rad]: a node may round to text."""

_MAX_DEVIATIONS = 5.0
"""Noise exceeds this many standard deviations less than once in a million draws."""


class Sent(NamedTuple):
    """One command as the node sent it."""

    time: int
    """Its stamp, or the approximate time of arrival if the stamp is zero [ns]."""
    stamped: bool
    """Whether `time` is the stamp."""
    speed: float
    """[m/s]"""
    steering_angle: float
    """[rad]"""


class Replay(NamedTuple):
    """Everything that was recorded in a replay."""

    plan: Plan
    car: Car
    outcome: str
    """How the node failed to run or to exit; empty if it did not fail."""
    starts: Tuple[Pose, ...]
    """The start poses that the node sent; NaN if a message had unusable numbers."""
    sent: Tuple[Sent, ...]
    """The commands in order of arrival."""
    stamps: np.ndarray
    """When the car reported its pose [ns]; N, rising."""
    poses: np.ndarray
    """The reported poses: x [m], y [m], theta [rad]; N x 3."""
    collisions: Optional[Tuple[Pose, ...]]
    """The poses at which the car hit a wall; None if collisions were not reported."""
    grid: Optional[Grid]
    """The map, or None if there is none."""


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
    """Since the first command [s]; N."""
    driven: np.ndarray
    """x [m], y [m], theta [rad]; N x 3."""
    predicted: np.ndarray
    """x [m], y [m], theta [rad]; N x 3."""

    @property
    def frechet_distance(self) -> float:
        """The discrete Frechet distance of the two paths [m]."""
        return frechet_distance(self.driven[:, :2], self.predicted[:, :2])


def runs_of(plan: Plan) -> List[Run]:
    """Return the rows of a plan, with consecutive rows of the same command merged."""
    commands = [(row.speed, row.steering_angle) for row in plan.rows]
    runs: List[Run] = []
    for command, group in groupby(enumerate(plan.rows), lambda entry: commands[entry[0]]):
        indices, rows = zip(*group)
        durations = [row.duration for row in rows]
        expected = sum(-(-duration // COMMAND_PERIOD) for duration in durations)
        runs.append(Run(*command, indices[0] + 1, indices[-1] + 1, sum(durations), expected))
    return runs


def max_rates(plan: Plan, car: Car, deviations: float = 0.0) -> Tuple[float, float]:
    """Return the largest speed [m/s] and turn rate [rad/s] of a plan.

    The noise of the car adds `deviations` of its standard deviations to both.
    """
    speed_error, angle_error = deviations * car.speed_noise, deviations * car.steering_noise
    turns = (
        (abs(row.speed) + speed_error)
        * math.tan(min(abs(row.steering_angle) + angle_error, MAX_STEERING_ANGLE))
        for row in plan.rows
    )
    return max(abs(row.speed) for row in plan.rows) + speed_error, max(turns) / car.wheelbase


def drive(replay: Replay) -> Drive:
    """Return the driven path from the start pose on, and the predicted path.

    The prediction is that of a car without noise. If the recording ends before the plan, the car
    counts as standing from there on. Both paths end with the last move of either.

    Args:
        replay: with at least one command and one pose.
    """
    begin = _first_pose(replay)
    driven = replay.poses[begin:]
    instants = (replay.stamps[begin:] - replay.sent[0].time).tolist()
    car = replay.car._replace(speed_noise=0.0, steering_noise=0.0)
    end, _ = rest(replay.plan, car)
    step = max(NANOSECONDS // 50, (end - instants[-1]) // 10_000)
    instants += range(instants[-1] + step, end + step, step)
    standing = np.repeat(driven[-1:], len(instants) - len(driven), axis=0)
    driven = np.concatenate([driven, standing])
    predicted = np.array([state.pose for state in states_at(replay.plan, car, instants)], float)
    is_moving = np.any(np.diff(driven, axis=0) != 0.0, axis=1)
    is_moving |= np.any(np.diff(predicted, axis=0) != 0.0, axis=1)
    moves = np.flatnonzero(is_moving)
    last = int(moves[-1]) + 2 if len(moves) else 1
    return Drive(np.array(instants[:last]) / NANOSECONDS, driven[:last], predicted[:last])


def _first_pose(replay: Replay) -> int:
    """Return the index of the first pose of the drive.

    This is the pose after the last jump (a displacement that the car cannot have driven) up to
    two command periods after the first command, but not before that command.
    """
    first = replay.sent[0].time
    count = int(np.searchsorted(replay.stamps, first + 2 * COMMAND_PERIOD))
    x, y, theta = np.diff(replay.poses[:count], axis=0).T
    seconds = np.diff(replay.stamps[:count]) / NANOSECONDS
    speed, turn_rate = max_rates(replay.plan, replay.car, _MAX_DEVIATIONS)
    turned = np.abs(np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi)
    jumps = np.flatnonzero(
        (np.hypot(x, y) > speed * seconds + START_TOLERANCE)
        | (turned > turn_rate * seconds + START_TOLERANCE)
    )
    placed = int(jumps[-1]) + 1 if len(jumps) else 0
    if len(jumps) and not replay.sent[0].stamped:
        return placed  # the time of an unstamped command is too rough
    return max(placed, min(int(np.searchsorted(replay.stamps, first)), len(replay.stamps) - 1))


def frechet_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the discrete Frechet distance of two curves [m].

    It is the length of the shortest leash that lets two walkers, one on each curve, go from point
    to point to the end without going back (Eiter and Mannila, "Computing Discrete Frechet
    Distance", CD-TR 94/64). Each anti-diagonal of the recursion's table is computed at once.

    Args:
        one: points [m], N x 2, N at least 1.
        other: points [m], M x 2, M at least 1.
    """
    n, m = len(one), len(other)
    # Index i + 1 holds the shortest leash to (i, k - i), for anti-diagonal k and the two before.
    before = np.full(n + 1, np.inf)
    last = np.full(n + 1, np.inf)
    before[0] = -np.inf  # any leash lets the walkers begin at (0, 0)
    for k in range(n + m - 1):
        low, high = max(0, k - m + 1), min(n - 1, k)
        ends = other[k - high : k - low + 1][::-1]
        leash = np.hypot(one[low : high + 1, 0] - ends[:, 0], one[low : high + 1, 1] - ends[:, 1])
        shortest = np.minimum(last[low + 1 : high + 2], last[low : high + 1])
        shortest = np.minimum(shortest, before[low : high + 1])
        present = np.full(n + 1, np.inf)
        present[low + 1 : high + 2] = np.maximum(leash, shortest)
        before, last = last, present
    return float(last[n])
