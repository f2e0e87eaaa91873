"""Describe what makes a drive differ from its prediction, as text and as JSON."""

import math
from typing import Any, Dict, Iterator, List

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.comparison import Comparison
from mushr_ros_intro.comparison.fit import (
    DEAD,
    OF_CAR,
    RATES,
    Combined,
    Fit,
    Value,
)
from mushr_ros_intro.comparison.hypotheses import PARAMETERS, Number
from mushr_ros_intro.plan.plan import shortest_decimal
from mushr_ros_intro.preview.text import SHOWN_ROWS
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted

_SHARE = 0.05
"""A fitted parameter is named if it explains this share of the error."""

_NO_NOISE = 1e-3
"""Smaller random errors of the positions are not those of a localisation [m]."""


def sentence(found: Comparison, fit: Fit) -> str:
    """Return what makes a drive differ from its prediction, and what to do.

    Args:
        found: the drive beside the prediction.
        fit: to the drive.
    """
    if fit.moves_before:
        return (
            "the car moves already before its first command, so commands are missing; expected a "
            "recording of the commands that begins before the drive"
        )
    if not fit.is_explained:
        misfit, log = fit.misfit, found.log
        return (
            f"nothing known explains this drive: {log.unit} {log.number(misfit.row)} "
            f"({misfit.what}) is {misfit.size:.1f} standard errors away from the best fit. Perhaps "
            "the tyres slip, the car touches something, or the poses are wrong"
        )
    texts = [_change(name, fit, found) for name in _names(fit)]
    texts += [" or ".join(each.text for each in (cause, *cause.as_good)) for cause in fit.causes]
    rest = [f"the delay from a command to its effect is {fit.delay:.3f} s"]
    if not fit.values["delay"].is_fitted:
        rest = ["the drive does not determine the delay"]
    unknown = [name for name, value in fit.values.items() if not value.is_fitted]
    unknown = [name for name in unknown if name != "delay"]
    if unknown:
        rest.append(f"the drive does not determine {' and '.join(unknown)}")
    if not texts:
        text = (
            f"the drive is {fit.profile_error:.3f} m (rms) from the prediction, and no known cause "
            "explains more than random errors"
        )
        return "; ".join([text, *rest])
    *most, last = texts
    joined = f"{', '.join(most)} and {last}" if most else last
    text = (
        f"the car {joined}; a prediction with this car is {fit.path_error:.3f} m (rms) from the "
        f"drive, instead of {fit.profile_error:.3f} m"
    )
    return "; ".join([text, *_advice(fit), *rest])


def _names(fit: Fit) -> List[str]:
    """Return the changed parameters that explain the error, the most important one first."""
    least = _SHARE * fit.profile_error
    effects = sorted(((size, name) for name, size in fit.effects.items()), reverse=True)
    return [name for size, name in effects if size > least or name in fit.uncertain]


def _advice(fit: Fit) -> Iterator[str]:
    """Yield what to do about the causes."""
    for cause in fit.causes:
        yield f"to mend it: {cause.fault.remedy}"
        if cause.as_good:
            tests = {each.fault.test for each in (cause, *cause.as_good)}
            yield f"to tell them apart: {', or '.join(sorted(tests))}"
    if fit.uncertain:
        yield (
            f"{' and '.join(fit.uncertain)} may also be a limit of the car; to tell them apart: "
            "drive plans/identification.txt, which has several speeds and steering angles"
        )


def _change(name: str, fit: Fit, found: Comparison) -> str:
    """Return the text of one changed parameter."""
    before, now = getattr(found.car, name), getattr(fit.car, name)
    of = "predicted" if found.limited_rows or before != getattr(Car(), name) else "commanded"
    if name == "steering_offset":
        return f"steers {abs(now - before):.3f} rad to the {'left' if now > before else 'right'}"
    if name in RATES:
        what = "changes its speed" if name == "acceleration" else "turns its front wheels"
        unit = next(each.unit for each in PARAMETERS if each.name == name)
        after, then = (
            "at once" if math.isinf(each) else f"at {each:.3g} {unit}" for each in (now, before)
        )
        return f"{what} {after} and not {then}"
    is_speed = name == "speed_gain"
    if abs(now) < DEAD:
        return "hardly drives" if is_speed else "hardly steers: check the servo and its cable"
    if now < 0.0:
        if is_speed:
            return f"drives backwards (the motor is reversed) at {-now:.0%} of the speed {of}"
        return f"steers to the other side (the servo is reversed) by {-now:.0%} of the angle {of}"
    change = 100.0 * (now / before - 1.0)
    if is_speed:
        return f"is {abs(change):.1f} % {'faster' if change > 0.0 else 'slower'} than {of}"
    return f"steers {abs(change):.1f} % {'more' if change > 0.0 else 'less'} than {of}"


