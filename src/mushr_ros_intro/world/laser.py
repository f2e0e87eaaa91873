"""A laser scanner in a map: beams against the exact faces of the walls.

The faces between occupied cells and free ones are merged into straight runs, once. Seen from a
pose, each face covers the beams between the directions of its two ends, and its range along a beam
is its offset over the beam's sine or cosine; per beam the nearest face counts. Faces meet in
corners, and the direction of a corner is computed once for all of them, so no beam slips through
between two faces, nor diagonally between two cells.
"""

import math
from typing import Dict, List, NamedTuple, Sequence, Tuple, Union

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.world.grid import Grid

TILE = 2.0
"""Side of the squares [m] from each of which one and the same set of faces can be seen."""

_MAX_TILES = 4096  # kept at a time; each takes some tens of kilobytes
_BLOCKERS = 12  # of either direction, which are tried in hiding other faces
_MARGIN = 1e-6  # [m], far more than rounding makes of a coordinate
_BATCH = 32  # poses whose beams are cast in one go


class Beams(NamedTuple):
    """The beams of a scanner. The defaults are MuSHR's nano's (its config sensors.yaml)."""

    angle_min: float = -3.14159
    """Direction of the first beam [rad], counter-clockwise from straight ahead."""
    angle_increment: float = 0.00872665
    """From one beam to the next [rad], positive."""
    number: int = 720
    """How many there are; together less than a full turn."""
    range_min: float = 0.02
    """What is nearer cannot be measured [m]."""
    range_max: float = 10.0
    """What is further away cannot be measured [m]."""

    def fault(self) -> str:
        """Say why these beams make no scanner, and what was expected, or nothing."""
        turn = max(1, self.number - 1) * self.angle_increment
        if self.number < 1 or not 0.0 < turn < math.tau:
            return (
                f"{self.number} beams are {self.angle_increment:g} rad apart; "
                "expected at least one beam, and less than a full turn"
            )
        if not 0.0 <= self.range_min < self.range_max:
            return (
                f"range_min is {self.range_min:g} and range_max is {self.range_max:g} m; "
                "expected a range_min from 0 to less than range_max"
            )
        return ""


MUSHR_NANO = Beams()


class _Tile(NamedTuple):
    """The faces that can be seen from a tile, the horizontal ones first, far ones before near."""

    corners: np.ndarray
    """x and y of their ends [m], (2, C)."""
    ends: np.ndarray
    """At which corner each face begins and ends, counter-clockwise seen from its front, (2, F)."""
    offsets: np.ndarray
    """x of the vertical, y of the horizontal faces [m], (F,)."""
    fronts: np.ndarray
    """+1 where a face is seen from below or from the left, otherwise -1, (F,)."""
    vertical: np.ndarray
    """1 for a vertical face, otherwise 0, (F,)."""


