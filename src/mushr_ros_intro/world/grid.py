"""Occupancy grids."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mushr_ros_intro.car.bicycle import ORIGIN, Pose, compose, inverse

UNKNOWN = -1
"""The value of a cell that nobody knows anything about."""

OCCUPIED_ABOVE = 50
"""A cell is a wall, to the laser and to the car's body, if its value is greater than this.

So what is unknown is no wall, and neither is what is off the map.
"""

LEAST_RESOLUTION, MOST_RESOLUTION = 1e-4, 1e3
"""The smallest and the largest side of a cell [m]."""


@dataclass(frozen=True, eq=False)
class Grid:
    """A map of square cells that stands somewhere in the map frame; nothing in it changes."""

    cells: np.ndarray
    """int8, (height, width): -1 unknown, 0 free to 100 occupied; row 0 is at the bottom."""
    resolution: float
    """Side of a cell [m]."""
    origin: Pose = ORIGIN
    """The lower left corner of cell (0, 0) in the map frame; rows run along its x axis."""

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.int8 or not self.cells.size:
            raise ValueError(
                f"cells are {self.cells.dtype} of shape {self.cells.shape}; "
                "expected int8 of shape (height, width), at least one"
            )
        if not LEAST_RESOLUTION <= self.resolution <= MOST_RESOLUTION:
            raise ValueError(
                f"resolution is {self.resolution!r}; expected a number from "
                f"{LEAST_RESOLUTION:g} to {MOST_RESOLUTION:g} m"
            )
        if not all(map(math.isfinite, self.origin)):
            raise ValueError(f"origin is {tuple(self.origin)}; expected finite numbers")
        if self.cells.flags.writeable:  # then somebody else could write to it
            own = self.cells.copy()
            own.flags.writeable = False
            object.__setattr__(self, "cells", own)

    @property
    def height(self) -> int:
        """How many rows of cells there are."""
        return self.cells.shape[0]

    @property
    def width(self) -> int:
        """How many columns of cells there are."""
        return self.cells.shape[1]

    @cached_property
    def occupied(self) -> np.ndarray:
        """Say of each cell whether it is a wall: bool, (height, width)."""
        return self.cells > OCCUPIED_ABOVE

    @cached_property
    def _grid_from_map(self) -> Pose:
        """The map frame's origin, as the grid's own frame has it."""
        return inverse(self.origin)

    def to_grid(self, pose: Pose) -> Pose:
        """Express a pose of the map frame in the grid's own frame.

        There cell (row, column) reaches from column * resolution to (column + 1) * resolution in
        x [m], and likewise in y with its row.
        """
        return compose(self._grid_from_map, pose)


def as_travelled(resolution: float) -> float:
    """Return a resolution [m] as it arrives over a topic, whose field is a float32.

    Of all numbers that round to that float32 it is the one with the fewest digits, so that 0.1
    stays 0.1 and a map is the same to the last digit for who reads the file and who subscribes.
    """
    return float(str(np.float32(resolution)))
