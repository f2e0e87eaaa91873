"""The laser, against a traversal of the cells and against results by hand."""

import math

import numpy as np
import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.world.footprint import World, is_free
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.laser import Beams, Laser, add_noise

EXACT = 1e-9
"""[m] Accuracy of a beam that grazes no corner."""

GRAZING = 1e-9
"""[rad] A beam is not judged if a rotation by this angle makes it hit another cell."""

FEW = Beams(angle_min=-2.0, angle_increment=0.05, number=81, range_min=0.02, range_max=6.0)


def traverse(occupied, side, x, y, angle, reach):
    """Return the range of one beam, and the cell that it hits.

    The algorithm is Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", 1987.
    """
    rows, columns = len(occupied), len(occupied[0])
    column, row = math.floor(x / side), math.floor(y / side)
    dx, dy = math.cos(angle), math.sin(angle)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    distance = 0.0
    while True:
        if 0 <= column < columns and 0 <= row < rows and occupied[row][column]:
            return distance, (column, row)
        to_x = ((column + (dx > 0)) * side - x) / dx if dx else math.inf
        to_y = ((row + (dy > 0)) * side - y) / dy if dy else math.inf
        distance = min(to_x, to_y)
        if distance > reach:
            return math.inf, None
        if to_x < to_y:
            column += step_x
        else:
            row += step_y


def judge(grid, beams, pose):
    """Compare a scan with the traversal; return how many beams were judged, and how many hit."""
    occupied = (grid.cells > 50).tolist()
    local = grid.to_grid(pose)
    scanned = Laser(grid, beams).scan(pose)
    judged = hits = 0
    for number, got in enumerate(scanned.tolist()):
        angle = local.theta + beams.angle_min + number * beams.angle_increment
        hits_nearby = [
            traverse(occupied, grid.resolution, local.x, local.y, angle + turn, beams.range_max)
            for turn in (-GRAZING, 0.0, GRAZING)
        ]
        expected, cell = hits_nearby[1]
        if any(other != cell for _, other in hits_nearby):
            continue
        if expected < beams.range_min:
            expected = -math.inf
        judged += 1
        hits += math.isfinite(expected)
        assert got == expected or abs(got - expected) < EXACT, (pose, number)
    return judged, hits


def noise_map(seed, share, resolution=0.25, shape=(33, 41)):
    dice = np.random.default_rng(seed)
    cells = np.where(dice.random(shape) < share, 100, 0).astype(np.int8)
    return Grid(cells, resolution, Pose(3.0, -2.0, 0.7 * seed)), dice


@pytest.mark.parametrize("share", [0.0, 0.003, 0.03, 0.3, 0.8, 1.0])
def test_noise_against_the_traverse(share):
    judged = 0
    for seed in range(12):
        grid, dice = noise_map(seed, share)
        size = np.array([grid.width, grid.height]) * grid.resolution
        x, y = dice.uniform(-2.0, size + 2.0)
        pose = compose(grid.origin, Pose(x, y, dice.uniform(-9.0, 9.0)))
        judged += judge(grid, FEW, pose)[0]
    assert judged > 0.99 * 12 * FEW.number


def test_the_default_beams_are_those_of_mushr():
    beams = Beams()
    assert (beams.number, beams.range_max) == (720, 10.0)
    last = beams.angle_min + (beams.number - 1) * beams.angle_increment
    assert math.pi - 0.01 < last < math.pi


CROSS = Beams(angle_min=0.0, angle_increment=math.pi / 2, number=4, range_min=0.1, range_max=20.0)


def test_distances_by_hand():
    """A room from 0.5 to 4.5 m and from 0.5 to 2.0 m, with beams across its walls and turned."""
    cells = np.full((5, 10), 100, np.int8)
    cells[1:4, 1:9] = 0
    room = Laser(Grid(cells, 0.5), CROSS)
    ahead, left, behind, right = room.scan(Pose(1.7, 0.9, 0.0))
    assert (ahead, left, behind, right) == pytest.approx((2.8, 1.1, 1.2, 0.4), abs=EXACT)
    ahead, left, _, right = room.scan(Pose(1.7, 0.9, math.pi / 6))
    sin, cos = 0.5, math.sqrt(0.75)
    assert (ahead, left, right) == pytest.approx((1.1 / sin, 1.1 / cos, 0.4 / cos), abs=EXACT)


def test_no_beam_through_a_diagonal():
    """The cells of a wall touch in corners only. Beams to these corners end there, or before."""
    side, count = 0.5, 20
    falling = np.where(np.eye(count, dtype=bool), 100, 0).astype(np.int8)[::-1]
    beam = Beams(angle_min=0.0, angle_increment=1.0, number=1, range_min=0.0, range_max=100.0)
    laser = Laser(Grid(falling, side), beam)
    for x, y in ((4.0, 5.0), (4.5, 4.5), (1.3, 7.7), (6.5, 6.5), (9.9, 1.1)):
        for number in range(1, count):
            corner = (side * number, side * (count - number))
            away = math.dist((x, y), corner)
            heading = math.atan2(corner[1] - y, corner[0] - x)
            for ulps in range(-4, 5):
                (got,) = laser.scan(Pose(x, y, heading + ulps * 2.0**-51))
                assert got <= away + EXACT


