"""Fit the parameters of a car to recorded drives.

Least squares (scipy.optimize.least_squares) on the prediction errors from pose to pose, with the
model of the simulated car. See `pose_filter` for why not on the whole path.
"""

import math
from typing import Any, Dict, Sequence

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import OF_DRIVE, Fit, Value, fitted_value
from mushr_ros_intro.comparison.noise_fit import NoiseFit
from mushr_ros_intro.comparison.pose_filter import Noise, usual_noise
from mushr_ros_intro.comparison.problem import COUNT, Problem

MAX_POSES = 1000
"""Of a drive with more poses, every second, third, ... one is used."""

MAX_POSES_FOR_NOISE = 250
"""Likewise, until the noise is known."""

_MAX_ROUNDS = 10
"""Limit of the number of times that the noise and the glitches are estimated."""


def fit(logs: Sequence[DriveLog], car: Car) -> Fit:
    """Fit a car to its drives; `car` is the car before the fit."""
    coarse = Problem(logs, car, MAX_POSES_FOR_NOISE)
    noise = usual_noise(car)
    vector = coarse.find_delays(coarse.default, noise)
    unknown = coarse.unknown(vector, noise)
    vector = coarse.solve(vector, coarse.widths(noise, list(unknown)), noise)
    vector = coarse.find_delays(vector, noise)
    for number in range(_MAX_ROUNDS):
        has_changed = coarse.find_glitches(vector, noise)
        if number > 1 and not has_changed:
            break
        vector = coarse.solve(vector, coarse.widths(noise, list(unknown)), noise)
        noise = NoiseFit(coarse, vector, list(unknown)).best(noise)
    problem = Problem(logs, car, MAX_POSES)
    unknown = problem.unknown(vector, noise)
    vector[list(unknown)] = problem.default[list(unknown)]
    problem.find_glitches(vector, noise)
    vector = problem.solve(vector, problem.widths(noise, list(unknown)), noise)
    factors, of_next = NoiseFit(coarse, vector, list(unknown)).range_factors(noise)
    # The values of the unknown numbers may be wrong by their `max_error`.
    widths = problem.widths(noise, list(unknown), 1.0)
    errors = np.sqrt(np.diag(problem.covariance(vector, widths, noise)))
    names = [each.name for each in problem.parameters]
    values = []
    for column, (number, before) in enumerate(zip(vector.tolist(), problem.default.tolist())):
        if column in unknown:
            confused = tuple(names[each] for each in unknown[column])
            value = getattr(car, names[column], before)
            values.append(Value(value, is_fitted=False, confused_with=confused))
        else:
            error = float(errors[column])
            values.append(fitted_value(names[column], number, before, error, factors[column]))
    found: Dict[str, Any] = {name: each.value for name, each in zip(names[:COUNT], values)}
    found.update(zip(Noise._fields[3:], noise[3:]))
    # The next drive differs from the fitted value, and the estimate of the difference may be wrong.
    for name, factor in zip(("speed_gain", "steering_offset"), of_next):
        spread = math.hypot(found[f"{name}_spread"], errors[names.index(name)])
        found[f"{name}_spread"] = spread * (factor if len(logs) > 1 else 1.0)
    drives = list(zip(problem.drives, problem.vectors(vector)))
    return Fit(
        car._replace(**found),
        tuple(drive.car(numbers) for drive, numbers in drives),
        dict(zip(names[:COUNT], values)),
        tuple(values[COUNT :: len(OF_DRIVE)]),
        noise,
        tuple(drive.misfit(numbers, noise) for drive, numbers in drives),
        tuple(tuple(drive.glitches(numbers[COUNT])) for drive, numbers in drives),
    )
