"""Collisions of the car's body, against an oracle of crossing edges and results by hand."""

import math
import os

import numpy as np
import pytest

from mushr_ros_intro.geometry import Pose, compose, drive_arc
from mushr_ros_intro.world.footprint import (
    POINT,
    TOUCH,
    Footprint,
    free_distance,
    is_free,
    on_map,
)
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.map_file import read_map
from support.paths import PACKAGE

NARROWED = 3e-9
"""[m] A hit is located to 1e-9 m, an overlap up to 1e-9 m is no hit, and the rest is rounding."""

CLEAR_CUT = 1e-6
"""[m] The oracle does not judge bodies that are this close to touching."""

CUT = 3e-3
"""[m] How far the body may overlap the corner of a cell between two samples of an arc."""

CAR = Footprint()
SHORT = Footprint(front=0.3, back=0.2, half_width=0.1)


def grid_of(rows, resolution):
    """Return the grid of a drawing, top row first, with # for walls."""
    cells = [[100 if cell == "#" else 0 for cell in row] for row in reversed(rows)]
    return Grid(np.array(cells, np.int8), resolution)


ROOM = grid_of(["########", "#      #", "#      #", "#      #", "########"], 0.5)
"""Free from 0.5 to 3.5 m in x, and from 0.5 to 2.0 m in y."""


@pytest.mark.parametrize("y", [1.0, 1.25])
def test_a_point_is_stopped_between_two_cells_and_in_a_cell(y):
    path = Pose(1.0, y, 0.0)
    assert free_distance(ROOM, POINT, lambda s: drive_arc(path, s, 0.0), 9.0) == pytest.approx(2.5)


def free_arc(grid, footprint, pose, bend, distance):
    """Return the free distance along an arc [m], negative in reverse."""
    sign = math.copysign(1.0, distance)

    def path(length):
        return drive_arc(pose, sign * length, bend)

    return sign * free_distance(grid, footprint, path, abs(distance))


def corners_of(footprint, pose):
    """Return the corners of the body, counter-clockwise."""
    f, b, w = footprint
    turn = complex(math.cos(pose.theta), math.sin(pose.theta))
    corners = (-b - 1j * w, f - 1j * w, f + 1j * w, -b + 1j * w)
    return [complex(pose.x, pose.y) + turn * corner for corner in corners]


def cross(a, b):
    return a.real * b.imag - a.imag * b.real


def is_inside(point, polygon):
    return all(cross(q - p, point - p) > 0 for p, q in zip(polygon, polygon[1:] + polygon[:1]))


def edges_cross(a, b, c, d):
    one, other = cross(b - a, c - a), cross(b - a, d - a)
    third, fourth = cross(d - c, a - c), cross(d - c, b - c)
    return one * other < 0 and third * fourth < 0


def overlaps(one, other):
    """Return whether two convex polygons overlap: a corner is inside, or edges cross."""
    if any(is_inside(p, other) for p in one) or any(is_inside(p, one) for p in other):
        return True
    return any(
        edges_cross(a, b, c, d)
        for a, b in zip(one, one[1:] + one[:1])
        for c, d in zip(other, other[1:] + other[:1])
    )


def hits_by_edges(grid, footprint, pose):
    body = corners_of(footprint, grid.to_grid(pose))
    side = grid.resolution
    for row, column in np.argwhere(grid.cells > 50).tolist():
        low = complex(column * side, row * side)
        cell = [low, low + side, low + side * (1 + 1j), low + side * 1j]
        if overlaps(body, cell):
            return True
    return False


def grown(footprint, by):
    return Footprint(*(size + by for size in footprint))


@pytest.mark.parametrize("share, resolution", [(0.03, 0.1), (0.2, 0.3), (0.02, 0.05), (0.3, 0.9)])
def test_is_free_against_crossing_edges(share, resolution):
    origin = Pose(-3.0, 5.0, 2.2)
    dice = np.random.default_rng(round(share * 100))
    cells = np.where(dice.random((11, 17)) < share, 100, 0).astype(np.int8)
    grid = Grid(cells, resolution, origin)
    size = np.array([17, 11]) * resolution
    seen = {True: 0, False: 0}
    for _ in range(80):
        x, y = dice.uniform(-0.5, size + 0.5)
        pose = compose(origin, Pose(x, y, dice.uniform(-4.0, 4.0)))
        surely = hits_by_edges(grid, grown(CAR, -CLEAR_CUT), pose)
        if surely != hits_by_edges(grid, grown(CAR, CLEAR_CUT), pose):
            continue
        assert is_free(grid, CAR, pose) == (not surely), pose
        seen[surely] += 1
    assert min(seen.values()) > 5


