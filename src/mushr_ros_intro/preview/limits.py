"""Check a plan against the limits of a car, and slow it down."""

import itertools
import math
from typing import Iterator, List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import MAX_SPEED, Fault, Plan, as_float32
from mushr_ros_intro.stamps import NANOSECONDS

_ROUNDING = 1e-6
"""A ramp may exceed its row by this fraction, because commands are rounded to float32."""


class Step(NamedTuple):
    """The motion of the car during one row, or during the stop after the last row."""

    begin: int
    """Beginning of the row [ns]."""
    end: int
    """End of the row; of the stop, the stamp from which on the car is at rest [ns]."""
    speed: float
    """Speed at the beginning [m/s]."""
    steering_angle: float
    """Steering angle at the beginning [rad]."""
    distance: float
    """Distance driven, forward and in reverse [m]."""
    pose: Pose
    """Pose at the end, in the map frame."""


def slowed(plan: Plan, max_speed: float) -> Tuple[Plan, List[Fault]]:
    """Return a plan with no speed above `max_speed` [m/s], forward and in reverse.

    Also return one fault for each run of rows that have been slowed down.
    """
    limit = as_float32(min(max_speed, MAX_SPEED))
    allowed = f"the largest speed allowed is {max_speed:g} m/s, which replaces it"
    faults = [
        plan.fault(first, 0, f"{_asks(plan, first, last, 0)}; {allowed}")
        for first, last in _runs([abs(row.speed) > limit for row in plan.rows])
    ]
    rows = tuple(row._replace(speed=max(-limit, min(limit, row.speed))) for row in plan.rows)
    return plan._replace(rows=rows), faults


def limit_faults(plan: Plan, car_name: str, car: Car) -> Iterator[Fault]:
    """Yield a fault for a heading in degrees, and for each run of rows beyond a limit."""
    if abs(plan.start.theta) > math.tau:
        yield plan.fault(-1, 2, "theta is more than a full turn; expected radians, not degrees")
    for cell, sign, limit, does in (
        (0, 1.0, car.speed_limit, "does {:.4g} m/s"),
        (0, -1.0, car.speed_limit, "does {:.4g} m/s in reverse"),
        (1, 1.0, car.steering_limit_left, "steers {:.4g} rad to the left"),
        (1, -1.0, car.steering_limit_right, "steers {:.4g} rad to the right"),
    ):
        limit_sent = as_float32(min(limit, MAX_SPEED))  # rows are rounded likewise
        for first, last in _runs([sign * row[:2][cell] > limit_sent for row in plan.rows]):
            text = f"{_asks(plan, first, last, cell)}; the {car_name} {does.format(limit)} at most"
            yield plan.fault(first, cell, text)


def ramp_faults(plan: Plan, steps: Sequence[Step], car_name: str, car: Car) -> Iterator[Fault]:
    """Yield a fault for each run of rows that end before the car has reached their command."""
    targets = [car.response(row.speed, row.steering_angle) for row in plan.rows]
    for cell, rate, unit, rate_unit in (
        (0, car.acceleration, "m/s", "m/s^2"),
        (1, car.steering_rate, "rad", "rad/s"),
    ):
        ramps = [
            ((step.speed, step.steering_angle)[cell], target[cell])
            for step, target in zip(steps, targets)
        ]
        needed = [abs(target - begin) / rate for begin, target in ramps]
        lasts = [row.duration / NANOSECONDS for row in plan.rows]
        for first, last in _runs([n > s * (1.0 + _ROUNDING) for n, s in zip(needed, lasts)]):
            begin, target = ramps[first]
            text = (
                f"{_named(plan, first, last)} {'is' if first == last else 'are'} too short: the "
                f"{car_name} needs {needed[first]:.3g} s from {begin:.3g} to {target:.3g} {unit} "
                f"at {rate:g} {rate_unit}, and line {plan.rows[first].line} lasts "
                f"{lasts[first]:.3g} s"
            )
            yield plan.fault(first, cell, text)


def _runs(is_bad: Sequence[bool]) -> Iterator[Tuple[int, int]]:
    """Yield the first and the last index of each run of true values."""
    for bad, run in itertools.groupby(range(len(is_bad)), key=is_bad.__getitem__):
        if bad:
            indices = list(run)
            yield indices[0], indices[-1]


def _named(plan: Plan, first: int, last: int) -> str:
    """Return the lines of rows in the file; these numbers are also in the place of a fault."""
    begin, end = plan.rows[first].line, plan.rows[last].line
    return f"line {begin}" if first == last else f"lines {begin} to {end}"


def _asks(plan: Plan, first: int, last: int, cell: int) -> str:
    """Return the text for the speeds or the steering angles that rows, counted from 0, ask for."""
    values = [row[:2][cell] for row in plan.rows[first : last + 1]]
    span = sorted({min(values), max(values)}, key=abs)
    shown = " to ".join(f"{each:.6g}" for each in span)
    unit = ("m/s", "rad")[cell]
    return f"{_named(plan, first, last)} {'asks' if first == last else 'ask'} for {shown} {unit}"
