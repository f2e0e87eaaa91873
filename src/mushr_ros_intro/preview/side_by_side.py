"""Drive cars without noise side by side, as numpy arrays."""

import math
from typing import Sequence, Tuple, Union

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.stamps import NANOSECONDS

_STEP = 0.01
"""Longest step [s]; each is an arc. Along figure_8 at 2 m/s, the error is 0.16 mm."""

_MAX_STEPS = 100_000
"""Limit of the number of steps; those of a longer drive are longer."""

_AT_ONCE = 1e9
"""A rate that stands for an infinite one: the product of it and 0 s is 0."""


def paths(plan: Plan, cars: Sequence[Car], instants: np.ndarray) -> np.ndarray:
    """Return the poses of cars that drive a plan, as `prediction.states_at` does for one car.

    Args:
        plan: each command is valid until the next one.
        cars: their noise is not used.
        instants: of each car, rising [s], (cars, N).

    Returns:
        x [m], y [m], theta [rad], (cars, N, 3).
    """
    rows = [*(row[:2] for row in plan.rows), (0.0, 0.0)]
    begins = np.cumsum([0, *(row.duration for row in plan.rows)]) / NANOSECONDS
    end = max(0.0, float(instants.max()))
    step = max(_STEP, end / _MAX_STEPS)
    times = np.union1d(begins[begins <= end], np.arange(0.0, end + 2.0 * step, step))
    targets = np.array([[car.response(*row) for car in cars] for row in rows])  # (rows, cars, 2)
    rates = np.array([[car.acceleration, car.steering_rate] for car in cars])
    rates = np.minimum(rates, _AT_ONCE)
    firsts = np.zeros_like(targets)
    for row, seconds in enumerate(np.diff(begins)):
        reach = rates * seconds
        firsts[row + 1] = np.clip(targets[row], firsts[row] - reach, firsts[row] + reach)

    of_step = np.searchsorted(begins, times[:-1], side="right") - 1
    since = (times[:-1] - begins[of_step])[:, None, None] * rates
    goals = targets[of_step]
    values = np.clip(goals, firsts[of_step] - since, firsts[of_step] + since)
    seconds = np.diff(times)
    means, _ = ramped(values, goals, seconds[:, None, None] * rates)
    wheelbases = np.array([car.wheelbase for car in cars])
    chords, turns = arcs(means[..., 0] * seconds[:, None], means[..., 1], wheelbases)
    headings = plan.start.theta + _sums(turns)
    moves = chords * np.exp(1j * (headings[:-1] + 0.5 * turns))
    places = complex(*plan.start[:2]) + _sums(moves)
    columns = np.array([places.real, places.imag, headings])
    return np.array(
        [
            [np.interp(each, times, column[:, car]) for column in columns]
            for car, each in enumerate(instants)
        ]
    ).transpose(0, 2, 1)


def _sums(parts: np.ndarray) -> np.ndarray:
    """Return the sums of the first 0, 1, ... parts, along the first axis."""
    return np.concatenate([np.zeros_like(parts[:1]), np.cumsum(parts, axis=0)])


def ramped(
    begin: np.ndarray, end: np.ndarray, reach: Union[float, np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the mean and the last value of a ramp towards `end` that changes by up to `reach`."""
    last = np.clip(end, begin - reach, begin + reach)
    change = last - begin
    return last - 0.5 * change * np.abs(change) / reach, last


def arcs(
    distance: np.ndarray, angle: np.ndarray, wheelbase: Union[float, np.ndarray]
) -> Tuple[np.ndarray, np.ndarray]:
    """Return the chord [m] and the turn [rad] of arcs; see `geometry.drive_arc`.

    Args:
        distance: along the arc [m].
        angle: the steering angle [rad].
        wheelbase: [m].
    """
    turn = distance * np.tan(angle) / wheelbase
    return distance * np.sinc(0.5 * turn / math.pi), turn
