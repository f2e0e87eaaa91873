"""The values that a plan file stands for: a start pose and rows of commands."""

from typing import NamedTuple, Sequence, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.sim.stamps import NANOSECONDS

MAX_DURATION = 1_000_000_000 * NANOSECONDS
"""A plan beyond this duration [ns] is refused: stamps must fit into ROS's 32 bits of seconds."""

MAX_COORDINATE = 1e6
"""A start pose beyond this [m, rad] is refused: nobody means it, and it would cost digits."""

MAX_SPEED = 1e3
"""A speed beyond this [m/s] is refused, for the same reason."""

MAX_STEERING_ANGLE = 1.57
"""The largest steering angle [rad]; at a right angle a bicycle would turn on the spot."""


class Row(NamedTuple):
    """One command of a plan and how long it lasts."""

    speed: float
    """Forward speed [m/s], negative in reverse."""
    steering_angle: float
    """Steering angle of the virtual middle front wheel [rad], left positive."""
    duration: int
    """How long the command lasts [ns]."""
    line: int
    """Where it stands in the file, counted from 1."""


class Plan(NamedTuple):
    """A start pose and the commands that follow it."""

    path: str
    """The file that it was read from."""
    start: Tuple[float, float, float]
    """x [m], y [m], theta [rad] in the map frame."""
    rows: Tuple[Row, ...]

    @property
    def duration(self) -> int:
        """How long the whole plan lasts [ns]."""
        return sum(row.duration for row in self.rows)


class Fault(NamedTuple):
    """One thing that is wrong with a plan file."""

    path: str
    line: int
    column: int
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}: {self.text}"


class PlanError(UserError):
    """A plan file that cannot be driven, with all that is wrong with it in ``faults``."""

    SHOWN = 20

    def __init__(self, faults: Sequence[Fault]):
        self.faults = tuple(faults)
        lines = [str(fault) for fault in self.faults[: self.SHOWN]]
        if len(self.faults) > self.SHOWN:
            lines.append(f"... and {len(self.faults) - self.SHOWN} more faults")
        super().__init__("\n".join(lines))