class Laser:
    """A scanner in a map that does not change."""

    def __init__(self, grid: Grid, beams: Beams = MUSHR_NANO):
        """Prepare to scan.

        Raises:
            ValueError: the beams make no scanner.
        """
        if beams.fault():
            raise ValueError(beams.fault())
        self._grid = grid
        self._beams = beams
        self._tiles: Dict[Tuple[int, int], _Tile] = {}
        self._faces = _find_faces(grid)
        self._slots = math.ceil(math.tau / beams.angle_increment)  # beams of a full turn
        directions = beams.angle_min + beams.angle_increment * np.arange(self._slots)
        self._directions = np.exp(1j * directions)

    def scan(self, poses: Union[Pose, np.ndarray]) -> np.ndarray:
        """Return what the scanner measures [m].

        Args:
            poses: x [m], y [m], theta [rad] of the scanner in the map frame, (3,) or (N, 3).

        Returns:
            Ranges, (beams,) or (N, beams): +inf where nothing is in range, -inf where it is too
            near to be measured (REP 117), and that is everywhere for a scanner inside a wall.
        """
        given = np.asarray(poses, float)
        many = given.reshape(-1, 3)
        ranges = np.empty((len(many), self._beams.number))
        with np.errstate(divide="ignore", invalid="ignore"):
            for first in range(0, len(many), _BATCH):
                ranges[first : first + _BATCH] = self._cast(many[first : first + _BATCH])
        return ranges.reshape(given.shape[:-1] + (self._beams.number,))

    def _cast(self, poses: np.ndarray) -> np.ndarray:
        """Return the ranges (N, beams) of a few poses (N, 3)."""
        locals_ = [self._grid.to_grid(Pose(*pose)) for pose in poses.tolist()]
        tiles = [self._tile(math.floor(p.x / TILE), math.floor(p.y / TILE)) for p in locals_]
        inside = [self._is_inside(pose) for pose in locals_]
        x, y, theta = np.array(locals_).T
        numbers = np.arange(len(tiles))

        # The direction of each corner, in beams from the first one, rounded up to a whole one.
        counts = [tile.corners.shape[1] for tile in tiles]
        pose = np.repeat(numbers, counts)
        corners = np.concatenate([tile.corners for tile in tiles], axis=1)
        corners[0] -= x.take(pose)
        corners[1] -= y.take(pose)
        turn = math.tau / self._beams.angle_increment
        where = np.arctan2(corners[1], corners[0])
        where -= (theta + self._beams.angle_min).take(pose)
        where *= 1.0 / self._beams.angle_increment
        where -= turn * np.floor(where / turn)
        slots = np.ceil(where).astype(np.int64)

        # The beams that each face covers: where they begin, and how many they are.
        pose = np.repeat(numbers, [len(tile.offsets) for tile in tiles])
        ends = np.concatenate([tile.ends for tile in tiles], axis=1)
        ends += (np.cumsum(counts) - counts).take(pose)
        begin, end = slots.take(ends)
        covered = end - begin
        covered += self._slots * (covered < 0)
        kind = 2 * pose  # of the face, for each pose horizontal or vertical
        kind += np.concatenate([tile.vertical for tile in tiles])
        offsets = np.concatenate([tile.offsets for tile in tiles])
        offsets -= np.column_stack((y, x)).take(kind)
        fronts = np.concatenate([tile.fronts for tile in tiles])
        covered *= offsets * fronts > 0.0

        # A place for each beam of each kind of face, twice round.
        turned = self._directions * np.exp(1j * theta)[:, np.newaxis]
        inverse = np.empty((len(tiles), 2, 2, self._slots))
        inverse[:, 0, :] = (1.0 / turned.imag)[:, np.newaxis]
        inverse[:, 1, :] = (1.0 / turned.real)[:, np.newaxis]
        begin += 2 * self._slots * kind
        begin -= np.cumsum(covered) - covered
        face = np.repeat(np.arange(len(covered)), covered)
        places = begin.take(face)
        places += np.arange(len(places))
        ranges = offsets.take(face)
        ranges *= inverse.reshape(-1).take(places)

        nearest = np.full(inverse.size, np.inf)
        nearest[places] = ranges  # of several for one place, an arbitrary one
        while True:
            nearer = np.flatnonzero(ranges < nearest[places])
            if not len(nearer):
                break
            places, ranges = places[nearer], ranges[nearer]
            nearest[places] = ranges
        result = nearest.reshape(len(tiles), 4, self._slots)[..., : self._beams.number].min(axis=1)
        result[result > self._beams.range_max] = np.inf
        result[inside] = 0.0
        result[result < self._beams.range_min] = -np.inf
        return result

    def _is_inside(self, local: Pose) -> bool:
        """Say whether a pose in the grid's frame is inside an occupied cell."""
        column = math.floor(local.x / self._grid.resolution)
        row = math.floor(local.y / self._grid.resolution)
        is_on_map = 0 <= column < self._grid.width and 0 <= row < self._grid.height
        return is_on_map and bool(self._grid.occupied[row, column])

    def _tile(self, column: int, row: int) -> _Tile:
        """Return the faces that can be seen from a tile of the grid's frame."""
        tile = self._tiles.get((column, row))
        if tile is None:
            if len(self._tiles) >= _MAX_TILES:
                self._tiles.clear()
            tile = self._build_tile(column * TILE, row * TILE)
            self._tiles[column, row] = tile
        return tile

    def _build_tile(self, left: float, bottom: float) -> _Tile:
        """Choose the faces within range of a tile, by its lower left corner [m]."""
        side = self._grid.resolution
        begin, end, fronts, vertical = self._faces
        reach = self._beams.range_max
        box = np.array([[left], [bottom]])
        low = np.minimum(begin, end) * side - (box + TILE)
        high = box - np.maximum(begin, end) * side
        gap = np.maximum(np.maximum(low, high), 0.0)
        near = np.hypot(gap[0], gap[1]) <= reach
        # In front of at least one corner of the tile.
        offsets = np.where(vertical, begin[0], begin[1]) * side
        edge = np.where(vertical, left, bottom)
        near &= np.where(fronts > 0, edge < offsets, edge + TILE > offsets)
        chosen = np.flatnonzero(near)
        middle = 0.5 * side * (begin[:, chosen] + end[:, chosen]) - (box + 0.5 * TILE)
        distance = np.hypot(middle[0], middle[1])
        chosen = chosen[np.lexsort((-distance, vertical[chosen]))]
        chosen = chosen[~_hidden(begin[:, chosen] * side, end[:, chosen] * side, box)]
        width = self._grid.width + 1
        keys = np.stack((begin[:, chosen], end[:, chosen]))
        keys = keys[:, 0] + keys[:, 1] * width
        corners, ends = np.unique(keys, return_inverse=True)
        return _Tile(
            np.stack((corners % width, corners // width)) * side,
            ends.reshape(2, -1),
            offsets[chosen],
            fronts[chosen].astype(float),
            vertical[chosen].astype(np.int64),
        )


def _hidden(begin: np.ndarray, end: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Say of each face whether a single other one hides it from the whole of a tile: (F,).

    That is so if the other one crosses all lines from the tile's corners to the face's ends. Only
    those that look largest are tried.

    Args:
        begin: where the faces begin [m], (2, F).
        end: where they end [m], (2, F).
        box: lower left corner of the tile [m], (2, 1).
    """
    hidden = np.zeros(begin.shape[1], bool)
    points = np.concatenate((begin, end), axis=1)
    for along in (0, 1):
        across = 1 - along
        flat = np.flatnonzero(begin[across] == end[across])
        length = np.abs(end - begin)[along, flat]
        x, y = 0.5 * (begin + end)[:, flat] - (box + 0.5 * TILE)
        size = length * np.abs((x, y)[across]) / (x * x + y * y + TILE)
        flat = flat[np.argsort(-size)[:_BLOCKERS]]
        line = begin[across, flat, np.newaxis]
        low = np.minimum(begin, end)[along, flat, np.newaxis] + _MARGIN
        high = np.maximum(begin, end)[along, flat, np.newaxis] - _MARGIN
        crossed = np.ones((len(flat), points.shape[1]), bool)
        for corner in ((0.0, 0.0), (TILE, 0.0), (0.0, TILE), (TILE, TILE)):
            start = box[:, 0] + corner
            part = (line - start[across]) / (points[across] - start[across])
            crossing = start[along] + part * (points[along] - start[along])
            crossed &= (part > 0.0) & (part < 1.0) & (crossing > low) & (crossing < high)
        half = begin.shape[1]
        hidden |= (crossed[:, :half] & crossed[:, half:]).any(axis=0)
    return hidden


def add_noise(
    ranges: np.ndarray, beams: Beams, noise_std: float, seed: Sequence[int]
) -> np.ndarray:
    """Return ranges with independent Gaussian noise, the same for the same seed.

    Args:
        ranges: as `Laser.scan` returns them [m].
        beams: of the scanner.
        noise_std: standard deviation [m].
        seed: whole numbers, not negative.
    """
    noise = np.random.default_rng(seed).standard_normal(ranges.shape)
    noisy = ranges + noise_std * noise
    noisy[noisy > beams.range_max] = np.inf
    noisy[noisy < beams.range_min] = -np.inf
    return noisy


def _find_faces(grid: Grid) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the faces of the walls: begin and end (2, F), fronts and vertical (F,).

    Begin and end are corners of cells, column and row, counter-clockwise as seen from the front.
    """
    occupied = np.pad(grid.occupied, 1).astype(np.int8)
    found: List[List[np.ndarray]] = []
    for is_vertical in (0, 1):
        cells = occupied.T if is_vertical else occupied
        # +1 where a wall begins above, that is, seen from below; -1 where one ends.
        changes = np.diff(cells, axis=0)[:, 1:-1]
        edges = np.diff(np.pad(changes, ((0, 0), (1, 1))), axis=1) != 0
        line, place = edges.nonzero()
        front = np.pad(changes, ((0, 0), (0, 1)))[line, place]
        starts = np.flatnonzero(front)
        line, first, last, front = line[starts], place[starts], place[starts + 1], front[starts]
        # Below a face the beams sweep it from right to left, to the left of one from low to high.
        upward = (front > 0) if is_vertical else (front < 0)
        begin = np.where(upward, first, last)
        end = np.where(upward, last, first)
        if is_vertical:
            ends = [np.stack((line, begin)), np.stack((line, end))]
        else:
            ends = [np.stack((begin, line)), np.stack((end, line))]
        found.append(ends + [front, np.full(len(line), is_vertical, np.int8)])
    begin, end, fronts, vertical = (np.concatenate(parts, axis=-1) for parts in zip(*found))
    return begin, end, fronts, vertical
