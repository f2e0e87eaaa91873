"""Describe what makes a drive differ from its prediction."""

import math
from typing import Dict, Iterator

import numpy as np

from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.faults import PARAMETERS
from mushr_ros_intro.comparison.fit import DEAD, Combined, Fit, Value
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted

_NO_NOISE = 1e-3
"""Smaller random errors of the positions are not those of a localisation [m]."""

_UNITS = {each.name: each.unit for each in PARAMETERS}


def sentence(log: DriveLog, fit: Fit) -> str:
    """Return what makes a drive differ from its prediction, and what to do."""
    if fit.moves_before:
        return (
            "the car moves already before its first command, so commands are missing; expected a "
            "recording of the commands that begins before the drive"
        )
    if fit.misfit.is_found:
        misfit = fit.misfit
        before, rows = log.plan.rows[: misfit.row], log.plan.rows[misfit.row :]
        begin = sum(each.duration for each in before) / NANOSECONDS
        when = f"{rows[0].speed:.3g} m/s, {rows[0].steering_angle:.3g} rad" if rows else "the end"
        return (
            f"nothing known explains this drive: from {begin:.1f} s on ({when}), the {misfit.what} "
            f"is {misfit.size:.1f} standard errors away from the best fit. Perhaps the tyres slip, "
            "the car touches something, or the poses are wrong"
        )
    of_car = [value for name, value in fit.values.items() if name != "delay"]
    texts = [_change(value) for value in of_car if value.is_change]
    texts += [" or ".join(each.text for each in (cause, *cause.as_good)) for cause in fit.causes]
    if texts:
        *most, last = texts
        joined = f"{', '.join(most)} and {last}" if most else last
        text = (
            f"the car {joined}; a prediction with this car is {fit.path_error:.3f} m (rms) from "
            f"the drive, instead of {fit.profile_error:.3f} m"
        )
    else:
        text = (
            f"the drive is {fit.profile_error:.3f} m (rms) from the prediction, and no known cause "
            "explains more than random errors"
        )
    return "; ".join([text, *_advice(fit)])


def _advice(fit: Fit) -> Iterator[str]:
    """Yield what to do about the causes, the delay, and what is not known."""
    for cause in fit.causes:
        yield f"to mend it: {cause.fault.remedy}"
    if fit.uncertain:
        yield f"{' and '.join(fit.uncertain)} may also be a limit of the car"
    if fit.uncertain or any(each.as_good for each in fit.causes):
        yield (
            "to tell them apart: drive longer, at several speeds, with small and large steering "
            "angles to both sides, as in plans/identification.txt"
        )
    if fit.values["delay"].is_fitted:
        yield f"the delay from a command to its effect is {fit.delay:.3f} s"
    unknown = [name for name, value in fit.values.items() if not value.is_fitted]
    if unknown:
        names = " and ".join(unknown)
        yield f"the drive does not determine {names}; plans/identification.txt is made for this"


def _change(value: Value) -> str:
    """Return the text of one changed value."""
    name, before, now = value.name, value.old, value.new
    if name == "steering_offset":
        return f"steers {abs(now - before):.3f} rad to the {'left' if now > before else 'right'}"
    if name in ("acceleration", "steering_rate"):
        what = "changes its speed" if name == "acceleration" else "turns its front wheels"
        after, then = (
            "at once" if math.isinf(each) else f"at {each:.3g} {_UNITS[name]}"
            for each in (now, before)
        )
        return f"{what} {after} and not {then}"
    is_speed = name == "speed_gain"
    if abs(now) < DEAD:
        what, part = ("drives", "motor") if is_speed else ("steers", "servo")
        return f"hardly {what} at these commands: check the {part} and its cable"
    if now < 0.0:
        if is_speed:
            return f"drives backwards (the motor is reversed) at {-now:.0%} of the speed commanded"
        return f"steers to the other side (the servo is reversed) by {-now:.0%} of the angle"
    change = 100.0 * (now / before - 1.0)
    if is_speed:
        return f"is {abs(change):.1f} % {'faster' if change > 0.0 else 'slower'} than predicted"
    return f"steers {abs(change):.1f} % {'more' if change > 0.0 else 'less'} than predicted"


def comparison_text(log: DriveLog, found: Drive, car_name: str) -> Iterator[str]:
    """Yield the lines of a comparison."""
    yield (
        f"{log.name}: {counted(len(log.plan.rows), 'row')} of commands, "
        f"{counted(len(found.times), 'pose')} during the drive; predicted for the {car_name} car"
    )
    yield from (f"note: {note}" for note in log.notes)
    largest = int(np.argmax(found.distances))
    yield (
        f"largest error   {found.distances[largest]:.3f} m, {found.times[largest]:.2f} s after the "
        "first command"
    )
    for name, pose in (("predicted end", found.predicted[-1]), ("driven end", found.driven[-1])):
        x, y, theta = pose.tolist()
        theta = math.remainder(theta, math.tau)
        yield f"{name:15} x {x:.3f} m, y {y:.3f} m, theta {theta:.3f} rad"
    yield f"final error     {found.distances[-1]:.3f} m"


def fit_text(fit: Fit) -> Iterator[str]:
    """Yield the lines of a fit; it has none if the drive is not explained."""
    if not fit.is_found:
        return
    yield from _table("parameter", fit.values)
    yield "the delay contains the difference of the clocks, so it may be negative"
    if fit.position_noise < _NO_NOISE:
        yield (
            "note: the poses have no random errors. If they come from wheel speeds or commands, "
            "as MuSHR's car_pose does, they cannot show a wrong gain: use a localisation that "
            "measures the car from outside, or on a map"
        )


def combined_text(both: Combined) -> Iterator[str]:
    """Yield the lines of the car that several drives were fitted to."""
    yield from _table("mean of the drives", both.values)
    for name, deviation in both.deviations.items():
        inverse = "1 / " if name in ("acceleration", "steering_rate") else ""
        yield f"standard deviation between the drives: {inverse}{name} {deviation:.4f}"


def _table(title: str, values: Dict[str, Value]) -> Iterator[str]:
    """Yield a table of values."""
    yield f"{title:19}before    fitted   95 % range"
    for name, value in values.items():
        shown = f"{name:16}{value.old:9.4g}   unknown   this drive says too little about it"
        if value.is_fitted:
            low, high = value.limits
            shown = f"{name:16}{value.old:9.4g}{value.new:10.4f}   {low:.4f} to {high:.4f}"
        yield f"{shown} {_UNITS[name]}".rstrip() if value.is_fitted else shown
