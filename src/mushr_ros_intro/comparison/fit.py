"""Fit the parameters of a car to a recorded drive, and find what else is wrong with it.

Least squares (scipy.optimize.least_squares) on the errors of the steps from pose to pose, with the
model of the simulated car. See `step_errors` for why not on the whole path.

A fault of FAULTS is found if it explains the steps better, by the Bayesian information criterion
(Schwarz, "Estimating the dimension of a model", 1978), and the whole path not worse. With the steps
alone, a fault can explain a part of the drive at the cost of the path.
"""

from typing import Any, Dict, List, NamedTuple, Sequence

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import DEAD, Cause, Fit, Value, car_with, fitted_value
from mushr_ros_intro.comparison.hypotheses import FAULTS, JUMP, PARAMETERS, Fault, columns_of
from mushr_ros_intro.comparison.problem import DELAY, Problem
from mushr_ros_intro.stamps import NANOSECONDS

_MIN_GAIN = 15.0
"""A fault is found if it improves the criterion by more. With healthy cars it is at most 12."""

_AS_GOOD = 6.0
"""Two faults explain a drive equally well if their criteria differ by less."""

_MIN_LEVELS = {"speed_gain": 2, "steering_gain": 3}
"""With fewer different speeds or steering angles, a limit looks like another gain."""

_MAX_CAUSES = 2

_BEGIN = 60 * NANOSECONDS
"""This part of a long drive gives the delay with which the fit begins [ns]."""


class _Candidate(NamedTuple):
    """A fault, and what the fit with it has found."""

    fault: Fault
    vector: np.ndarray
    gain: float
    """Of the criterion, over the fit without it."""


def fit(log: DriveLog, car: Car) -> Fit:
    """Fit a car to its drive; `car` is the car before the fit."""
    problem = Problem(log, car)
    begin = Problem(log.until(_BEGIN), car)
    vector = begin.best_delay(begin.default)
    base = list(range(len(PARAMETERS)))
    unknown = problem.unknown(vector, base)
    for _ in range(2):  # the covariance of the steps depends on the motion
        problem.whiten(vector)
        vector = problem.solve(vector, [each for each in base if each not in unknown])
    unknown = problem.unknown(vector, base)
    vector[list(unknown)] = problem.default[list(unknown)]
    free = [each for each in base if each not in unknown]
    vector = problem.solve(vector, free)

    causes: List[Cause] = []
    while len(causes) < _MAX_CAUSES:
        found = _found(problem, vector, free, [each.fault for each in causes])
        if not found:
            break
        best = found[0]
        vector = best.vector
        free += columns_of(best.fault)
        as_good = [_cause(problem, each) for each in found[1:] if best.gain - each.gain < _AS_GOOD]
        causes.append(_cause(problem, best)._replace(as_good=tuple(as_good)))

    errors = problem.errors(vector, free, list(unknown))
    values: Dict[str, Value] = {}
    for column, each in enumerate(PARAMETERS):
        if column in unknown:
            names = tuple(PARAMETERS[other].name for other in unknown[column])
            before = getattr(car, each.name, 0.0)
            values[each.name] = Value(before, is_fitted=False, confused_with=names)
        else:
            before = float(problem.default[column])
            number = float(vector[column])
            values[each.name] = fitted_value(each.name, number, errors[column], before)
    changed = [
        column for column, each in enumerate(PARAMETERS[:DELAY]) if values[each.name].is_change
    ]
    same = [each for each in range(DELAY) if each not in changed]
    vector[same] = problem.default[same]
    vector = problem.solve(vector, [each for each in free if each not in same])
    path_error = problem.path_error(vector)
    profile = problem.default.copy()
    profile[DELAY] = vector[DELAY]
    effects = {}
    for column in changed:
        without = vector.copy()
        without[column] = problem.default[column]
        effects[PARAMETERS[column].name] = problem.path_error(without) - path_error
    return Fit(
        _car(car, vector, causes),
        values,
        tuple(causes),
        tuple(
            name
            for name, commands in zip(("speed_gain", "steering_gain"), problem.levels)
            if values[name].is_change and commands < _MIN_LEVELS[name]
        ),
        effects,
        problem.path_error(profile),
        path_error,
        problem.noise.position,
        problem.misfit(vector),
        problem.moves_before(vector),
    )


def _cause(problem: Problem, found: _Candidate) -> Cause:
    """Return the cause that a candidate describes."""
    value = float(found.vector[columns_of(found.fault)[-1]])
    return Cause(found.fault, value, problem.jump_time(found.vector))


def _car(car: Car, vector: np.ndarray, causes: Sequence[Cause]) -> Car:
    """Return a car with fitted numbers, and with the limits that were found."""
    car = car_with(car, vector[:DELAY].tolist())
    limits = {
        "speed_cap": ("speed_limit", 0.0, car.speed_gain),
        "left_stop": ("steering_limit_left", car.steering_offset, car.steering_gain),
        "right_stop": ("steering_limit_right", -car.steering_offset, car.steering_gain),
    }
    for each in causes:
        name, offset, gain = limits.get(each.fault.number.name, ("", 0.0, 0.0))
        if gain > 0.0:
            limit: Any = max(0.0, (each.value - offset) / gain)
            car = car._replace(**{name: limit})
    return car


def _found(
    problem: Problem, vector: np.ndarray, free: Sequence[int], used: Sequence[Fault]
) -> List[_Candidate]:
    """Return the faults that explain a drive better than the fit without them, the best first."""
    path_error = problem.path_error(vector, aligned=True)
    found = []
    for fault in (each for each in FAULTS if each not in used):
        starts = problem.starts(fault, vector)
        best = starts[int(np.argmin(problem.costs(starts)))]
        columns = [*free, *columns_of(fault)]
        if not problem.may_improve(vector, best, columns):
            continue
        tried = problem.solve(best, columns)
        # The step of a jump is also a number that was chosen.
        gain = problem.gain(vector, tried, len(columns) - len(free) + (fault is JUMP))
        is_large = abs(tried[columns[-1]]) >= fault.least
        is_near = problem.path_error(tried, aligned=True) <= path_error
        if gain > _MIN_GAIN and is_large and is_near:
            found.append(_Candidate(fault, tried, gain))
    return sorted(found, key=lambda each: -each.gain)
