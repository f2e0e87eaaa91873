"""Test the prediction of a drive."""

import numpy as np
import pytest
import rospy

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.monitor import expectation
from mushr_ros_intro.monitor.expectation import predict, read_walls
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.footprint import BODY, POINT
from mushr_ros_intro.world.grid import Grid

PLAN = parse_plan(b"0,0,0\n1,0.1\n1,-0.1\n-1,0\n", "plan.txt")
FREE = Grid(np.zeros((80, 80), np.int8), 0.1, Pose(-4.0, -4.0, 0.0))
ROOM = Grid(np.pad(np.zeros((20, 20), np.int8), 1, constant_values=100), 0.1, Pose(-1.1, -1.1, 0.0))
"""A room of 2 m by 2 m around the origin."""


@pytest.mark.parametrize("grid", [None, FREE])
def test_a_drive_without_a_wall(grid):
    report, states = predict(PLAN, "car", Car(), grid)
    assert states is report.states and not report.faults
    assert (states[-1].stamp, states[-1].pose) == prediction.rest(PLAN, Car())


@pytest.mark.parametrize(
    ("car", "grid"), [(Car(), ROOM), (Car(speed_noise=0.1), FREE), (Car(speed_noise=0.1), ROOM)]
)
def test_a_drive_with_a_wall_or_noise(car, grid):
    """The car reverses away from the wall, and the prediction contains this."""
    report, states = predict(PLAN, "car", car, grid)
    assert bool(report.collision) == (grid is ROOM)
    assert states[-1].pose != report.final_pose
    assert states[-1].stamp == PLAN.duration


def test_walls_stop_only_the_point_at_the_rear_axle():
    """As in MuSHR's simulator: a wall 0.1 m beside the path stops the body only."""
    cells = np.zeros((80, 80), np.int8)
    cells[41:, 50:] = 100
    plan = parse_plan(b"0,0,0\n1,0\n1,0\n", "plan.txt")
    grid = Grid(cells, FREE.resolution, FREE.origin)
    ends = [predict(plan, "car", Car(), grid, each)[1][-1].pose.x for each in (BODY, POINT)]
    assert ends[0] < 1.0 and ends[1] == pytest.approx(2.0)
    assert predict(plan, "car", Car(), grid, POINT)[0].faults == ()


@pytest.fixture
def logged(monkeypatch):
    """Return a list of the messages in the log, each with its level."""
    logged = []
    for each in ("info", "warn"):
        log = lambda text, *values, each=each: logged.append((each, text % values))  # noqa: E731
        monkeypatch.setattr(expectation.rospy, f"log{each}", log)
    return logged


@pytest.mark.parametrize(
    ("expects_map", "is_placed", "problem", "level"),
    [
        (True, True, "the map on /map cannot be read: timeout", "warn"),
        (True, False, "the car is not placed at the start pose of the plan", "warn"),
        (False, True, "no node publishes a map on /map", "info"),
        (False, False, "the car is not placed at the start pose of the plan", "info"),
    ],
)
def test_walls_that_cannot_be_checked(monkeypatch, logged, expects_map, is_placed, problem, level):
    """A warning, if the car is known to have walls."""

    def wait(*_):
        raise rospy.ROSException("timeout")

    monkeypatch.setattr(expectation, "is_published", lambda topic: False)
    monkeypatch.setattr(expectation.rospy, "wait_for_message", wait)
    assert read_walls(expects_map, is_placed) is None
    ((got, text),) = logged
    assert got == level and text.startswith(f"walls are not checked: {problem}")


def test_a_map_whose_node_starts_with_the_car(monkeypatch):
    msg = conversions.grid_to_msg(ROOM, 0, "map")
    monkeypatch.setattr(expectation, "is_published", lambda topic: False)
    monkeypatch.setattr(expectation.rospy, "wait_for_message", lambda *_: msg)
    assert np.array_equal(read_walls(expects_map=True, is_placed=True).cells, ROOM.cells)
