"""Write the profile of a fitted car, and the parameters of MuSHR that correct the car instead."""

import math
import os
from typing import Iterator, Sequence

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import NUMBERS
from mushr_ros_intro.comparison.fit import Combined
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import REQUIRED, Parameters, number
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.yaml_file import read_mapping

_VESC = ("speed_to_erpm_gain", "steering_angle_to_servo_gain", "steering_angle_to_servo_offset")


def write_profile(path: str, combined: Combined, profile: str, drives: Sequence[str]) -> None:
    """Write a profile as in config/cars/, with the source of each number.

    Args:
        path: of the new file.
        combined: the fitted car.
        profile: the path of the profile before the fit.
        drives: the names of the drives.

    Raises:
        UserError: the file cannot be written.
    """
    try:
        with open(path, "w", encoding="utf-8") as file:
            file.write("\n".join(_lines(combined, os.path.basename(profile), drives)))
    except OSError as error:
        text = f"{path} cannot be written ({error.strerror}); expected the path of a new profile"
        raise UserError(f"--fit: {text}") from None


def _lines(combined: Combined, profile: str, drives: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a profile."""
    yield f"# Fitted by compare_drive.py to {', '.join(map(os.path.basename, drives))}."
    yield f"# The other numbers are those of {profile}."
    car = combined.car._asdict()
    for name, unit, low, high, meaning in NUMBERS:
        source = f"{profile}."
        value = combined.values.get(name)
        if name[: -len("_spread")] in combined.deviations:
            source = f"Standard deviation between {len(drives)} drives."
        elif value and not value.is_fitted:
            source = f"{profile}; the drives do not determine it."
        elif value:
            kept = "Fitted" if value.is_change else f"{profile}, which is in the fitted"
            source = "{}; 95 % range {:.5g} to {:.5g}.".format(kept, *value.limits)
        ends = f"{low:g} to {'.inf (none)' if math.isinf(high) else f'{high:g}'}"
        yield ""
        yield f"# {meaning[0].upper()}{meaning[1:]} [{unit or '1'}], {ends}."
        yield f"# {source}"
        yield f"{name}: {'.inf' if math.isinf(car[name]) else f'{car[name]:.5g}'}"
    yield ""
    yield f"# How long a command is valid after its stamp [s]; {profile}."
    yield f"command_timeout: {combined.car.command_timeout / NANOSECONDS:g}"
    yield ""


def vesc_text(car: Car, path: str) -> Iterator[str]:
    """Yield the lines on MuSHR's parameters that make the car drive as commanded.

    Args:
        car: the fitted car.
        path: MuSHR's vesc.yaml with the old values.

    Raises:
        UserError: the file cannot be read, or lacks a parameter.
    """
    if (car.speed_gain, car.steering_gain, car.steering_offset) == (1.0, 1.0, 0.0):
        yield "MuSHR's vesc.yaml needs no correction"
        return
    table = [number(name, REQUIRED, "", -1e9, 1e9) for name in _VESC]
    read = Parameters(read_mapping(path, "MuSHR's vesc.yaml"), f"{path}: ").read(table)
    speed, gain, offset = read.values()
    new_gain = gain / car.steering_gain
    numbers = (
        (speed, speed / car.speed_gain),
        (gain, new_gain),
        (offset, offset - car.steering_offset * new_gain),
    )
    yield "to correct the car, change MuSHR's vesc.yaml:        old        new"
    for name, (old, new) in zip(_VESC, numbers):
        yield f"  {name:42}{old:12.6g}{new:11.6g}"
