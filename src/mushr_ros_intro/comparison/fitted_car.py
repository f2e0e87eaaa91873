"""The parameters of a car that a fit finds, and the result of a fit."""

import math
from typing import Any, Dict, List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.pose_filter import Noise


class Parameter(NamedTuple):
    """A parameter of a car that can be fitted."""

    name: str
    unit: str
    max_error: float
    """The drives determine the fitted number if its standard error is at most this."""
    step: float
    """For the numerical derivative."""
    low: float
    high: float


PARAMETERS = (
    Parameter("speed_gain", "", 0.05, 1e-3, 0.2, 5.0),
    Parameter("steering_gain", "", 0.1, 1e-3, 0.2, 5.0),
    Parameter("steering_offset", "rad", 0.02, 1e-4, -0.4, 0.4),
    # Fitted are the inverses of the last two, which are 0 for a car that follows at once.
    Parameter("acceleration", "m/s^2", 0.1, 1e-3, 0.0, 10.0),
    Parameter("steering_rate", "rad/s", 0.1, 1e-3, 0.0, 10.0),
)

DELAY = Parameter("delay", "s", 0.1, 1e-3, -3.0, 3.0)

OF_DRIVE = (
    DELAY,
    # How the speed gain and the steering offset differ from those of the car.
    Parameter("change of speed_gain", "", 0.05, 1e-3, -5.0, 5.0),
    Parameter("change of steering_offset", "rad", 0.02, 1e-4, -0.5, 0.5),
)
"""The numbers of one drive."""

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
    """Otherwise the value is the one before the fit, because the drives do not determine it."""
    change: float = 0.0
    """The difference from the value before the fit, in standard errors."""
    confused_with: Tuple[str, ...] = ()
    """If it is not fitted: the parameters with the same effect on these drives."""


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
    """The result of a fit."""

    car: Car
    """The car before the fit with the fitted values, and the noise."""
    cars: Tuple[Car, ...]
    """The same with the speed gain and the steering offset of each drive."""
    values: Dict[str, Value]
    """By the names of the parameters."""
    delays: Tuple[Value, ...]
    """From a command to its effect on the pose, of each drive [s]."""
    noise: Noise
    """The random errors of the measured poses and of the car."""
    misfits: Tuple[Misfit, ...]
    """Of each drive."""
    glitches: Tuple[Tuple[Tuple[float, float], ...], ...]
    """Of each drive: the times between which the car or its poses moved as by no random error [s].

    The fit does not use what happened between them."""


def numbers_of(car: Car) -> List[float]:
    """Return the fitted numbers of a car, one for each of PARAMETERS."""
    values = [(each.name, getattr(car, each.name)) for each in PARAMETERS]
    return [1.0 / value if name in RATES else value for name, value in values]


def car_with(car: Car, numbers: Sequence[float]) -> Car:
    """Return a car with fitted numbers, one for each of PARAMETERS."""
    values: Dict[str, Any] = {
        each.name: (math.inf if number <= 0.0 else 1.0 / number) if each.name in RATES else number
        for each, number in zip(PARAMETERS, numbers)
    }
    return car._replace(**values)


def fitted_value(name: str, number: float, before: float, error: float, factor: float) -> Value:
    """Return the value of a parameter.

    Args:
        name: of the parameter.
        number: the fitted number.
        before: the number before the fit.
        error: standard error of the number.
        factor: how far the 95 % range reaches to each side, in standard errors.
    """
    change = (number - before) / error if error else 0.0
    low, high = number - factor * error, number + factor * error
    if name not in RATES:
        return Value(number, error, low, high, change=change)
    rate, highest, lowest = (
        1.0 / each if each > _AT_ONCE else math.inf for each in (number, low, high)
    )
    return Value(rate, error * rate**2, lowest, highest, change=change)
