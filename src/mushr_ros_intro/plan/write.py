"""Write plan files."""

import itertools
import os
from typing import Sequence

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.model import PlanError, Row, shortest_decimal
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.sim.stamps import NANOSECONDS


class WriteError(UserError):
    """A plan that cannot be written; the message names the file and the reason."""


def write_plan(folder: str, name: str, start: Sequence[float], rows: Sequence[Row]) -> str:
    """Write a plan to a new file.

    An existing file is not overwritten: the name of the new file gets a number. If writing fails,
    the incomplete file is removed. For `start` and `rows` see `plan_text`.

    Returns:
        The path of the file.

    Raises:
        WriteError: the file cannot be written, or `read_plan` would refuse it.
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

    The start pose and the durations are exact. Speeds and steering angles have as many digits as
    a float32 keeps.

    Args:
        start: x [m], y [m], theta [rad] in the map frame.
        rows: the commands; their lines and columns are ignored.
    """
    lines = ["# x [m], y [m], theta [rad]", ", ".join(repr(float(value)) for value in start)]
    lines.append("# speed [m/s], steering angle [rad], duration [s]")
    for row in rows:
        seconds, rest = divmod(row.duration, NANOSECONDS)
        duration = f"{seconds}.{rest:09d}".rstrip("0") + ("" if rest else "0")
        speed, angle = shortest_decimal(row.speed), shortest_decimal(row.steering_angle)
        lines.append(f"{speed!r}, {angle!r}, {duration}")
    return "\n".join(lines) + "\n"