def test_a_pole_between_the_corners():
    """No corner of the body is in the wall, and no corner of the wall is near the body's middle."""
    pole = Grid(np.pad(np.array([[100]], np.int8), 20), 0.02)
    assert not is_free(pole, CAR, Pose(0.3, 0.41, 0.0))
    assert not is_free(pole, CAR, Pose(0.41, 0.3, math.pi / 2))
    assert is_free(pole, CAR, Pose(0.3, 0.41 + 0.15, 0.0))
    assert is_free(pole, CAR, Pose(0.3, 0.41, math.pi))


def test_touching_is_free():
    right = 3.5 - SHORT.front
    top = 2.0 - SHORT.half_width
    assert is_free(ROOM, SHORT, Pose(right, top, 0.0))
    assert is_free(ROOM, SHORT, Pose(right + 0.5 * TOUCH, 1.0, 0.0))
    assert not is_free(ROOM, SHORT, Pose(right + 2 * TOUCH, 1.0, 0.0))
    assert not is_free(ROOM, SHORT, Pose(1.0, top + 2 * TOUCH, 0.0))
    # The car may drive along a wall that it touches.
    assert free_arc(ROOM, SHORT, Pose(1.0, top, 0.0), 0.0, 1.0) == 1.0
    # Unknown cells are free.
    assert is_free(Grid(np.full((9, 9), -1, np.int8), 0.5), CAR, Pose(2.0, 2.0, 0.0))


@pytest.mark.parametrize(
    "pose, distance, expected",
    [
        (Pose(1.0, 1.0, 0.0), 50.0, 3.5 - 0.3 - 1.0),
        (Pose(1.0, 1.0, 0.0), -50.0, -(1.0 - 0.2 - 0.5)),
        (Pose(1.0, 1.0, math.pi / 2), 1e3, 2.0 - 0.3 - 1.0),
        (Pose(2.0, 1.0, math.pi), 1.4, 2.0 - 0.3 - 0.5),
        # At 45 degrees the front left corner is (0.3 - 0.1) / sqrt(2) to the right of, and
        # (0.3 + 0.1) / sqrt(2) above, the rear axle.
        (Pose(1.0, 1.0, math.pi / 4), 5.0, math.sqrt(2) * 1.0 - 0.4),
        (Pose(1.0, 1.0, 0.0), 0.0, 0.0),
        (Pose(1.0, 1.0, 0.0), 1.25, 1.25),
        (Pose(1.0, 1.0, 0.0), -0.1, -0.1),
    ],
)
def test_straight_paths_by_hand(pose, distance, expected):
    origin = Pose(7.0, -20.0, -2.0)
    room = Grid(ROOM.cells, ROOM.resolution, origin)
    got = free_arc(room, SHORT, compose(origin, pose), 0.0, distance)
    assert abs(got - expected) < NARROWED
    assert abs(got) <= abs(distance)


def test_every_end_of_the_body_can_hit():
    long_tail = Footprint(front=0.05, back=0.5, half_width=0.1)
    backed = free_arc(ROOM, long_tail, Pose(2.5, 1.0, 0.0), 0.0, -9.0)
    assert abs(backed - -(2.5 - 0.5 - 0.5)) < NARROWED
    wide = Footprint(front=0.1, back=0.1, half_width=0.6)
    cells = np.zeros((60, 100), np.int8)
    cells[41, 50] = 100  # 2.5 m ahead, and just inside the left side
    driven = free_arc(Grid(cells, 0.05), wide, Pose(1.0, 1.5, 0.0), 0.0, 3.0)
    assert abs(driven - (2.5 - 0.1 - 1.0)) < NARROWED


def test_a_body_and_a_wall_that_are_thinner_than_the_usual_step():
    """They overlap on 3 mm of the path; the usual step is 5 mm."""
    cells = np.zeros((100, 600), np.int8)
    cells[:, 500] = 100
    thin = Footprint(front=0.001, back=0.001, half_width=0.02)
    driven = free_arc(Grid(cells, 0.001), thin, Pose(0.103, 0.05, 0.0), 0.0, 0.45)
    assert abs(driven - (0.5 - 0.001 - 0.103)) < NARROWED


@pytest.mark.parametrize("bend", [0.5, 1.0, -1.0, -2.0])
@pytest.mark.parametrize("resolution", [0.1, 0.25])
def test_a_bend_by_hand(bend, resolution):
    """The outer front corner, on a circle about the turning centre, hits a wall across the path."""
    radius = abs(1.0 / bend)
    outer = math.hypot(CAR.front, radius + CAR.half_width)
    begins = math.atan2(-radius - CAR.half_width, CAR.front)
    wall = math.ceil(CAR.front / resolution) * resolution
    assert CAR.front < wall < outer
    expected = radius * (-math.acos(wall / outer) - begins)
    cells = np.zeros((100, 100), np.int8)
    cells[:, 50 + round(wall / resolution)] = 100
    grid = Grid(cells, resolution, Pose(-50 * resolution, -50 * resolution, 0.0))
    got = free_arc(grid, CAR, Pose(0.0, 0.0, 0.0), bend, 3.0)
    assert abs(got - expected) < 2 * NARROWED  # the corner hits the wall at an angle


