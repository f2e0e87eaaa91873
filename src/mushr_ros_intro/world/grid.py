"""Occupancy grids."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mushr_ros_intro.geometry import ORIGIN, Pose, compose, inverse

UNKNOWN = -1
"""The value of an unknown cell."""

OCCUPIED_ABOVE = 50
"""A cell with a greater value is a wall, to the laser and to the car's body.

So unknown cells are free, and so is the area outside the map.
"""

MIN_RESOLUTION, MAX_RESOLUTION = 1e-4, 1e3
"""The smallest and the largest side of a cell [m]."""


@dataclass(frozen=True, eq=False)
class Grid:
    """An immutable map of square cells in the map frame.

    Raises:
        ValueError: there are no cells, or the resolution is out of range.
    """

    cells: np.ndarray
    """int8, (height, width): -1 unknown, 0 free to 100 occupied; row 0 is at the bottom."""
    resolution: float
    """Side of a cell [m]."""
    origin: Pose = ORIGIN
    """The lower left corner of cell (0, 0) in the map frame; rows are parallel to its x axis."""

    def __post_init__(self) -> None:
        if not self.cells.size:
            raise ValueError(f"cells are of shape {self.cells.shape}; expected at least one")
        if not MIN_RESOLUTION <= self.resolution <= MAX_RESOLUTION:
            raise ValueError(
                f"resolution is {self.resolution!r}; expected a number from "
                f"{MIN_RESOLUTION:g} to {MAX_RESOLUTION:g} m"
            )
        own = self.cells.copy()  # the caller may change the original
        own.flags.writeable = False
        object.__setattr__(self, "cells", own)

    @property
    def height(self) -> int:
        """The number of rows."""
        return self.cells.shape[0]

    @property
    def width(self) -> int:
        """The number of columns."""
        return self.cells.shape[1]

    @cached_property
    def occupied(self) -> np.ndarray:
        """Whether each cell is a wall: bool, (height, width)."""
        return self.cells > OCCUPIED_ABOVE

    @cached_property
    def _grid_from_map(self) -> Pose:
        """The origin of the map frame in the grid frame."""
        return inverse(self.origin)

    def to_grid(self, pose: Pose) -> Pose:
        """Transform a pose from the map frame to the grid frame.

        In the grid frame, cell (row, column) extends from column * resolution to
        (column + 1) * resolution in x [m], and in the same way in y with its row.
        """
        return compose(self._grid_from_map, pose)


def as_travelled(resolution: float) -> float:
    """Return a resolution [m] as a subscriber receives it: the message field is a float32.

    The result is the shortest decimal number that rounds to that float32. So 0.1 stays 0.1, and a
    map has the same resolution in a program that reads its file and in one that subscribes to it.
    """
    return float(str(np.float32(resolution)))
