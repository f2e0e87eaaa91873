"""The numbers that a drive may determine, and the paths of cars with them, as numpy arrays.

The numbers are those of a car, its delay, and one for each fault. A new fault is a row of FAULTS,
and its effect is in `paths`.
"""

import math
from typing import Dict, NamedTuple, Tuple

import numpy as np
from scipy.linalg import solve_banded

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.side_by_side import arcs, ramped
from mushr_ros_intro.stamps import NANOSECONDS

_STEP = 0.04
"""Longest step [s]; each is an arc. Along figure_8 at 2 m/s, the error is 3 mm."""

_AT_ONCE = 1e9
"""A rate that stands for an infinite one: the product of it and 0 s is 0."""


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
    """Values with which the fit begins; shares of the largest command for a limit or dead band."""
    least: float
    """A smaller value does not matter."""
    sentence: str
    """What the car does; {0} is the value, {1} the side of a signed one, {2} the time."""
    remedy: str
    leaves_gains: bool = False
    """Whether the fitted gains and the offset are right beside this fault."""
    is_in_profile: bool = False
    """Whether a profile needs no number for it."""


_INF = math.inf

_LEVELS = (0.171, 0.283, 0.391, 0.517, 0.623, 0.737, 0.853)
_NO_SLOPE = 1e-9
"""A dead band changes the drive only where it reaches a command, so one of its starts stays."""


def _stop(side: str) -> Fault:
    return Fault(
        Number(f"{side}_stop", "rad", _INF, 0.03, 1e-4, 0.0, _INF),
        (0.3, 0.5, 0.7, 0.85, 0.95),
        0.0,
        f"steers at most {{0:.3f}} rad to the {side}",
        "check the stops of the steering, and servo_min and servo_max in vesc.yaml",
        leaves_gains=True,
    )


FAULTS = (
    Fault(
        Number("speed_cap", "m/s", _INF, 0.05, 1e-3, 0.01, _INF),
        (0.4, 0.6, 0.8, 0.9, 0.95),
        0.0,
        "drives at most {0:.2f} m/s",
        "check speed_max and speed_min in vesc.yaml and the battery, or drive slower",
        leaves_gains=True,
    ),
    _stop("left"),
    _stop("right"),
    Fault(
        Number("speed_dead_band", "m/s", 0.0, 0.05, _NO_SLOPE, 0.0, _INF),
        _LEVELS,
        0.05,
        "does not move at commands below {0:.2f} m/s",
        "drive faster, or lower the minimum ERPM of the motor controller, and drive again",
    ),
    Fault(
        Number("steering_dead_band", "rad", 0.0, 0.03, _NO_SLOPE, 0.0, _INF),
        _LEVELS,
        0.02,
        "does not steer at commands below {0:.3f} rad",
        "check the servo and the linkage of the steering, and drive again",
    ),
    Fault(
        Number("imbalance", "", 0.0, 0.05, 1e-3, -0.9, 0.9),
        (-0.2, -0.08, 0.08, 0.2),
        0.015,
        "steers {0:.0%} more to the {1} than the mean of both sides",
        "check the linkage of the steering; one gain cannot correct both sides",
    ),
    Fault(
        Number("play", "rad", 0.0, 0.05, 1e-4, 0.0, 0.5),
        (0.02, 0.05, 0.1),
        0.01,
        "has {0:.3f} rad of play in the steering",
        "tighten the linkage of the steering and the horn of the servo, and drive again",
    ),
    Fault(
        Number("fading", "1/s", 0.0, 0.05, 1e-4, 0.0, 0.5),
        (0.005, 0.02, 0.05),
        0.003,
        "loses {0:.1%} of its speed in each second",
        "charge the battery, and drive again",
    ),
    Fault(
        Number("speed_lag", "s", 0.0, 0.2, 1e-3, 0.0, 5.0),
        (0.05, 0.15, 0.4),
        0.05,
        "follows a speed with a lag of {0:.2f} s",
        "check the controller of the motor; no number of vesc.yaml corrects it",
        leaves_gains=True,
    ),
    Fault(
        Number("steering_lag", "s", 0.0, 0.2, 1e-3, 0.0, 5.0),
        (0.05, 0.15, 0.4),
        0.03,
        "follows a steering angle with a lag of {0:.2f} s",
        "check the supply of the servo; no number of vesc.yaml corrects it",
        leaves_gains=True,
    ),
    Fault(
        Number("understeer", "s^2/m^2", 0.0, 0.2, 1e-3, 0.0, 5.0),
        (0.05, 0.2, 0.6, 1.5),
        0.02,
        "turns less with the speed v, by the factor 1 / (1 + {0:.2f} v^2)",
        "drive slower, and check the tyres and the floor",
    ),
    Fault(
        Number("point", "m", 0.0, 0.1, 1e-3, -3.0, 3.0),
        (-0.2, -0.05, 0.1, 0.3),
        0.02,
        "reports the pose of a point {0:.2f} m {1} the rear axle",
        "use --pose_offset",
        leaves_gains=True,
        is_in_profile=True,
    ),
    Fault(
        Number("jump", "rad", 0.0, _INF, 1e-4, -4.0, 4.0),
        (),
        0.05,
        "has a localisation that jumps at {2:.1f} s",
        "repeat the drive, and set the pose of the localisation first",
        leaves_gains=True,
        is_in_profile=True,
    ),
)

