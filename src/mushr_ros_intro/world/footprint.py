"""Collisions between the car's body and the walls of a map.

The body is a rectangle, and the walls are the occupied cells of a grid. Unknown cells are free, and
so is the area outside the map.
"""

import math
from typing import Callable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.world.grid import Grid

TOUCH = 1e-9
"""The body hits a wall if it overlaps it by more than this [m]; touching is not hitting."""

_STEP = 0.005  # [m] between two samples of a path; half a cell if that is less
_AT_ONCE = 32  # samples
_SAME_AREA = 1e-12  # [m^2], far more than the rounding of an area


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


def is_free(grid: Grid, footprint: Footprint, pose: Pose) -> bool:
    """Return whether the car at `pose` [map frame] overlaps no occupied cell; it may touch some.

    The test is exact: a rectangle and a cell overlap unless one of the four directions of their
    sides separates them (the separating axis theorem for convex shapes).
    """
    local = grid.to_grid(pose)
    x, y, half_x, half_y = _bounds(footprint, local)
    cells = _occupied(grid, x - half_x, y - half_y, x + half_x, y + half_y)
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
    missed: in a bend, the corner of a cell by a millimetre or two.

    A car that is inside a wall may move as long as no sample overlaps the walls more than the
    one before. From the first free sample on the usual rule holds.

    Args:
        grid: the map.
        footprint: the car's body.
        path: the path of the car.
        length: length of the path [m].

    Returns:
        A distance from 0 to `length` [m]; `length` itself if no wall is in the way.
    """
    start = 0.0
    if not is_free(grid, footprint, path(0.0)):
        start = _leave(grid, footprint, path, length)
        if start == length or not is_free(grid, footprint, path(start)):
            return start
    step = min(0.5 * grid.resolution, _STEP)
    count = math.ceil((length - start) / step)
    samples = [start + number * step for number in range(count)] + [length]
    hit = _first_hit(grid, footprint, path, samples)
    if hit is None:
        return length
    free, blocked = samples[hit - 1], samples[hit]
    while blocked - free > TOUCH:
        middle = 0.5 * (free + blocked)
        if is_free(grid, footprint, path(middle)):
            free = middle
        else:
            blocked = middle
    return free


def _first_hit(
    grid: Grid, footprint: Footprint, path: Path, samples: Sequence[float]
) -> Optional[int]:
    """Return the index of the first sample of a path that hits a wall, or None.

    The first sample is known to be free. Samples without a wall nearby are skipped together.

    Args:
        grid: the map.
        footprint: the car's body.
        path: the path of the car.
        samples: distances along the path, in order [m].
    """
    if len(samples) < 2:
        return None
    middle = grid.to_grid(path(0.5 * (samples[0] + samples[-1])))
    radius = 0.5 * (samples[-1] - samples[0])
    radius += math.hypot(max(footprint.front, footprint.back), footprint.half_width)
    cells = _occupied(
        grid, middle.x - radius, middle.y - radius, middle.x + radius, middle.y + radius
    )
    if not len(cells):
        return None
    if len(samples) > _AT_ONCE + 1:
        half = len(samples) // 2
        hit = _first_hit(grid, footprint, path, samples[: half + 1])
        if hit is None:
            hit = _first_hit(grid, footprint, path, samples[half:])
            return None if hit is None else half + hit
        return hit
    poses = [grid.to_grid(path(distance)) for distance in samples[1:]]
    hits = _hits(cells, grid.resolution, footprint, poses)
    return 1 + int(hits.argmax()) if hits.any() else None


def _leave(grid: Grid, footprint: Footprint, path: Path, length: float) -> float:
    """Return how far a car inside a wall can drive, at most to the first free sample [m]."""
    step = 0.5 * grid.resolution
    distance, covered = 0.0, _covered(grid, footprint, path(0.0))
    for number in range(1, math.ceil(length / step) + 1):
        further = min(number * step, length)
        pose = path(further)
        if is_free(grid, footprint, pose):
            return further
        before, covered = covered, _covered(grid, footprint, pose)
        if covered > before + _SAME_AREA:
            break
        distance = further
    return distance


def _bounds(footprint: Footprint, local: Pose) -> Tuple[float, float, float, float]:
    """Return centre and half sizes [m] of the car's axis-aligned bounding box, grid frame."""
    cos, sin = math.cos(local.theta), math.sin(local.theta)
    ahead = 0.5 * (footprint.front - footprint.back)
    half_length = 0.5 * (footprint.front + footprint.back)
    half_x = half_length * abs(cos) + footprint.half_width * abs(sin)
    half_y = half_length * abs(sin) + footprint.half_width * abs(cos)
    return local.x + ahead * cos, local.y + ahead * sin, half_x, half_y


