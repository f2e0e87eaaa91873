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
from mushr_ros_intro.comparison.faults import FAULTS, JUMP, PARAMETERS, Fault, columns_of
from mushr_ros_intro.comparison.problem import DELAY, RATES, Misfit, Problem

DEAD = 0.2
"""A car with a smaller gain hardly follows its commands."""

_Z_95 = 1.96
"""Half of the 95 % range, in standard errors."""

_SIGNIFICANT = 3.0
"""A value that has changed by less is no correction [standard errors]."""

_AT_ONCE = 1e-3
"""A smaller inverse of a rate means no limit."""

_MIN_GAIN = 15.0
"""A fault is found if it improves the criterion by more. With healthy cars it is at most 12."""

_MIN_CHANGE = 5.0
"""A fault that may reduce the cost by less is not worth a fit."""

_AS_GOOD = 6.0
"""Two faults explain a drive equally well if their criteria differ by less."""

_MIN_LEVELS = {"speed_gain": 2, "steering_gain": 3}
"""With fewer different speeds or steering angles, a limit looks like another gain."""

_MAX_CAUSES = 2


class Value(NamedTuple):
    """The fitted value of a parameter."""

    name: str
    before: float
    """The number before the fit, which is the inverse of one of RATES."""
    number: float
    """The fitted number, likewise."""
    error: float = 0.0
    """The standard error of the number."""
    is_fitted: bool = True
    """Otherwise the number is the one before, because the drive does not determine it."""

    @property
    def is_change(self) -> bool:
        """Whether the value differs from the one before the fit by more than random errors."""
        return self.is_fitted and abs(self.number - self.before) > _SIGNIFICANT * self.error

    @property
    def old(self) -> float:
        """The value before the fit."""
        return self._value(self.before)

    @property
    def new(self) -> float:
        """The value after the fit."""
        return self._value(self.number)

    @property
    def limits(self) -> Tuple[float, float]:
        """The ends of the 95 % range; the upper one is infinite if a rate may have no limit."""
        size = _Z_95 * self.error
        low, high = sorted(self._value(self.number + each) for each in (-size, size))
        return low, high

    def _value(self, number: float) -> float:
        if self.name not in RATES:
            return number
        return 1.0 / number if number > _AT_ONCE else math.inf


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
    """The car before the fit with the values that have changed."""
    values: Dict[str, Value]
    """By the names of the parameters."""
    causes: Tuple[Cause, ...]
    uncertain: Tuple[str, ...]
    """The changed gains that may also be a limit, because the drive has too few commands."""
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
        return self.values["delay"].new

    @property
    def is_found(self) -> bool:
        """Whether the drive is complete, and explained."""
        return not self.misfit.is_found and not self.moves_before

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


def fit(log: DriveLog, car: Car) -> Fit:
    """Fit a car to its drive; `car` is the car before the fit."""
    problem = Problem(log, car)
    vector = problem.best_delay(problem.default)
    base = list(range(len(PARAMETERS)))
    unknown = problem.unknown(vector, base)
    for _ in range(2):  # the covariance of the steps depends on the motion
        problem.whiten(vector)
        vector = problem.solve(vector, [each for each in base if each not in unknown])
    unknown = problem.unknown(vector, base)
    vector[unknown] = problem.default[unknown]
    free = [each for each in base if each not in unknown]
    vector = problem.solve(vector, free)

    causes: List[Cause] = []
    while len(causes) < _MAX_CAUSES:
        found = _found(problem, vector, free, [each.fault for each in causes])
        if not found:
            break
        gain, vector, cause = found[0]
        free += columns_of(cause.fault)
        as_good = tuple(each for other, _, each in found[1:] if gain - other < _AS_GOOD)
        causes.append(cause._replace(as_good=as_good))

    errors = problem.errors(vector, free, unknown)
    values = {
        each.name: Value(
            each.name,
            float(problem.default[column]),
            float(vector[column]),
            errors[column],
            column not in unknown,
        )
        for column, each in enumerate(PARAMETERS)
    }
    changed: Dict[str, Any] = {
        name: each.new for name, each in values.items() if each.is_change and name != "delay"
    }
    same = [each for each in range(DELAY) if PARAMETERS[each].name not in changed]
    vector[same] = problem.default[same]
    vector = problem.solve(vector, [each for each in free if each not in same])
    profile = problem.default.copy()
    profile[DELAY] = vector[DELAY]
    return Fit(
        car._replace(**changed),
        values,
        tuple(causes),
        tuple(
            name
            for name, commands in zip(_MIN_LEVELS, problem.levels)
            if name in changed and commands < _MIN_LEVELS[name]
        ),
        problem.path_error(profile),
        problem.path_error(vector),
        problem.noise.position,
        problem.misfit(vector),
        problem.moves_before(vector),
    )


def _found(
    problem: Problem, vector: np.ndarray, free: Sequence[int], used: Sequence[Fault]
) -> List[Tuple[float, np.ndarray, Cause]]:
    """Return the faults that explain a drive better than the fit without them, the best first.

    For each, also return the gain of the criterion and the vector of its fit.
    """
    path_error = problem.path_error(vector, aligned=True)
    found = []
    for fault in (each for each in FAULTS if each not in used):
        starts = problem.starts(fault, vector)
        best = starts[int(np.argmin(problem.costs(starts)))]
        columns = [*free, *columns_of(fault)]
        if problem.cost_after_step(best, columns) > problem.costs(vector[None])[0] - _MIN_CHANGE:
            continue
        tried = problem.solve(best, columns)
        # The step of a jump is also a number that was chosen.
        gain = problem.gain(vector, tried, len(columns) - len(free) + (fault is JUMP))
        is_large = max(np.abs(tried[list(columns_of(fault))])) >= fault.least
        is_near = problem.path_error(tried, aligned=True) <= path_error
        if gain > _MIN_GAIN and is_large and is_near:
            cause = Cause(fault, float(tried[columns[-1]]), problem.jump_time(tried))
            found.append((gain, tried, cause))
    return sorted(found, key=lambda each: -each[0])


class Combined(NamedTuple):
    """The car that several drives were fitted to, each on its own."""

    car: Car
    """The car before the fit with the mean values, and how they differ between the drives."""
    values: Dict[str, Value]
    """The mean values by name, without the delay."""
    deviations: Dict[str, float]
    """The standard deviations between the drives, by name; empty for one drive."""


def combined(fits: Sequence[Fit]) -> Combined:
    """Return the car of some drives.

    The range of a mean follows from the standard errors of the drives, or from how the drives
    differ if that is more.
    """
    values = dict(fits[0].values)
    values.pop("delay")
    deviations: Dict[str, float] = {}
    for name in values:
        of_drives = [each.values[name] for each in fits if each.values[name].is_fitted]
        if of_drives:
            values[name] = of_drives[0]
        if len(of_drives) > 1:
            deviations[name] = statistics.stdev(each.number for each in of_drives)
            variance = statistics.fmean(each.error**2 for each in of_drives)
            values[name] = of_drives[0]._replace(
                number=statistics.fmean(each.number for each in of_drives),
                error=math.sqrt(max(deviations[name] ** 2, variance) / len(of_drives)),
            )
    found: Dict[str, Any] = {
        name: each.new if each.is_change else each.old for name, each in values.items()
    }
    for name in ("speed_gain", "steering_offset"):
        if name in deviations:
            found[f"{name}_spread"] = deviations[name]
    return Combined(fits[0].car._replace(**found), values, deviations)
