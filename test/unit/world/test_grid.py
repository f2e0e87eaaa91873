"""Occupancy grids: their frame, their resolution, and what a grid refuses."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.world.grid import Grid, as_travelled


def test_a_grid_is_immutable():
    cells = np.zeros((2, 3), np.int8)
    grid = Grid(cells, 0.1)
    with pytest.raises(ValueError):
        grid.cells[0, 0] = 1
    with pytest.raises(AttributeError):
        grid.resolution = 1.0
    cells[0, 0] = 1  # the original stays its owner's
    assert grid.cells[0, 0] == 0


def test_impossible_grids():
    good = np.zeros((2, 3), np.int8)
    with pytest.raises(ValueError, match="expected"):
        Grid(good[:0], 0.1)
    for resolution in (0.99e-4, 1001.0, math.nan):
        with pytest.raises(ValueError, match="expected"):
            Grid(good, resolution)
    for resolution in (1e-4, 1e3):  # the limits
        assert Grid(good, resolution).resolution == resolution


def test_walls_and_the_frame_of_a_grid():
    # Cells above 50 are walls.
    grid = Grid(np.array([[-128, -1, 0, 50, 51, 100]], np.int8), 0.1)
    assert grid.occupied.tolist() == [[False, False, False, False, True, True]]
    grid = Grid(np.zeros((2, 3), np.int8), 0.1, Pose(3.0, -4.0, 2.0))
    there = Pose(0.7, 0.1, -1.0)
    assert grid.to_grid(compose(grid.origin, there)).is_close_to(there, 1e-12)


@pytest.mark.parametrize("resolution", [0.1, 0.05, 0.025, 1.0, 0.03, 12.5, 0.0001])
def test_a_resolution_of_few_digits_travels_unchanged(resolution):
    assert as_travelled(resolution) == resolution
    field = struct.unpack("f", struct.pack("f", resolution))[0]
    assert as_travelled(field) == resolution


@given(st.floats(1e-4, 1e3))
def test_any_resolution_travels_unchanged_the_second_time(resolution):
    once = as_travelled(resolution)
    assert as_travelled(struct.unpack("f", struct.pack("f", once))[0]) == once