@pytest.mark.parametrize("seed", range(2))
def test_the_path_is_free_up_to_the_hit_and_not_further(seed):
    dice = np.random.default_rng(seed)
    cells = np.where(dice.random((60, 80)) < 0.01, 100, 0).astype(np.int8)
    grid = Grid(cells, 0.1, Pose(2.0, -1.0, 0.7))
    hits = 0
    for _ in range(40):
        x, y = dice.uniform((0.0, 0.0), (8.0, 6.0))
        pose = compose(grid.origin, Pose(x, y, dice.uniform(-4.0, 4.0)))
        bend, distance = dice.uniform(-1.2, 1.2), dice.uniform(-4.0, 4.0)
        if not is_free(grid, CAR, pose):
            continue
        got = free_arc(grid, CAR, pose, bend, distance)
        assert 0.0 <= got / distance <= 1.0
        assert is_free(grid, CAR, drive_arc(pose, got, bend))
        for share in np.linspace(0.0, 1.0, 50).tolist():
            assert is_free(grid, grown(CAR, -CUT), drive_arc(pose, share * got, bend))
        if got != distance:
            hits += 1
            further = got + math.copysign(2 * TOUCH, distance)
            assert not is_free(grid, CAR, drive_arc(pose, further, bend))
    assert hits > 3


def test_a_path_in_pieces_ends_at_the_same_wall():
    stop = 3.5 - 0.3
    pose = Pose(1.0, 1.2, 0.0)
    for distance in [5.0 / 7] * 7 + [0.1] * 20:  # the last 20 do not move the car
        pose = drive_arc(pose, free_arc(ROOM, SHORT, pose, 0.0, distance), 0.0)
    assert abs(pose.x - stop) < NARROWED
    assert free_arc(ROOM, SHORT, pose, 0.0, -0.5) == -0.5
    assert free_arc(ROOM, SHORT, pose, 0.8, -0.1) == -0.1


@pytest.mark.parametrize("depth", [0.01, 0.1, 0.25])
def test_a_car_that_starts_inside_a_wall_is_stopped_once_it_was_free(depth):
    pose = Pose(3.5 - 0.3 + depth, 1.2, 0.0)
    assert not is_free(ROOM, SHORT, pose)
    assert free_arc(ROOM, SHORT, pose, 0.0, 0.5) == 0.5
    assert free_arc(ROOM, SHORT, pose, 0.0, -0.5 * depth) == -0.5 * depth
    assert free_arc(ROOM, SHORT, pose, 0.0, -1.0) == -1.0
    # It leaves the wall, and hits the wall behind it.
    expected = -(pose.x - 0.2 - 0.5)
    assert abs(free_arc(ROOM, SHORT, pose, 0.0, -9.0) - expected) < NARROWED


def test_off_the_map():
    assert on_map(ROOM, SHORT, Pose(2.0, 1.0, 0.5))
    assert on_map(ROOM, SHORT, Pose(4.0 - 0.3, 1.0, 0.0))
    assert not on_map(ROOM, SHORT, Pose(4.0 - 0.29, 1.0, 0.0))
    assert not on_map(ROOM, SHORT, Pose(2.0, 0.09, 0.0))
    for pose in (Pose(-5.0, 1.0, 0.0), Pose(1e6, -1e6, 3.0)):
        assert not on_map(ROOM, SHORT, pose)
        assert is_free(ROOM, SHORT, pose)
    # A car outside the map hits the wall, too.
    got = free_arc(ROOM, SHORT, Pose(-2.0, 1.0, 0.0), 0.0, 10.0)
    assert abs(got - (2.0 - 0.3)) < NARROWED
    assert free_arc(ROOM, SHORT, Pose(5.0, 1.0, 0.0), 0.0, 1e3) == 1e3


def test_every_map_is_free_at_its_origin_for_the_default_footprint():
    assert CAR == (0.38, 0.06, 0.135)
    for name in ("sandbox", "race_loop", "rooms"):
        grid = read_map(os.path.join(PACKAGE, "maps", f"{name}.yaml"))
        assert free_arc(grid, CAR, Pose(0.0, 0.0, 0.0), 0.0, 1.5) == 1.5, name