def as_text(found: Comparison, car_name: str) -> Iterator[str]:
    """Yield the lines of a comparison."""
    log = found.log
    begin = counted(found.standing, "pose") if found.standing else "no pose"
    yield (
        f"{log.name}: {counted(len(found.rows), 'row')}, "
        f"{counted(len(found.times), 'pose')} during the drive, {begin} before it; "
        f"predicted for the {car_name} car"
    )
    yield from (f"note: {note}" for note in log.notes)
    missing = len(log.plan.rows) - len(found.rows)
    if missing:
        yield f"note: the poses end too early for the last {counted(missing, 'row')}"
    if found.limited_rows:
        yield (
            f"note: {counted(len(found.limited_rows), 'row')}, the first is {log.unit} "
            f"{log.number(found.limited_rows[0])}, exceed the limits of the {car_name} car; "
            "predicted is what it does within its limits"
        )
    yield ""
    yield (
        f"{log.unit:>5}   speed steering     end  distance [m]    turn [rad]     driven to [m, rad]"
        "    error"
    )
    yield "          m/s      rad       s   plan driven    plan driven      x      y  theta      m"
    half = SHOWN_ROWS // 2
    for index, row in enumerate(found.rows):
        if not half <= index < len(found.rows) - half:
            x, y, theta = (round(value, 3) + 0.0 for value in row.driven)
            theta = math.remainder(theta, math.tau)
            yield (
                f"{log.number(index):5}{shortest_decimal(row.speed):8.2f}"
                f"{shortest_decimal(row.steering_angle):9.4f}{row.end:8.2f}"
                f"{row.distance[0]:7.3f}{row.distance[1]:7.3f}{row.turn[0]:8.3f}{row.turn[1]:7.3f}"
                f"{x:7.3f}{y:7.3f}{theta:7.3f}{row.error:7.3f}"
            )
        elif index == half:
            yield f"  ... {len(found.rows) - 2 * half} more rows ..."
    yield ""
    yield from errors_text(found)


def errors_text(found: Comparison) -> Iterator[str]:
    """Yield the lines on the errors of a comparison."""
    sizes, (along, across) = found.sizes, found.errors[-1].tolist()
    largest = int(np.argmax(sizes))
    predicted = found.predicted[-1]
    yield (
        f"largest error   {sizes[largest]:.3f} m, {found.times[largest]:.2f} s after the first "
        "command"
    )
    yield (
        f"final error     {sizes[-1]:.3f} m: {abs(along):.3f} m "
        f"{'too far' if along > 0.0 else 'short'}, {abs(across):.3f} m to the "
        f"{'left' if across > 0.0 else 'right'}; heading {found.final_turn:+.3f} rad"
    )
    yield (
        f"predicted end   x {predicted[0]:.3f} m, y {predicted[1]:.3f} m, "
        f"theta {math.remainder(predicted[2], math.tau):.3f} rad"
    )
    far = found.distances[-1]
    yield f"error (rms)     {found.rms:.3f} m over {far:.2f} m"


def fit_text(fit: Fit, car: Car) -> Iterator[str]:
    """Yield the lines of a fit; it has none if the drive is not explained."""
    if not fit.is_found:
        return
    yield "parameter            before     fitted   standard error   95 % range"
    for each in PARAMETERS:
        yield _value_line(each, getattr(car, each.name, 0.0), fit.values[each.name])
    yield "the delay contains the difference of the clocks, so it may be negative"
    if fit.misfit.is_found:
        yield (
            "note: the drive differs from the fitted car by more than random errors, so the true "
            "values may be outside of the 95 % ranges"
        )
    if fit.position_noise < _NO_NOISE:
        yield (
            "note: the poses have no random errors. If they come from wheel speeds or commands, "
            "as MuSHR's car_pose does, they cannot show a wrong gain: use a localisation that "
            "measures the car from outside, or on a map"
        )
    if not all(value.is_fitted for value in fit.values.values()):
        yield "plans/identification.txt drives so that all parameters can be fitted"


def combined_text(both: Combined, car: Car) -> Iterator[str]:
    """Yield the lines of the car that several drives were fitted to."""
    yield "mean of the drives   before     fitted   standard error   95 % range"
    for each in OF_CAR:
        yield _value_line(each, getattr(car, each.name), both.values[each.name])
    for name, spread in both.spreads.items():
        yield f"standard deviation between the drives: {name[:-7]} {spread:.4f}"


def _value_line(parameter: Number, before: float, value: Value) -> str:
    """Return the line of a parameter in the table."""
    begin = f"{parameter.name:17}{before:10.4g} "
    if value.is_fitted:
        shown = f"{value.low:.4f} to {value.high:.4f} {parameter.unit}"
        return f"{begin}{value.value:10.4f}{value.error:11.4f}         {shown}".rstrip()
    if value.confused_with:
        return (
            f"{begin}   unknown   this drive cannot tell it from {', '.join(value.confused_with)}"
        )
    return f"{begin}   unknown   this drive says too little about it"


def as_json(found: Comparison, fit: Fit, car_name: str) -> Dict[str, Any]:
    """Return a comparison as values for JSON; lengths in m, angles in rad, times in s.

    For the arguments see `sentence`. Without a known cause, there are no fitted values.
    """
    return {
        "result": sentence(found, fit),
        "is_explained": fit.is_found,
        "drive": found.log.name,
        "notes": list(found.log.notes),
        "car": car_name,
        "delay": found.delay,
        "duration": found.log.plan.duration / NANOSECONDS,
        "rows": [row._asdict() for row in found.rows],
        "time": found.times.tolist(),
        "predicted": found.predicted.tolist(),
        "driven": found.driven.tolist(),
        "distance": found.distances.tolist(),
        "error_along": found.errors[:, 0].tolist(),
        "error_across": found.errors[:, 1].tolist(),
        "largest_error": float(found.sizes.max()),
        "final_error": float(found.sizes[-1]),
        "rms_error": found.rms,
        "causes": [
            {"name": each.fault.number.name, "value": each.value, "text": each.text}
            for each in fit.causes
            if fit.is_found
        ],
        "fit": {
            name: {key: None if each == math.inf else each for key, each in value._asdict().items()}
            for name, value in fit.values.items()
            if fit.is_found
        },
    }
