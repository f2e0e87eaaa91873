"""A laser scanner in a map, exact to rounding.

The boundaries between occupied and free cells are merged into straight faces once. Seen from a
pose, each face covers the beams between the directions of its two ends. Its range along a beam is
its offset divided by the sine or cosine of the beam, and the nearest face counts. Faces meet in
corners. The direction of a corner is computed once for all its faces, so no beam slips through
between two faces or diagonally between two cells.
"""

import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.world.grid import Grid


class Beams(NamedTuple):
    """The beams of a scanner. The defaults are those of MuSHR's nano (its config sensors.yaml)."""

    angle_min: float = -3.14159
    """Direction of the first beam [rad], counter-clockwise from straight ahead."""
    angle_increment: float = 0.00872665
    """Angle from one beam to the next [rad], positive."""
    number: int = 720
    """Number of beams; together they cover less than a full turn."""
    range_min: float = 0.02
    """The shortest range that can be measured [m]."""
    range_max: float = 10.0
    """The longest range that can be measured [m]."""

    def check(self) -> None:
        """Check that a scanner can have these beams.

        Raises:
            UserError: the beams cover a full turn, or no range can be measured.
        """
        turn = max(1, self.number - 1) * self.angle_increment
        if self.number < 1 or not 0.0 < turn < math.tau:
            raise UserError(
                f"{self.number} beams are {self.angle_increment:g} rad apart; "
                "expected at least one beam, and less than a full turn"
            )
        if not 0.0 <= self.range_min < self.range_max:
            raise UserError(
                f"range_min is {self.range_min:g} and range_max is {self.range_max:g} m; "
                "expected a range_min from 0 to less than range_max"
            )

    def measured(self, ranges: np.ndarray) -> np.ndarray:
        """Return ranges [m] with infinities for those that cannot be measured (REP 117)."""
        near = np.where(ranges < self.range_min, -np.inf, ranges)
        return np.where(ranges > self.range_max, np.inf, near)


class Laser:
    """A laser scanner in a map. Its beams have to pass `Beams.check`."""

    def __init__(self, grid: Grid, beams: Beams):
        self._grid = grid
        self._beams = beams
        begin, end, self._fronts, self._vertical = _find_faces(grid)
        self._offsets = np.where(self._vertical, begin[0], begin[1]) * grid.resolution
        width = grid.width + 1
        keys, ends = np.unique([x + y * width for x, y in (begin, end)], return_inverse=True)
        self._corners = np.stack((keys % width, keys // width)) * grid.resolution
        self._ends = ends.reshape(2, -1)
        self._slots = math.ceil(math.tau / beams.angle_increment)  # beams of a full turn
        directions = beams.angle_min + beams.angle_increment * np.arange(self._slots)
        self._directions = np.exp(1j * directions)

    def scan(self, pose: Pose) -> np.ndarray:
        """Return the measured ranges [m], (beams,).

        Args:
            pose: the pose of the scanner in the map frame.

        Returns:
            +inf if nothing is in range, -inf if an obstacle is too near to be measured (REP 117).
            Inside a wall all ranges are -inf.
        """
        local = self._grid.to_grid(pose)
        if self._is_inside(local):
            return np.full(self._beams.number, -np.inf)
        offsets = self._offsets - np.where(self._vertical, local.x, local.y)
        # A face is visible only from its front.
        seen = (offsets * self._fronts > 0.0) & (np.abs(offsets) <= self._beams.range_max)
        offsets, vertical = offsets[seen], self._vertical[seen]
        begin, end = self._first_beams(local)[self._ends[:, seen]]
        covered = (end - begin) % self._slots

        # One entry for each beam of each face: its face, its beam and its range.
        face = np.repeat(np.arange(len(covered)), covered)
        beam = (begin - (np.cumsum(covered) - covered))[face] + np.arange(len(face))
        beam %= self._slots
        direction = (self._directions * np.exp(1j * local.theta))[beam]
        with np.errstate(divide="ignore"):
            ranges = offsets[face] / np.where(vertical[face], direction.real, direction.imag)
        nearest = np.full(self._slots, np.inf)
        order = np.argsort(-ranges)  # of several entries for a beam, the last one is kept
        nearest[beam[order]] = ranges[order]

        return self._beams.measured(nearest[: self._beams.number])

    def _first_beams(self, local: Pose) -> np.ndarray:
        """Return the first beam counter-clockwise of each corner, from 0 to a full turn, (C,).

        Args:
            local: the pose of the scanner in the grid frame.
        """
        turn = math.tau / self._beams.angle_increment
        angle = np.arctan2(self._corners[1] - local.y, self._corners[0] - local.x)
        beam = (angle - local.theta - self._beams.angle_min) / self._beams.angle_increment
        return np.ceil(beam - turn * np.floor(beam / turn)).astype(np.int64)

    def _is_inside(self, local: Pose) -> bool:
        """Return whether a pose in the grid frame is inside an occupied cell."""
        column = math.floor(local.x / self._grid.resolution)
        row = math.floor(local.y / self._grid.resolution)
        is_on_map = 0 <= column < self._grid.width and 0 <= row < self._grid.height
        return is_on_map and bool(self._grid.occupied[row, column])


def add_noise(
    ranges: np.ndarray, beams: Beams, noise_std: float, seed: Sequence[int]
) -> np.ndarray:
    """Return the result of `Laser.scan` with independent Gaussian noise.

    The noise has the standard deviation `noise_std` [m], and depends on the seed alone: whole
    numbers, not negative.
    """
    noise = np.random.default_rng(seed).standard_normal(ranges.shape)
    return beams.measured(ranges + noise_std * noise)


def _find_faces(grid: Grid) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the faces of the walls: begin and end (2, F), fronts and vertical (F,).

    Begin and end are the column and row of a cell's corner, counter-clockwise seen from the front.
    """
    occupied = np.pad(grid.occupied, 1).astype(np.int8)
    found: List[List[np.ndarray]] = []
    for is_vertical in (0, 1):
        cells = occupied.T if is_vertical else occupied
        # +1 if a wall begins above this line, so that its front is below; -1 if one ends.
        changes = np.diff(cells, axis=0)[:, 1:-1]
        edges = np.diff(np.pad(changes, ((0, 0), (1, 1))), axis=1) != 0
        line, place = edges.nonzero()
        front = np.pad(changes, ((0, 0), (0, 1)))[line, place]
        starts = np.flatnonzero(front)
        line, first, last, front = line[starts], place[starts], place[starts + 1], front[starts]
        # Counter-clockwise from its front: from right to left if the front is below the face, and
        # from the lower to the upper end if the front is to the left.
        upward = (front > 0) if is_vertical else (front < 0)
        begin = np.where(upward, first, last)
        end = np.where(upward, last, first)
        order = -1 if is_vertical else 1  # column before row
        ends = [np.stack((each, line)[::order]) for each in (begin, end)]
        found.append(ends + [front, np.full(len(line), is_vertical, np.int8)])
    begin, end, fronts, vertical = (np.concatenate(parts, axis=-1) for parts in zip(*found))
    return begin, end, fronts, vertical
