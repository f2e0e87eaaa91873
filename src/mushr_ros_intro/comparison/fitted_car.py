"""The parameters of a car that a fit finds, and the result of a fit."""

import math
import statistics
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.car.model import Car

Z_95 = 1.96
"""Half of the 95 % range, in standard errors."""


class Parameter(NamedTuple):
    """A parameter of a car that can be fitted."""

    name: str
    unit: str
    max_error: float
    """The drive determines the fitted number if its standard error is at most this."""
    step: float
    """For the numerical derivative."""
    low: float
    high: float


PARAMETERS = (
    # A negative gain is that of a car that is wired the wrong way round.
    Parameter("speed_gain", "", 0.05, 1e-3, -5.0, 5.0),
    Parameter("steering_gain", "", 0.1, 1e-3, -5.0, 5.0),
    Parameter("steering_offset", "rad", 0.02, 1e-4, -0.4, 0.4),
    # Fitted are the inverses of the next two, which are 0 for a car that follows at once.
    Parameter("acceleration", "m/s^2", 0.1, 1e-3, 0.0, 10.0),
    Parameter("steering_rate", "rad/s", 0.1, 1e-3, 0.0, 10.0),
    Parameter("delay", "s", 0.1, 1e-3, -3.0, 3.0),
)

OF_CAR = PARAMETERS[:-1]
"""The parameters without the delay, which is that of a drive."""

RATES = ("acceleration", "steering_rate")
"""The parameters of which the inverse is fitted."""

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
    confused_with: Tuple[str, ...] = ()
    """If it is not fitted: the parameters with the same effect on this drive."""

    def is_change_from(self, before: float) -> bool:
        """Return whether the 95 % range does not contain the value before the fit."""
        return self.is_fitted and not self.low <= before <= self.high


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


class Fit(NamedTuple):
    """The result of a fit to one drive."""

    car: Car
    """The car before the fit with the fitted values."""
    values: Dict[str, Value]
    """By the names of the parameters."""
    position_noise: float
    """Standard deviation of x and of y of a measured pose [m]."""
    misfit: Misfit

    @property
    def delay(self) -> float:
        """From a command to its effect on the pose [s]."""
        return self.values["delay"].value


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
    for name in (each.name for each in OF_CAR):
        of_drives = [fit.values[name] for fit in fits if fit.values[name].is_fitted]
        count = len(of_drives)
        if count < 2:
            values[name] = of_drives[0] if count else fits[0].values[name]
            continue
        numbers = [1.0 / each.value if name in RATES else each.value for each in of_drives]
        errors = [each.error / each.value**2 if name in RATES else each.error for each in of_drives]
        deviations[name] = statistics.stdev(numbers)
        error = max(deviations[name] ** 2, statistics.fmean(each**2 for each in errors)) / count
        values[name] = fitted_value(name, statistics.fmean(numbers), math.sqrt(error))
    spreads = {
        f"{name}_spread": deviations[name]
        for name in ("speed_gain", "steering_offset")
        if name in deviations
    }
    found: Dict[str, Any] = {name: value.value for name, value in values.items()}
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


def fitted_value(name: str, number: float, error: float) -> Value:
    """Return the value of a parameter with a fitted number and its standard error."""
    low, high = number - Z_95 * error, number + Z_95 * error
    if name not in RATES:
        return Value(number, error, low, high)
    rate, highest, lowest = (
        1.0 / each if each > _AT_ONCE else math.inf for each in (number, low, high)
    )
    return Value(rate, error * rate**2, lowest, highest)
