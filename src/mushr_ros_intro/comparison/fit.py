"""Fit the parameters of a car to a recorded drive, and find what else is wrong with it.

Least squares (scipy.optimize.least_squares) on the errors of the steps from pose to pose, with the
model of the simulated car. See `step_errors` for why not on the whole path.

A fault of FAULTS is found if it explains the steps better, by the Bayesian information criterion
(Schwarz, "Estimating the dimension of a model", 1978), and the whole path not worse. With the steps
alone, a fault can explain a part of the drive at the cost of the path.
"""

import math
import statistics
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.hypotheses import FAULTS, JUMP, PARAMETERS, Fault, columns_of
from mushr_ros_intro.comparison.problem import DELAY, OF_CAR, RATES, Misfit, Problem, numbers_of
from mushr_ros_intro.stamps import NANOSECONDS

DEAD = 0.2
"""A car with a smaller gain hardly follows its commands."""

Z_95 = 1.96
"""Half of the 95 % range, in standard errors."""


_SIGNIFICANT = 3.0
"""A value that has changed by less is no correction [standard errors]."""

_SMALL_ERROR = 0.02
"""A fit explains a drive in any case if it leaves less than this of the error [m]."""

_AT_ONCE = 1e-3
"""A smaller inverse of a rate means no limit."""

_MIN_GAIN = 15.0
"""A fault is found if it improves the criterion by more. With healthy cars it is at most 12."""

_AS_GOOD = 6.0
"""Two faults explain a drive equally well if their criteria differ by less."""

_MIN_LEVELS = {"speed_gain": 2, "steering_gain": 3}
"""With fewer different speeds or steering angles, a limit looks like another gain."""

_MAX_CAUSES = 2

_BEGIN = 60 * NANOSECONDS
"""This part of a long drive gives the delay with which the fit begins [ns]."""


class Value(NamedTuple):
    """The fitted value of a parameter."""

    value: float
    error: float = 0.0
    """Its standard error."""
    low: float = 0.0
    """Lower end of its 95 % range."""
    high: float = 0.0
    """Upper end. The range of a rate is not symmetric, and infinite if there may be no limit."""
    is_fitted: bool = True
    """Otherwise the value is the one before the fit, because the drive does not determine it."""
    change: float = 0.0
    """The difference from the value before the fit, in standard errors."""
    confused_with: Tuple[str, ...] = ()
    """If it is not fitted: the parameters with the same effect on this drive."""

    @property
    def is_change(self) -> bool:
        """Whether the value differs from the one before the fit by more than random errors."""
        return abs(self.change) > _SIGNIFICANT


class Cause(NamedTuple):
    """A fault that was found."""

    fault: Fault
    value: float
    time: float
    """When the localisation jumps, if it does [s]."""
    as_good: Tuple["Cause", ...] = ()
    """Other faults that explain the drive equally well."""

    @property
    def text(self) -> str:
        """What the car does."""
        sides = ("in front of", "behind") if self.fault.number.unit == "m" else ("left", "right")
        side = sides[self.value < 0.0]
        return self.fault.sentence.format(abs(self.value), side, self.time)


