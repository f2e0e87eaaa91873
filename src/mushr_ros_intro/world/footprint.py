"""The car's body against the walls of a map: where it may be, and how far it may drive.

The body is a rectangle and the walls are the occupied cells of a grid. What is unknown is free,
and so is what is off the map; `on_map` tells.
"""

import math
from typing import Callable, List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.world.grid import Grid

TOUCH = 1e-9
"""The body may reach into a wall by this much [m] before it counts: to touch is not to hit."""

_STEP = 0.005  # [m] between two tries, or half a cell where that is less
_AT_ONCE = 32  # tries
_SAME_AREA = 1e-12  # [m^2], far more than rounding makes of an area


class Footprint(NamedTuple):
    """The rectangle that the car covers, as seen from base_footprint, the rear axle's middle.

    The defaults are our choice for MuSHR's model, whose axles are 0.2965 m apart and whose wheels
    have a radius of 0.0488 m and stand 0.23 m apart: the body ends just behind the rear wheels,
    with a bumper before the front ones, and is as wide as the tyres' outer sides.
    """

    front: float = 0.38
    """From the rear axle to the front end [m]."""
    back: float = 0.06
    """From the rear axle to the rear end [m]."""
    half_width: float = 0.135
    """From the middle to either side [m]."""


def is_free(grid: Grid, footprint: Footprint, pose: Pose) -> bool:
    """Say whether the car at `pose` [map frame] hits no occupied cell; to touch one is free.

    The test is exact: a rectangle and a cell overlap unless one of the four directions of their
    sides separates them (the separating axis theorem for convex shapes).
    """
    local = grid.to_grid(pose)
    x, y, half_x, half_y = _bounds(footprint, local)
    cells = _occupied(grid, x - half_x, y - half_y, x + half_x, y + half_y)
    return not len(cells) or not _hits(cells, grid.resolution, footprint, [local])[0]


def on_map(grid: Grid, footprint: Footprint, pose: Pose) -> bool:
    """Say whether the car at `pose` [map frame] is on the map with its whole body."""
    x, y, half_x, half_y = _bounds(footprint, grid.to_grid(pose))
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    return (
        half_x - TOUCH <= x <= width - half_x + TOUCH
        and half_y - TOUCH <= y <= height - half_y + TOUCH
    )


def free_distance(
    grid: Grid, footprint: Footprint, pose: Pose, curvature: float, distance: float
) -> float:
    """Return how far along an arc the car can drive before it hits something.

    Args:
        grid: the map.
        footprint: of the car.
        pose: of base_footprint where the arc begins, in the map frame.
        curvature: of the arc [1/m], left positive.
        distance: length of the arc [m], negative in reverse.

    Returns:
        A distance from 0 to `distance` [m]; `distance` itself if nothing is in the way.
    """
    sign = math.copysign(1.0, distance)

    def at(way: float) -> Pose:
        return drive_arc(pose, sign * way, curvature)

    return sign * free_way(grid, footprint, at, abs(distance))


def free_way(grid: Grid, footprint: Footprint, at: Callable[[float], Pose], length: float) -> float:
    """Return how far along a path the car can drive before it hits something.

    The way is tried every few millimetres, and the first hit narrowed down to 1e-9 m, so the pose
    at the returned distance is free. What the body hits and leaves again between two tries is not
    noticed: in a bend, the corner of a cell that it reaches into by a millimetre or two.

    A car that is in a wall already may move as long as no try covers more wall than the one
    before, and from the first free one on as any other.

    Args:
        grid: the map.
        footprint: of the car.
        at: the pose of base_footprint [map frame] after a way from 0 to `length` [m]. It moves by
            as much as the way grows, or by less.
        length: of the path [m].

    Returns:
        A way from 0 to `length` [m]; `length` itself if nothing is in the way.
    """
    start = 0.0
    if not is_free(grid, footprint, at(0.0)):
        start = _leave(grid, footprint, at, length)
        if start == length or not is_free(grid, footprint, at(start)):
            return start
    step = min(0.5 * grid.resolution, _STEP)
    last = math.ceil((length - start) / step)  # the number of the last try

    def way(number: int) -> float:
        return length if number >= last else start + number * step

    reach = math.hypot(max(footprint.front, footprint.back), footprint.half_width)
    pieces: List[Tuple[int, int]] = [(0, last)]  # from after the first to the second, next on top
    while pieces:
        low, high = pieces.pop()
        if low == high:
            continue
        middle = grid.to_grid(at(0.5 * (way(low) + way(high))))
        radius = 0.5 * (way(high) - way(low)) + reach
        box = (middle.x - radius, middle.y - radius, middle.x + radius, middle.y + radius)
        if not _window(grid, *box)[2].any():
            continue
        if high - low > _AT_ONCE:
            half = (low + high) // 2
            pieces += [(half, high), (low, half)]
            continue
        cells = _occupied(grid, *box)
        poses = [grid.to_grid(at(way(number))) for number in range(low + 1, high + 1)]
        hits = _hits(cells, grid.resolution, footprint, poses)
        if hits.any():
            hit = low + 1 + int(hits.argmax())
            free, blocked = way(hit - 1), way(hit)
            while blocked - free > TOUCH:
                between = 0.5 * (free + blocked)
                pose = grid.to_grid(at(between))
                if _hits(cells, grid.resolution, footprint, [pose])[0]:
                    blocked = between
                else:
                    free = between
            return free
    return length


