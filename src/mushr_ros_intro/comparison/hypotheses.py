"""The numbers that a drive may determine: those of a car, its delay, and one for each fault.

A new fault is a row of FAULTS, and its effect is in `fault_model`.
"""

import math
from typing import NamedTuple, Tuple


class Number(NamedTuple):
    """A number that can be fitted."""

    name: str
    unit: str
    neutral: float
    """Of a car without the fault."""
    max_error: float
    """The drive determines the number if its standard error is at most this."""
    step: float
    """For the numerical derivative."""
    low: float
    high: float


PARAMETERS = (
    # A negative gain is that of a car that is wired the wrong way round.
    Number("speed_gain", "", 1.0, 0.05, 1e-3, -5.0, 5.0),
    Number("steering_gain", "", 1.0, 0.1, 1e-3, -5.0, 5.0),
    Number("steering_offset", "rad", 0.0, 0.02, 1e-4, -0.4, 0.4),
    # Fitted are the inverses of the next two, which are 0 for a car that follows at once.
    Number("acceleration", "m/s^2", 0.0, 0.1, 1e-3, 0.0, 10.0),
    Number("steering_rate", "rad/s", 0.0, 0.1, 1e-3, 0.0, 10.0),
    Number("delay", "s", 0.0, 0.1, 1e-3, -3.0, 3.0),
)


class Fault(NamedTuple):
    """What may be wrong with a car or a drive, besides its parameters."""

    number: Number
    starts: Tuple[float, ...]
    """Values with which the fit begins; shares of the largest command if it limits commands."""
    least: float
    """A smaller value does not matter."""
    leaves_gains: bool
    """Whether the fitted gains and the offset are right beside this fault."""
    is_in_profile: bool
    """Whether a profile has a number for it, or needs none."""
    sentence: str
    """What the car does; {0} is the value, {1} the side of a signed one, {2} the time."""
    remedy: str
    test: str
    """The drive that tells it from others."""


_INF = math.inf
_TWO_SPEEDS = "a drive at two speeds"
_BOTH_SIDES = "a drive with small and large steering angles to both sides"

FAULTS = (
    Fault(
        Number("speed_cap", "m/s", _INF, 0.05, 1e-3, 0.01, _INF),
        (0.4, 0.6, 0.8, 0.9, 0.95),
        0.0,
        True,
        True,
        "drives at most {0:.2f} m/s",
        "check speed_max and speed_min in vesc.yaml and the battery, or drive slower",
        _TWO_SPEEDS,
    ),
    Fault(
        Number("left_stop", "rad", _INF, 0.03, 1e-4, 0.0, _INF),
        (0.3, 0.5, 0.7, 0.85, 0.95),
        0.0,
        True,
        True,
        "steers at most {0:.3f} rad to the left",
        "check the stops of the steering, and servo_min and servo_max in vesc.yaml",
        _BOTH_SIDES,
    ),
    Fault(
        Number("right_stop", "rad", _INF, 0.03, 1e-4, 0.0, _INF),
        (0.3, 0.5, 0.7, 0.85, 0.95),
        0.0,
        True,
        True,
        "steers at most {0:.3f} rad to the right",
        "check the stops of the steering, and servo_min and servo_max in vesc.yaml",
        _BOTH_SIDES,
    ),
    Fault(
        Number("imbalance", "", 0.0, 0.05, 1e-3, -0.9, 0.9),
        (-0.2, -0.08, 0.08, 0.2),
        0.015,
        False,
        False,
        "steers {0:.0%} more to the {1} than the mean of both sides",
        "check the linkage of the steering; one gain cannot correct both sides",
        _BOTH_SIDES,
    ),
    Fault(
        Number("play", "rad", 0.0, 0.05, 1e-4, 0.0, 0.5),
        (0.02, 0.05, 0.1),
        0.01,
        True,
        False,
        "has {0:.3f} rad of play in the steering",
        "tighten the linkage of the steering and the horn of the servo",
        "a drive that comes to the same steering angle from both sides",
    ),
    Fault(
        Number("fading", "1/s", 0.0, 0.05, 1e-4, 0.0, 0.5),
        (0.005, 0.02, 0.05),
        0.003,
        False,
        False,
        "loses {0:.1%} of its speed in each second",
        "charge the battery, and drive again",
        "a longer drive",
    ),
    Fault(
        Number("steering_lag", "s", 0.0, 0.2, 1e-3, 0.0, 5.0),
        (0.05, 0.15, 0.4),
        0.03,
        True,
        False,
        "follows a steering angle with a lag of {0:.2f} s",
        "check the supply of the servo; no number of vesc.yaml corrects it",
        "a drive with more changes of the steering angle",
    ),
    Fault(
        Number("point", "m", 0.0, 0.1, 1e-3, -3.0, 3.0),
        (-0.2, -0.05, 0.1, 0.3),
        0.02,
        True,
        True,
        "reports the pose of a point {0:.2f} m {1} the rear axle",
        "use --pose_offset",
        "a drive with tighter curves",
    ),
    Fault(
        Number("jump", "rad", 0.0, _INF, 1e-4, -4.0, 4.0),
        (),
        0.0,
        True,
        True,
        "has a localisation that jumps at {2:.1f} s",
        "repeat the drive, and set the pose of the localisation first",
        "another drive",
    ),
)

JUMP = FAULTS[-1]
"""The localisation jumps and turns in one step; three more numbers are the step and the move."""

NUMBERS = (
    *PARAMETERS,
    *(each.number for each in FAULTS[:-1]),
    Number("jump_step", "", 0.0, _INF, 1.0, 0.0, _INF),
    Number("jump_x", "m", 0.0, _INF, 1e-3, -10.0, 10.0),
    Number("jump_y", "m", 0.0, _INF, 1e-3, -10.0, 10.0),
    JUMP.number,
)
"""A vector has these numbers."""

JUMP_STEP = len(NUMBERS) - 4

_JUMP_COLUMNS = (JUMP_STEP + 1, JUMP_STEP + 2, JUMP_STEP + 3)


def columns_of(fault: Fault) -> Tuple[int, ...]:
    """Return the columns of a vector that are fitted for a fault."""
    if fault is JUMP:
        return _JUMP_COLUMNS
    return ([each.name for each in NUMBERS].index(fault.number.name),)
