"""Write plan files."""

from typing import Sequence

from mushr_ros_intro.plan.plan import Row, shortest_decimal
from mushr_ros_intro.stamps import NANOSECONDS


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
