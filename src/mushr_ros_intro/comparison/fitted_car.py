"""The parameters of a car that a fit finds, and the result of a fit."""

import math
import statistics
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.hypotheses import PARAMETERS, Fault

DEAD = 0.2
"""A car with a smaller gain hardly follows its commands."""

Z_95 = 1.96
"""Half of the 95 % range, in standard errors."""


OF_CAR = PARAMETERS[:-1]
"""The parameters without the delay, which is that of a drive."""

RATES = ("acceleration", "steering_rate")
"""The parameters of which the inverse is fitted."""

_SIGNIFICANT = 3.0
"""A value that has changed by less is no correction [standard errors]."""

_SMALL_ERROR = 0.02
"""A fit explains a drive in any case if it leaves less than this of the error [m]."""

_AT_ONCE = 1e-3
"""A smaller inverse of a rate means no limit."""


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


class Misfit(NamedTuple):
    """The row in which a drive differs most from the fitted car."""

    row: int
    """Index of the row."""
    what: str
    """"distance", "sideways" or "turn"."""
    size: float
    """The mean difference, in standard errors of it."""
    limit: float
    """Random errors exceed this size in 0.1 % of all drives."""

    @property
    def is_found(self) -> bool:
        """Whether the drive does not fit the model of the car."""
        return self.size > self.limit


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


def numbers_of(car: Car) -> List[float]:
    """Return the fitted numbers of a car, one for each of PARAMETERS; the delay is 0."""
    values = [(each.name, getattr(car, each.name)) for each in OF_CAR]
    return [*(1.0 / value if name in RATES else value for name, value in values), 0.0]


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
