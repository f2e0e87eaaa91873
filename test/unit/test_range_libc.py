"""The stand-in for range_libc, against the exact laser, in the workspace that courses use."""

import math

import numpy as np
import pytest
import range_libc
from nav_msgs.msg import OccupancyGrid

from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.ros.conversions import grid_to_msg
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.laser import Beams, Laser

BEAMS = Beams(angle_min=-2.0, angle_increment=0.05, number=80, range_min=0.0, range_max=4.0)
ANGLES = BEAMS.angle_min + BEAMS.angle_increment * np.arange(BEAMS.number)


def room(origin):
    """Return a room with a pillar, of 60 x 80 cells of 0.1 m."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[20:25, 50:53] = 100
    cells[40:, 60:79] = -1  # not known
    return Grid(cells, 0.1, origin)


@pytest.mark.parametrize("origin", [Pose(0.0, 0.0, 0.0), Pose(-3.0, 2.0, 0.7)])
def test_ranges(origin):
    grid = room(origin)
    caster = range_libc.PyCDDTCast(
        range_libc.PyOMap(grid_to_msg(grid, 0, "map")), BEAMS.range_max / grid.resolution, 108
    )
    poses = [compose(origin, each) for each in (Pose(3.0, 2.0, 0.0), Pose(6.5, 4.5, 4.0))]
    ranges = np.zeros(len(poses) * BEAMS.number, np.float32)
    caster.calc_range_repeat_angles(np.array(poses, np.float32), ANGLES.astype(np.float32), ranges)
    laser = Laser(grid, BEAMS)
    exact = np.minimum(np.concatenate([laser.scan(pose) for pose in poses]), BEAMS.range_max)
    assert (exact < BEAMS.range_max).sum() > BEAMS.number
    assert np.quantile(np.abs(ranges - exact), 0.95) < 0.5 * grid.resolution
    single = np.zeros(2, np.float32)
    caster.calc_range_many(np.array(poses, np.float32), single)
    assert caster.calc_range(*poses[0]) == pytest.approx(single[0], abs=1e-5)
    ahead = laser.scan(poses[0])[40]  # the beam 40 is straight ahead
    assert single[0] == pytest.approx(ahead, abs=0.5 * grid.resolution)


def test_weights():
    """A weight is the product of the entries of the table for measured and expected ranges."""
    omap = range_libc.PyOMap(grid_to_msg(room(Pose(0.0, 0.0, 0.0)), 0, "map"))
    caster = range_libc.PyRayMarching(omap, 4.0)
    caster.set_sensor_model(np.arange(25.0).reshape(5, 5))
    expected = np.array([0.1, 0.2, 0.3, 9.9], np.float32)
    weights = np.zeros(2)
    caster.eval_sensor_model(np.array([0.35, 0.05], np.float32), expected, weights, 2, 2)
    assert weights.tolist() == [(15 + 1) * 2, (15 + 3) * 4]


def test_a_map_without_walls():
    msg = OccupancyGrid()
    msg.info.width, msg.info.height, msg.info.resolution = 3, 2, 1.0
    msg.info.origin.orientation.w = 1.0
    msg.data = [0] * 6
    omap = range_libc.PyOMap(msg)
    assert (omap.width(), omap.height(), omap.isOccupied(1, 1)) == (3, 2, False)
    caster = range_libc.PyRayMarchingGPU(omap, 7.0)
    assert caster.calc_range(1.5, 1.0, math.pi) == 7.0
