"""Ranges from poses to the walls of a map, with the names of the Python module range_libc.

A ray advances by the distance to the nearest wall until it hits one. The error is less than half a
cell. All classes of methods use this one algorithm, so they differ in name only.
"""

import math

import numpy as np
from scipy import ndimage

_OCCUPIED = 10
"""A cell is a wall if its value is larger; unknown cells are free."""

_SHORTEST_STEP = 0.5
"""[cells]"""


class PyOMap:
    """The walls of a nav_msgs/OccupancyGrid."""

    def __init__(self, msg):
        info = msg.info
        cells = np.array(msg.data, np.int8).reshape(info.height, info.width)
        walls = np.pad(cells > _OCCUPIED, 1)
        self.resolution = info.resolution
        half = math.atan2(info.origin.orientation.z, info.origin.orientation.w)
        self.origin = info.origin.position.x, info.origin.position.y, 2.0 * half
        # From the middle of a cell to the middle of the nearest wall [cells]; no wall: very far.
        there_is_none = not walls.any()
        self.distances = (
            np.full(walls.shape, 1e6) if there_is_none else ndimage.distance_transform_edt(~walls)
        ).astype(np.float32)

    def width(self):
        """Return the number of columns."""
        return self.distances.shape[1] - 2

    def height(self):
        """Return the number of rows."""
        return self.distances.shape[0] - 2

    def isOccupied(self, x, y):  # noqa: N802
        """Return whether the cell in this column and row is a wall."""
        return bool(self.distances[y + 1, x + 1] == 0.0)


class PyRayMarching:
    """Casts rays in a map, up to `max_range` [cells]."""

    def __init__(self, omap, max_range, theta_discretization=0):
        self._map = omap
        self._max_range = float(max_range)
        self._table = None

    def calc_range(self, x, y, theta):
        """Return the range from one pose [m, m, rad] in metres."""
        return float(self._cast(np.array([[x, y, theta]]), np.zeros(1))[0])

    def calc_range_many(self, poses, ranges):
        """Write the range [m] of each pose, (N, 3), to `ranges`, (N,)."""
        ranges[:] = self._cast(poses, np.zeros(1))

    calc_range_np = calc_range_many

    def calc_range_repeat_angles(self, poses, angles, ranges):
        """Write the ranges [m] of N poses in M directions to `ranges`, (N * M,)."""
        ranges[:] = self._cast(poses, angles)

    def set_sensor_model(self, table):
        """Set the probabilities of a measured range (row) for an expected one (column) [cells]."""
        self._table = np.array(table, float)

    def eval_sensor_model(self, measured, expected, weights, rays, poses):
        """Write the weight of each pose: the product of the probabilities of its rays."""
        last = np.array(self._table.shape) - 1
        scale = 1.0 / self._map.resolution
        rows = np.clip(np.asarray(measured[:rays]) * scale, 0, last[0]).astype(int)
        columns = np.clip(np.asarray(expected[: poses * rays]) * scale, 0, last[1]).astype(int)
        weights[:poses] = self._table[rows, columns.reshape(poses, rays)].prod(axis=1)

    def _cast(self, poses, angles):
        """Return the ranges [m], (N * M,)."""
        left, bottom, turn = self._map.origin
        poses = np.asarray(poses, float)
        dx, dy = poses[:, 0] - left, poses[:, 1] - bottom
        scale = 1.0 / self._map.resolution
        # In cells, in the frame of the map with its border of one cell.
        x = (math.cos(turn) * dx + math.sin(turn) * dy) * scale + 1.0
        y = (math.cos(turn) * dy - math.sin(turn) * dx) * scale + 1.0
        directions = (poses[:, 2:] - turn + np.asarray(angles, float)).ravel()
        cos, sin = np.cos(directions, dtype=np.float32), np.sin(directions, dtype=np.float32)
        x, y = (np.repeat(each, len(angles)).astype(np.float32) for each in (x, y))
        rows, columns = self._map.distances.shape
        distances = self._map.distances.ravel()
        ranges = np.full(len(x), self._max_range, np.float32)
        rays, along = np.arange(len(x)), np.zeros(len(x), np.float32)
        while len(rays):
            column = np.floor(x + along * cos).astype(np.int32)
            row = np.floor(y + along * sin).astype(np.int32)
            is_inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            free = distances[np.where(is_inside, row * columns + column, 0)]
            has_hit = is_inside & (free == 0.0)
            ranges[rays[has_hit]] = along[has_hit]
            # Neither end of `free` is at the ray: each can be half a diagonal of a cell away.
            along = along + np.maximum(free - 1.5, _SHORTEST_STEP)
            goes_on = is_inside & ~has_hit & (along < self._max_range)
            rays, along, x, y, cos, sin = (each[goes_on] for each in (rays, along, x, y, cos, sin))
        return np.minimum(ranges, self._max_range) * self._map.resolution


class PyBresenhamsLine(PyRayMarching):
    """See PyRayMarching."""


class PyRayMarchingGPU(PyRayMarching):
    """See PyRayMarching."""


class PyCDDTCast(PyRayMarching):
    """See PyRayMarching."""

    def prune(self, max_range=0.0):
        """Do nothing; the original needs less memory afterwards."""


class PyGiantLUTCast(PyRayMarching):
    """See PyRayMarching."""
