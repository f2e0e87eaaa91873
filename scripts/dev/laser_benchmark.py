"""Measure the speed of the laser, for scripts/dev/benchmark."""

import math
import time

import numpy as np

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.laser import Beams, Laser

_ROOM = 50  # side of a room in cells, of 1000 x 1000 cells of 0.1 m
_POSES = 2048


def rooms_and_clutter() -> Grid:
    """Return a map of 400 rooms of 5 m by 5 m, each with two doors and four obstacles."""
    dice = np.random.default_rng(1)
    walls = np.zeros((1000, 1000), bool)
    for each in range(0, 1000, _ROOM):
        walls[each : each + 2] = walls[:, each : each + 2] = True
    for row in range(0, 1000, _ROOM):
        for column in range(0, 1000, _ROOM):
            left, below = dice.integers(8, 25, 2)
            walls[row + left : row + left + 12, column : column + 2] = False
            walls[row : row + 2, column + below : column + below + 12] = False
            for y, x, height, width in dice.integers((3, 3, 1, 1), (44, 44, 6, 6), (4, 4)):
                walls[row + y : row + y + height, column + x : column + x + width] = True
    walls[:6] = walls[-6:] = walls[:, :6] = walls[:, -6:] = True
    return Grid(np.where(walls, 100, 0).astype(np.int8), 0.1)


def scans_per_second(seconds: float = 2.0) -> float:
    """Return the number of scans of 720 beams and 10 m per second and core.

    It is the median over rounds of 2048 free poses, after a first round to warm up.

    Args:
        seconds: CPU time of the measurement [s].
    """
    grid = rooms_and_clutter()
    dice = np.random.default_rng(2)
    free = np.argwhere(~grid.occupied)
    cells = free[dice.integers(len(free), size=_POSES)]
    places = (cells[:, ::-1] + dice.random((_POSES, 2))) * grid.resolution
    headings = dice.uniform(-math.pi, math.pi, _POSES)
    poses = [Pose(x, y, theta) for (x, y), theta in zip(places.tolist(), headings.tolist())]
    laser = Laser(grid, Beams(number=720, range_max=10.0))
    rates = []
    end = time.process_time() + seconds
    while len(rates) < 2 or time.process_time() < end:
        begin = time.process_time()
        for pose in poses:
            laser.scan(pose)
        rates.append(_POSES / (time.process_time() - begin))
    return float(np.median(rates[1:]))