def _leave(grid: Grid, footprint: Footprint, at: Callable[[float], Pose], length: float) -> float:
    """Return how far a car that is in a wall may go, to the first free try at most [m]."""
    step = 0.5 * grid.resolution
    way, covered = 0.0, _covered(grid, footprint, at(0.0))
    for number in range(1, math.ceil(length / step) + 1):
        further = min(number * step, length)
        here = at(further)
        if is_free(grid, footprint, here):
            return further
        before, covered = covered, _covered(grid, footprint, here)
        if covered > before + _SAME_AREA:
            break
        way = further
    return way


def _bounds(footprint: Footprint, local: Pose) -> Tuple[float, float, float, float]:
    """Return the middle and half the sizes [m] of the upright box round the car, grid frame."""
    cos, sin = math.cos(local.theta), math.sin(local.theta)
    ahead = 0.5 * (footprint.front - footprint.back)
    half_length = 0.5 * (footprint.front + footprint.back)
    half_x = half_length * abs(cos) + footprint.half_width * abs(sin)
    half_y = half_length * abs(sin) + footprint.half_width * abs(cos)
    return local.x + ahead * cos, local.y + ahead * sin, half_x, half_y


def _window(
    grid: Grid, left: float, bottom: float, right: float, top: float
) -> Tuple[int, int, np.ndarray]:
    """Return the first column and row of the cells in an upright box [m], and their occupancy."""
    scale = 1.0 / grid.resolution
    columns = [_clip(math.floor(left * scale), grid.width), 0]
    columns[1] = max(columns[0], _clip(math.ceil(right * scale), grid.width))
    rows = [_clip(math.floor(bottom * scale), grid.height), 0]
    rows[1] = max(rows[0], _clip(math.ceil(top * scale), grid.height))
    return columns[0], rows[0], grid.occupied[rows[0] : rows[1], columns[0] : columns[1]]


def _clip(index: int, count: int) -> int:
    """Return `index`, or the nearest number from 0 to `count`."""
    return 0 if index < 0 else count if index > count else index


def _occupied(grid: Grid, left: float, bottom: float, right: float, top: float) -> np.ndarray:
    """Return the middles (N, 2) of the occupied cells in an upright box [m], grid frame."""
    column, row, window = _window(grid, left, bottom, right, top)
    if not window.any():
        return np.empty((0, 2))
    rows, columns = window.nonzero()
    middles = np.stack((columns + column, rows + row), axis=1)
    return (middles + 0.5) * grid.resolution


def _hits(
    cells: np.ndarray, side: float, footprint: Footprint, poses: Sequence[Pose]
) -> np.ndarray:
    """Say of each pose (P,), in the grid's frame, whether the car is in one of the cells there.

    Args:
        cells: the cells' middles [m], (N, 2).
        side: of every cell [m].
        footprint: of the car.
        poses: P of them.
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
    """Return how much of the walls the car at `pose` [map frame] covers [m^2]."""
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
        # Where a run of occupied cells begins, and where it ends.
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
    """Return the part of a convex polygon where sign * (coordinate `axis` - `edge`) <= 0."""
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
    """Return the area of a polygon whose corners run counter-clockwise."""
    return 0.5 * sum(
        start[0] * end[1] - end[0] * start[1]
        for start, end in zip(polygon, polygon[1:] + polygon[:1])
    )
