"""The values of a plan: a start pose and rows of commands."""

import os
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.stamps import NANOSECONDS

MAX_DURATION = 1_000_000_000 * NANOSECONDS
"""Longer plans are refused [ns]: stamps must fit into ROS's 32 bits of seconds."""

MAX_SPEED = 1e3
"""Higher speeds are refused [m/s], because they are mistakes."""

MAX_STEERING_ANGLE = 1.57
"""The largest steering angle [rad]; at a right angle a bicycle would turn on the spot."""


class Row(NamedTuple):
    """One command of a plan and its duration.

    Speed and steering angle are rounded by `as_float32`, so a row holds exactly what the car gets.
    """

    speed: float
    """Forward speed [m/s], negative in reverse."""
    steering_angle: float
    """Steering angle of the virtual middle front wheel [rad], left positive."""
    duration: int
    """Duration of the command [ns]."""
    line: int = 0
    """Line in the file, counted from 1; 0 if the row comes from no file."""
    columns: Tuple[int, ...] = (1, 1)
    """Columns of speed, steering angle and, if it is written, duration, counted from 1."""


class Plan(NamedTuple):
    """A start pose and the commands that follow it."""

    path: str
    """The file that it was read from."""
    start: Pose
    """Start pose in the map frame."""
    rows: Tuple[Row, ...]
    start_line: int = 0
    """Line of the start pose in the file, counted from 1; 0 if the plan comes from no file."""
    start_columns: Tuple[int, ...] = (1, 1, 1)
    """Columns of its x, y and theta, counted from 1."""

    @property
    def name(self) -> str:
        """The name of the file without its ending."""
        return os.path.splitext(os.path.basename(self.path))[0]

    @property
    def duration(self) -> int:
        """Duration of the whole plan [ns]."""
        return sum(row.duration for row in self.rows)

    def fault(self, row: int, cell: int, text: str) -> "Fault":
        """Return a fault of one number of the plan.

        Args:
            row: index of the row; -1 is the start pose, and rows beyond the last one are the last.
            cell: index of the number in the row.
            text: description of the fault.
        """
        if row < 0:
            return Fault(self.path, self.start_line, self.start_columns[cell], text)
        where = self.rows[min(row, len(self.rows) - 1)]
        return Fault(self.path, where.line, where.columns[cell], text)


class Fault(NamedTuple):
    """One fault of a plan file."""

    path: str
    line: int
    """0 if the fault concerns the whole file."""
    column: int
    text: str

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        return f"{place}: {self.text}"


def fault_lines(faults: Sequence[Fault]) -> List[str]:
    """Return the first 20 faults as lines of text, and the number of the others."""
    more = [f"... and {len(faults) - 20} more faults"] if len(faults) > 20 else []
    return [*map(str, faults[:20]), *more]


class PlanError(UserError):
    """A plan file that cannot be driven, with all its faults in ``faults``."""

    def __init__(self, faults: Sequence[Fault]):
        self.faults = tuple(faults)
        super().__init__("\n".join(fault_lines(faults)))


def as_float32(value: float) -> float:
    """Return `value` rounded to float32, the type of every field of an AckermannDrive."""
    return float(np.float32(value))


def shortest_decimal(value: float) -> float:
    """Return the number with the fewest digits that `as_float32` rounds to the same value.

    It is the number to show: 0.09 for 0.09000000357627869, and 0 for -0.
    """
    return float(str(np.float32(value))) + 0.0