class Fit(NamedTuple):
    """The result of a fit to one drive."""

    car: Car
    """The car before the fit with those fitted values whose range does not contain the old one."""
    values: Dict[str, Value]
    """By the names of the parameters."""
    causes: Tuple[Cause, ...]
    uncertain: Tuple[str, ...]
    """The changed gains that may also be a limit, because the drive has too few commands."""
    effects: Dict[str, float]
    """By how much each changed parameter reduces `path_error` [m]."""
    profile_error: float
    """The distance of the drive from the path of the car before the fit [m] (rms)."""
    path_error: float
    """The distance of the drive from the path that the fit predicts [m] (rms)."""
    position_noise: float
    """Standard deviation of x and of y of a measured pose [m]."""
    misfit: Misfit
    moves_before: bool
    """Whether the car moves before its first command, so commands are missing."""

    @property
    def delay(self) -> float:
        """From a command to its effect on the pose [s]."""
        return self.values["delay"].value

    @property
    def is_explained(self) -> bool:
        """Whether the fitted car drives like that, but for random and small errors."""
        return not self.misfit.is_found or self.path_error < _SMALL_ERROR

    @property
    def is_found(self) -> bool:
        """Whether the drive is complete, and explained."""
        return self.is_explained and not self.moves_before

    @property
    def is_certain(self) -> bool:
        """Whether the fitted gains and the offset are right."""
        gains = (self.car.speed_gain, self.car.steering_gain)
        return (
            self.is_found
            and not self.uncertain
            and all(each.fault.leaves_gains and not each.as_good for each in self.causes)
            and min(map(abs, gains)) > DEAD
        )

    @property
    def is_profile(self) -> bool:
        """Whether a profile can describe the car."""
        is_forward = min(self.car.speed_gain, self.car.steering_gain) > 0.0
        known = all(each.fault.is_in_profile for each in self.causes)
        return self.is_certain and is_forward and known


class Combined(NamedTuple):
    """The car that several drives were fitted to, each on its own."""

    car: Car
    """The car before the fit with the mean values, and how they differ between the drives."""
    values: Dict[str, Value]
    """The mean values by name, without the delay."""
    spreads: Dict[str, float]
    """Standard deviations between the drives, by the names in `Car`; empty for one drive."""


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


def combined(fits: Sequence[Fit], car: Car) -> Combined:
    """Return the car of some drives; `car` is the car before the fit.

    The range of a mean follows from the standard errors of the drives, or from how the drives
    differ if that is more.
    """
    values: Dict[str, Value] = {}
    deviations: Dict[str, float] = {}
    for each in OF_CAR:
        name = each.name
        of_drives = [fit.values[name] for fit in fits if fit.values[name].is_fitted]
        count = len(of_drives)
        if count < 2:
            values[name] = of_drives[0] if count else fits[0].values[name]
            continue
        numbers = [1.0 / one.value if name in RATES else one.value for one in of_drives]
        errors = [one.error / one.value**2 if name in RATES else one.error for one in of_drives]
        deviations[name] = statistics.stdev(numbers)
        error = max(deviations[name] ** 2, statistics.fmean(one**2 for one in errors)) / count
        before = numbers_of(car)[OF_CAR.index(each)]
        values[name] = fitted_value(name, statistics.fmean(numbers), math.sqrt(error), before)
    spreads = {
        f"{name}_spread": deviations[name]
        for name in ("speed_gain", "steering_offset")
        if name in deviations
    }
    found: Dict[str, Any] = {name: value.value for name, value in values.items() if value.is_change}
    for name in ("speed_limit", "steering_limit_left", "steering_limit_right"):
        found[name] = statistics.fmean(getattr(fit.car, name) for fit in fits)
    return Combined(car._replace(**{**found, **spreads}), values, spreads)


def car_with(car: Car, numbers: Sequence[float]) -> Car:
    """Return a car with fitted numbers, one for each of OF_CAR."""
    values: Dict[str, Any] = {
        each.name: (math.inf if number <= 0.0 else 1.0 / number) if each.name in RATES else number
        for each, number in zip(OF_CAR, numbers)
    }
    return car._replace(**values)


def fitted_value(name: str, number: float, error: float, before: float) -> Value:
    """Return the value of a parameter.

    Args:
        name: of the parameter.
        number: the fitted number.
        error: its standard error.
        before: the number before the fit.
    """
    change = (number - before) / error
    low, high = number - Z_95 * error, number + Z_95 * error
    if name not in RATES:
        return Value(number, error, low, high, change=change)
    rate, highest, lowest = (
        1.0 / each if each > _AT_ONCE else math.inf for each in (number, low, high)
    )
    return Value(rate, error * rate**2, lowest, highest, change=change)
