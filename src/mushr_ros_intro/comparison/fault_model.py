"""Drive cars with one more number than a `Car` has side by side, as numpy arrays."""

from typing import Dict, Tuple

import numpy as np
from scipy.linalg import solve_banded

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.hypotheses import NUMBERS
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.side_by_side import arcs, ramped
from mushr_ros_intro.stamps import NANOSECONDS

_STEP = 0.04
"""Longest step [s]; each is an arc. Along figure_8 at 2 m/s, the error is 3 mm."""

_MAX_STEPS = 100_000
"""Limit of the number of steps; those of a longer drive are longer."""

_AT_ONCE = 1e9
"""A rate that stands for an infinite one: the product of it and 0 s is 0."""

Numbers = Dict[str, np.ndarray]
"""The numbers of some cars by name, (cars,)."""


def paths(plan: Plan, car: Car, vectors: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """Return the reported poses of cars that drive the rows of a plan from the origin.

    Args:
        plan: each command is valid until the next one.
        car: with the limits of the commands, and the wheelbase.
        vectors: NUMBERS of each car, (cars, numbers).
        instants: of each car, rising [s], (cars, N).

    Returns:
        x [m], y [m], theta [rad], (cars, N, 3).
    """
    numbers = dict(zip((each.name for each in NUMBERS), vectors.T))
    begins = np.cumsum([0, *(row.duration for row in plan.rows)]) / NANOSECONDS
    end = max(0.0, float(instants.max()))
    step = max(_STEP, end / _MAX_STEPS)
    times = np.union1d(begins[begins <= end], np.arange(0.0, end + 2.0 * step, step))
    seconds = np.diff(times)[:, None]
    of_step = np.searchsorted(begins, times[:-1], side="right") - 1

    begins = begins[begins <= times[-1]]  # a command may be years after the last pose
    speed_targets, angle_targets = _targets(plan, car, numbers)
    _, speeds = _follow(speed_targets, numbers["acceleration"], begins, of_step, times)
    angle_begins, angles = _follow(angle_targets, numbers["steering_rate"], begins, of_step, times)
    angle_begins, angles = _lagged(angle_begins, angles, numbers["steering_lag"], seconds)
    angles = _with_play(angle_begins, angles, numbers["play"], of_step)

    middles = times[:-1, None] + 0.5 * seconds
    speeds = speeds * np.exp(-numbers["fading"] * middles)
    chords, turns = arcs(speeds * seconds, angles, car.wheelbase)
    headings = _sums(turns)
    moves = chords * np.exp(1j * (headings[:-1] + 0.5 * turns))
    places = _sums(moves) + numbers["point"] * np.exp(1j * headings)
    columns = np.array([places.real, places.imag, headings])
    return np.array(
        [
            [np.interp(each, times, column[:, index]) for column in columns]
            for index, each in enumerate(instants)
        ]
    ).transpose(0, 2, 1)


def _targets(plan: Plan, car: Car, numbers: Numbers) -> Tuple[np.ndarray, np.ndarray]:
    """Return the speeds and the steering angles that the rows lead to, (rows + 1, cars)."""
    commands = [car.within_limits(*row[:2]) for row in plan.rows]
    speed, angle = np.array([*commands, (0.0, 0.0)]).T[..., None]
    speed = np.clip(speed * numbers["speed_gain"], -numbers["speed_cap"], numbers["speed_cap"])
    gain = numbers["steering_gain"] * (1.0 + numbers["imbalance"] * np.sign(angle))
    angle = np.clip(
        angle * gain + numbers["steering_offset"], -numbers["right_stop"], numbers["left_stop"]
    )
    return speed, angle


def _follow(
    targets: np.ndarray,
    inverse_rate: np.ndarray,
    begins: np.ndarray,
    of_step: np.ndarray,
    times: np.ndarray,
) -> Tuple[np.ndarray, np.ndarray]:
    """Return a value that changes to its targets at a limited rate.

    Returns:
        At the beginning of each step, and the mean in each step, (steps, cars).
    """
    rate = 1.0 / np.maximum(inverse_rate, 1.0 / _AT_ONCE)
    firsts = np.zeros_like(targets)
    for row, duration in enumerate(np.diff(begins)):
        reach = rate * duration
        firsts[row + 1] = np.minimum(
            np.maximum(targets[row], firsts[row] - reach), firsts[row] + reach
        )
    since = (times[:-1] - begins[of_step])[:, None] * rate
    goals = targets[of_step]
    values = np.clip(goals, firsts[of_step] - since, firsts[of_step] + since)
    means, _ = ramped(values, goals, np.diff(times)[:, None] * rate)
    return values, means


def _lagged(
    begins: np.ndarray, means: np.ndarray, lag: np.ndarray, seconds: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return what follows a value with a lag of first order [s]: y' = (x - y) / lag.

    The arguments and results are like the results of `_follow`. The recursion is a linear equation.
    """
    begins, means = begins.copy(), means.copy()
    for car in np.flatnonzero(lag):
        kept = np.exp(-seconds[:, 0] / lag[car])
        band = np.array([np.ones(len(kept)), np.append(-kept[1:], 0.0)])
        ends = solve_banded((1, 0), band, (1.0 - kept) * means[:, car])
        begins[:, car] = np.append(0.0, ends[:-1])
        means[:, car] -= lag[car] * (ends - begins[:, car]) / seconds[:, 0]
    return begins, means


def _with_play(
    begins: np.ndarray, means: np.ndarray, play: np.ndarray, of_step: np.ndarray
) -> np.ndarray:
    """Return the mean steering angles that follow others with some play [rad].

    In a row, the angle changes in one direction, so the last one is clipped once per row.
    """
    if not play.any():
        return means
    half = 0.5 * play
    steps = np.flatnonzero(np.diff(of_step, prepend=-1))
    at_rows = np.zeros((len(steps), means.shape[1]))
    for row, step in enumerate(steps[1:], 1):
        at_rows[row] = np.clip(at_rows[row - 1], begins[step] - half, begins[step] + half)
    held = at_rows[np.cumsum(np.diff(of_step, prepend=-1) > 0) - 1]
    return np.clip(held, means - half, means + half)


def _sums(parts: np.ndarray) -> np.ndarray:
    """Return the sums of the first 0, 1, ... parts, along the first axis."""
    return np.concatenate([np.zeros_like(parts[:1]), np.cumsum(parts, axis=0)])
