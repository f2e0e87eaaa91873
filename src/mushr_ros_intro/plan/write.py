"""Write plan files."""

import itertools
import os
import struct
from typing import Sequence

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.model import PlanError, Row
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.sim.stamps import NANOSECONDS


class WriteError(UserError):
    """A plan that could not be written; says where and why."""


def write_plan(folder: str, name: str, start: Sequence[float], rows: Sequence[Row]) -> str:
    """Write a plan into a new file.

    No file is overwritten: where there is one of that name, the new one gets a number. Nothing
    stays of a file that cannot be written to its end.

    Args:
        folder: the folder that the file goes into.
        name: of the file.
        start: x [m], y [m], theta [rad] in the map frame.
        rows: the commands; the lines that they name do not matter.

    Returns:
        The path of the file.

    Raises:
        WriteError: it cannot be written, or read_plan would not take it.
    """
    data = plan_text(start, rows).encode()
    try:
        parse_plan(data, name)
    except PlanError as error:
        raise WriteError(f"this is no plan that can be driven: {error}") from None
    stem, ending = os.path.splitext(name)
    for number in itertools.count(1):
        path = os.path.join(folder, name if number == 1 else f"{stem}_{number}{ending}")
        try:
            with open(path, "xb") as file:
                try:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                except BaseException:
                    os.unlink(path)
                    raise
        except FileExistsError:
            continue
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise WriteError(f"{path} cannot be written ({reason})") from None
        return path
    raise AssertionError("there is always another number")


def plan_text(start: Sequence[float], rows: Sequence[Row]) -> str:
    """Return the text of a plan file.

    The start pose and the durations are exact. Speeds and steering angles have the digits that
    they keep as float32, as which they travel.

    Args:
        start: x [m], y [m], theta [rad] in the map frame.
        rows: the commands; the lines that they name do not matter.
    """
    lines = ["# x [m], y [m], theta [rad]", ", ".join(repr(float(value)) for value in start)]
    lines.append("# speed [m/s], steering angle [rad], duration [s]")
    for row in rows:
        seconds, rest = divmod(row.duration, NANOSECONDS)
        duration = f"{seconds}.{rest:09d}".rstrip("0") + ("" if rest else "0")
        lines.append(f"{_as_float32(row.speed)}, {_as_float32(row.steering_angle)}, {duration}")
    return "\n".join(lines) + "\n"


def _as_float32(value: float) -> str:
    """Return the shortest number that is the same as `value` when both travel as float32."""
    travelling = struct.pack("<f", value + 0.0)  # no negative zero
    (value,) = struct.unpack("<f", travelling)  # of which nine digits are enough
    texts = (f"{value:.{digits}g}" for digits in range(1, 10))
    return next(repr(float(t)) for t in texts if struct.pack("<f", float(t)) == travelling)