def test_ranges_that_cannot_be_measured():
    cells = np.zeros((3, 9), np.int8)
    cells[:, 6] = 100
    laser = Laser(Grid(cells, 1.0), CROSS._replace(range_max=4.0))
    assert laser.scan(Pose(1.9, 1.5, 0.0))[0] == math.inf
    assert laser.scan(Pose(2.1, 1.5, 0.0))[0] == pytest.approx(3.9, abs=EXACT)
    assert laser.scan(Pose(5.85, 1.5, 0.0))[0] == pytest.approx(0.15, abs=EXACT)
    assert laser.scan(Pose(5.95, 1.5, 0.0))[0] == -math.inf
    assert (laser.scan(Pose(6.5, 1.5, 1.0)) == -math.inf).all()  # inside the wall


def test_the_limits_can_be_measured():
    limits = np.array([FEW.range_min, FEW.range_max])
    assert np.array_equal(FEW.measured(limits), limits)


def test_off_the_map():
    cells = np.zeros((3, 9), np.int8)
    cells[1, 0] = 100
    laser = Laser(Grid(cells, 1.0), CROSS)
    assert laser.scan(Pose(-3.0, 1.5, 0.0))[0] == pytest.approx(3.0, abs=EXACT)
    assert (laser.scan(Pose(-3.0, 1.5, 0.0))[1:] == math.inf).all()
    for pose in (Pose(-50.0, 1.5, 0.0), Pose(1e6, -1e6, 2.0)):
        assert (laser.scan(pose) == math.inf).all()
    # Unknown cells stop no beam.
    laser = Laser(Grid(np.array([[0, -1, 50, 100]], np.int8), 1.0), CROSS)
    assert laser.scan(Pose(0.5, 0.5, 0.0))[0] == pytest.approx(2.5, abs=EXACT)


def assert_seen_from_the_middle(shape, cell):
    """Check laser and collisions on a map of `shape` with equal cells."""
    grid = Grid(np.full(shape, cell, np.int8), 0.05)
    middle = Pose(0.05 * shape[1] / 2, 0.05 * shape[0] / 2, 0.3)
    assert is_free(*World(grid), middle) == (cell == 0)
    expected = -math.inf if cell else math.inf
    assert (Laser(grid, FEW).scan(middle) == expected).all()


@pytest.mark.parametrize("shape, cell", [((1, 1), 0), ((3_000, 3_000), 0), ((300, 300), 100)])
def test_large_maps_and_maps_full_of_walls(shape, cell):
    """Neither the laser nor the collisions need more than the map around the car."""
    assert_seen_from_the_middle(shape, cell)


@pytest.mark.full
def test_a_map_of_a_hundred_million_cells():
    assert_seen_from_the_middle((10_000, 10_000), 0)


@pytest.mark.parametrize("count", [1, 2, 90, 719])
def test_beams_of_less_than_a_full_turn(count):
    grid, _ = noise_map(3, 0.05)
    pose = compose(grid.origin, Pose(5.1, 4.2, 1.0))
    beams = Beams(angle_min=1.0, angle_increment=0.00872665, number=count)
    judged, _ = judge(grid, beams, pose)
    assert judged >= 0.98 * count


@pytest.mark.parametrize(
    "beams, expected",
    [
        (Beams(number=0), "0 beams are 0.00872665 rad apart; expected at least one beam"),
        (Beams(number=722), "722 beams are 0.00872665 rad apart; expected at least one beam, and"),
        (Beams(0.0, math.tau / 4, 5), "5 beams are 1.5708 rad apart; expected at least one beam"),
        (Beams(angle_increment=-0.1), "expected at least one beam, and less than a full turn"),
        (Beams(angle_increment=math.nan), "expected at least one beam, and less than a full turn"),
        (Beams(range_min=10.0), "range_min is 10 and range_max is 10 m; expected a range_min from"),
        (Beams(range_min=-1.0), "expected a range_min from 0 to less than range_max"),
    ],
)
def test_impossible_beams(beams, expected):
    with pytest.raises(UserError) as caught:
        beams.check()
    assert expected in str(caught.value)


def test_noise():
    beams = Beams(range_min=0.1)
    exact = np.full(100_000, 5.0)
    noisy = add_noise(exact, beams, 0.02, (4, 99))
    assert (noisy == add_noise(exact, beams, 0.02, (4, 99))).all()
    assert (noisy != add_noise(exact, beams, 0.02, (5, 99))).any()
    assert (noisy != add_noise(exact, beams, 0.02, (4, 100))).any()
    # Five standard errors of the mean and of the standard deviation.
    assert abs(noisy.mean() - 5.0) < 5 * 0.02 / math.sqrt(exact.size)
    assert abs(noisy.std() - 0.02) < 5 * 0.02 / math.sqrt(2 * exact.size)
    assert (add_noise(exact, beams, 0.0, (4, 99)) == exact).all()


def test_noise_beyond_the_limits_is_infinite():
    beams = Beams(range_min=0.1)
    ranges = np.array([-math.inf, 0.1, 9.99, math.inf] * 1000)
    noisy = add_noise(ranges, beams, 0.05, (1,)).reshape(-1, 4)
    assert (noisy[:, 0] == -math.inf).all()
    assert (noisy[:, 3] == math.inf).all()
    middle = noisy[:, 1:3]
    assert ((middle >= 0.1) & (middle <= 10.0) | np.isinf(middle)).all()
    assert (middle[:, 0] == -math.inf).any()
    assert (middle[:, 1] == math.inf).any()
