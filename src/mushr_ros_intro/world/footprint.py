"""Collisions between the car's body and the walls of a map.

The body is a rectangle, and the walls are the occupied cells of a grid. Unknown cells are free, and
so is the area outside the map.
"""

import math
from typing import Callable, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.world.grid import Grid

TOUCH = 1e-9
"""The body hits a wall if it overlaps it by more than this [m]; touching is not hitting."""

_STEP = 0.005  # [m] between two samples of a path; half a cell if that is less
_AT_ONCE = 64  # samples that are tested together


class Footprint(NamedTuple):
    """The rectangle that the car covers, in the frame base_footprint (middle of the rear axle).

    The defaults are our choice for MuSHR's model, with a wheelbase of 0.2965 m, a track of 0.23 m
    and a wheel radius of 0.0488 m: the body ends just behind the rear wheels, has a bumper in front
    of the front wheels, and is as wide as the outer sides of the tyres.
    """

    front: float = 0.38
    """Distance from the rear axle to the front end [m]."""
    back: float = 0.06
    """Distance from the rear axle to the rear end [m]."""
    half_width: float = 0.135
    """Distance from the middle to each side [m]."""


BODY = Footprint()
"""The car's body."""

POINT = Footprint(1e-6, 1e-6, 1e-6)
"""The rear axle alone, as in MuSHR's simulator. A point without size can be between two cells."""


class World(NamedTuple):
    """The obstacles, and the shape of the car among them."""

    grid: Grid
    """The map."""
    footprint: Footprint = Footprint()
    """The car's body."""


def is_free(grid: Grid, footprint: Footprint, pose: Pose) -> bool:
    """Return whether the car at `pose` [map frame] overlaps no occupied cell; it may touch some.

    The test is exact: a rectangle and a cell overlap unless one of the four directions of their
    sides separates them (the separating axis theorem for convex shapes).
    """
    local = grid.to_grid(pose)
    cells = _occupied(grid, *_bounds(footprint, local))
    return not len(cells) or not _hits(cells, grid.resolution, footprint, [local])[0]


def on_map(grid: Grid, footprint: Footprint, pose: Pose) -> bool:
    """Return whether the whole body of the car at `pose` [map frame] is on the map."""
    x, y, half_x, half_y = _bounds(footprint, grid.to_grid(pose))
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    return (
        half_x - TOUCH <= x <= width - half_x + TOUCH
        and half_y - TOUCH <= y <= height - half_y + TOUCH
    )


Path = Callable[[float], Pose]
"""The pose of base_footprint [map frame] at a distance [m] from the start of a path.

The pose must not move further than the distance grows.
"""


def free_distance(grid: Grid, footprint: Footprint, path: Path, length: float) -> float:
    """Return how far along a path the car can drive before it hits a wall.

    The path is sampled every few millimetres, and the first hit is located to 1e-9 m, so the pose
    at the returned distance is free. A wall that the body enters and leaves between two samples is
    missed. In a bend, this can be the corner of a cell, by a millimetre or two.

    A car that starts inside a wall can drive on. From the first free sample on, walls stop it.

    Returns:
        A distance from 0 to `length` [m]; `length` itself if no wall is in the way.
    """
    step = min(0.5 * grid.resolution, _STEP)
    last = math.ceil(length / step)

    def sample(number: int) -> Pose:
        return path(min(number * step, length))

    radius = math.hypot(max(footprint.front, footprint.back), footprint.half_width)
    radius += _AT_ONCE * step
    first = next((n for n in range(last + 1) if is_free(grid, footprint, sample(n))), last)
    for low in range(first, last, _AT_ONCE):
        here = grid.to_grid(sample(low))
        cells = _occupied(grid, here.x, here.y, radius, radius)
        if len(cells):
            numbers = range(low + 1, min(low + _AT_ONCE, last) + 1)
            poses = [grid.to_grid(sample(number)) for number in numbers]
            hits = _hits(cells, grid.resolution, footprint, poses)
            if hits.any():
                hit = numbers[hits.argmax()]
                break
    else:
        return length
    free, blocked = (hit - 1) * step, min(hit * step, length)
    while blocked - free > TOUCH:
        middle = 0.5 * (free + blocked)
        if is_free(grid, footprint, path(middle)):
            free = middle
        else:
            blocked = middle
    return free


def _bounds(footprint: Footprint, local: Pose) -> Tuple[float, float, float, float]:
    """Return centre and half sizes [m] of the car's axis-aligned bounding box, grid frame."""
    cos, sin = math.cos(local.theta), math.sin(local.theta)
    ahead = 0.5 * (footprint.front - footprint.back)
    half_length = 0.5 * (footprint.front + footprint.back)
    half_x = half_length * abs(cos) + footprint.half_width * abs(sin)
    half_y = half_length * abs(sin) + footprint.half_width * abs(cos)
    return local.x + ahead * cos, local.y + ahead * sin, half_x, half_y


def _occupied(grid: Grid, x: float, y: float, half_x: float, half_y: float) -> np.ndarray:
    """Return the centres (N, 2) of the occupied cells in a box, like `_bounds` [m, grid frame]."""
    left_bottom, right_top = np.array([[x - half_x, y - half_y], [x + half_x, y + half_y]])
    low = np.maximum(np.floor(left_bottom / grid.resolution), 0).astype(int)
    high = np.maximum(np.ceil(right_top / grid.resolution), 0).astype(int)
    cells = np.argwhere(grid.occupied[low[1] : high[1], low[0] : high[0]])
    return (cells[:, ::-1] + low + 0.5) * grid.resolution


def _hits(
    cells: np.ndarray, side: float, footprint: Footprint, poses: Sequence[Pose]
) -> np.ndarray:
    """Return for each of P poses whether the car overlaps a cell, (P,).

    Args:
        cells: centres of the cells [m, grid frame], (N, 2).
        side: side of a cell [m].
        footprint: the car's body.
        poses: poses of the car in the grid frame.
    """
    boxes = np.array(
        [_bounds(footprint, pose) + (math.cos(pose.theta), math.sin(pose.theta)) for pose in poses]
    )
    x, y, half_x, half_y, cos, sin = boxes.T[..., np.newaxis]
    half_length = 0.5 * (footprint.front + footprint.back)
    half_cell = 0.5 * side - TOUCH
    slanted = 0.5 * side * (np.abs(cos) + np.abs(sin)) - TOUCH
    dx, dy = cells[:, 0] - x, cells[:, 1] - y
    hit = np.abs(dx) < half_x + half_cell
    hit &= np.abs(dy) < half_y + half_cell
    hit &= np.abs(cos * dx + sin * dy) < half_length + slanted
    hit &= np.abs(cos * dy - sin * dx) < footprint.half_width + slanted
    return hit.any(axis=1)