JUMP = FAULTS[-1]
"""The localisation jumps and turns in one step; three more numbers are the step and the move."""

NUMBERS = (
    *PARAMETERS,
    *(each.number for each in FAULTS[:-1]),
    Number("jump_step", "", 0.0, _INF, 1.0, 0.0, _INF),
    Number("jump_x", "m", 0.0, _INF, 1e-3, -_INF, _INF),
    Number("jump_y", "m", 0.0, _INF, 1e-3, -_INF, _INF),
    JUMP.number,
)
"""A vector has these numbers."""

JUMP_STEP = len(NUMBERS) - 4


def columns_of(fault: Fault) -> Tuple[int, ...]:
    """Return the columns of a vector that are fitted for a fault."""
    if fault is JUMP:
        return (JUMP_STEP + 1, JUMP_STEP + 2, JUMP_STEP + 3)
    return ([each.name for each in NUMBERS].index(fault.number.name),)


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
    times = np.union1d(begins[begins <= end], np.arange(0.0, end + 2.0 * _STEP, _STEP))
    seconds = np.diff(times)[:, None]
    of_step = np.searchsorted(begins, times[:-1], side="right") - 1

    begins = begins[begins <= times[-1]]  # a command may be years after the last pose
    speed_targets, angle_targets = _targets(plan, car, numbers)
    speed_begins, speeds = _follow(speed_targets, numbers["acceleration"], begins, of_step, times)
    _, speeds = _lagged(speed_begins, speeds, numbers["speed_lag"], seconds)
    angle_begins, angles = _follow(angle_targets, numbers["steering_rate"], begins, of_step, times)
    angle_begins, angles = _lagged(angle_begins, angles, numbers["steering_lag"], seconds)
    angles = _with_play(angle_begins, angles, numbers["play"], of_step)

    middles = times[:-1, None] + 0.5 * seconds
    speeds = speeds * np.exp(-numbers["fading"] * middles)
    tangents = np.tan(angles) / (1.0 + numbers["understeer"] * speeds**2)
    chords, turns = arcs(speeds * seconds, np.arctan(tangents), car.wheelbase)
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


def _targets(plan: Plan, car: Car, numbers: Dict[str, np.ndarray]) -> Tuple[np.ndarray, np.ndarray]:
    """Return the speeds and the steering angles that the rows lead to, (rows + 1, cars)."""
    commands = [car.within_limits(*row[:2]) for row in plan.rows]
    speed, angle = np.array([*commands, (0.0, 0.0)]).T[..., None]
    speed = np.where(np.abs(speed) > numbers["speed_dead_band"], speed, 0.0)
    angle = np.where(np.abs(angle) > numbers["steering_dead_band"], angle, 0.0)
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
    reaches = rate * np.diff(begins)[:, None]
    firsts = np.zeros_like(targets)
    for row, reach in enumerate(reaches):
        firsts[row + 1] = np.clip(targets[row], firsts[row] - reach, firsts[row] + reach)
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