def _window(
    grid: Grid, left: float, bottom: float, right: float, top: float
) -> Tuple[int, int, np.ndarray]:
    """Return the first column and row of a box [m, grid frame], and its cells as booleans."""
    scale = 1.0 / grid.resolution
    column, row = max(0, math.floor(left * scale)), max(0, math.floor(bottom * scale))
    end_column, end_row = max(0, math.ceil(right * scale)), max(0, math.ceil(top * scale))
    return column, row, grid.occupied[row:end_row, column:end_column]


def _occupied(grid: Grid, left: float, bottom: float, right: float, top: float) -> np.ndarray:
    """Return the centres (N, 2) of the occupied cells in a box [m, grid frame]."""
    column, row, window = _window(grid, left, bottom, right, top)
    if not window.any():
        return np.empty((0, 2))
    rows, columns = window.nonzero()
    indices = np.stack((columns + column, rows + row), axis=1)
    return (indices + 0.5) * grid.resolution


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


def _covered(grid: Grid, footprint: Footprint, pose: Pose) -> float:
    """Return the area of the walls that the car at `pose` [map frame] overlaps [m^2]."""
    local = grid.to_grid(pose)
    x, y, half_x, half_y = _bounds(footprint, local)
    column, row, window = _window(grid, x - half_x, y - half_y, x + half_x, y + half_y)
    cos, sin = math.cos(local.theta), math.sin(local.theta)
    corners = [
        (local.x + cos * u - sin * v, local.y + sin * u + cos * v)
        for u, v in (
            (-footprint.back, -footprint.half_width),
            (footprint.front, -footprint.half_width),
            (footprint.front, footprint.half_width),
            (-footprint.back, footprint.half_width),
        )
    ]
    side = grid.resolution
    area = 0.0
    for number, cells in enumerate(window):
        # Begin and end of each run of occupied cells.
        runs = np.flatnonzero(np.diff(cells, prepend=False, append=False)).tolist()
        for first, end in zip(runs[::2], runs[1::2]):
            polygon = corners
            for axis, sign, edge in (
                (0, -1.0, (column + first) * side),
                (0, 1.0, (column + end) * side),
                (1, -1.0, (row + number) * side),
                (1, 1.0, (row + number + 1) * side),
            ):
                polygon = _clip_polygon(polygon, axis, sign, edge)
            area += _area(polygon)
    return area


def _clip_polygon(
    polygon: List[Tuple[float, float]], axis: int, sign: float, edge: float
) -> List[Tuple[float, float]]:
    """Return the part of a convex polygon with sign * (coordinate `axis` - `edge`) <= 0."""
    result = []
    for start, end in zip(polygon, polygon[1:] + polygon[:1]):
        from_edge = sign * (start[axis] - edge)
        to_edge = sign * (end[axis] - edge)
        if from_edge <= 0.0:
            result.append(start)
        if (from_edge < 0.0 < to_edge) or (to_edge < 0.0 < from_edge):
            part = from_edge / (from_edge - to_edge)
            result.append(
                (start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1]))
            )
    return result


def _area(polygon: List[Tuple[float, float]]) -> float:
    """Return the area of a polygon with counter-clockwise corners."""
    return 0.5 * sum(
        start[0] * end[1] - end[0] * start[1]
        for start, end in zip(polygon, polygon[1:] + polygon[:1])
    )
