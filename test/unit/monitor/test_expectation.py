"""Test the prediction of a drive."""

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.monitor import expectation
from mushr_ros_intro.monitor.expectation import predict, read_walls, receive_map
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.grid import Grid

PLAN = parse_plan(b"0,0,0\n1,0.1\n1,-0.1\n-1,0\n", "plan.txt")
FREE = Grid(np.zeros((80, 80), np.int8), 0.1, Pose(-4.0, -4.0, 0.0))
ROOM = Grid(np.pad(np.zeros((20, 20), np.int8), 1, constant_values=100), 0.1, Pose(-1.1, -1.1, 0.0))
"""A room of 2 m by 2 m around the origin."""


@pytest.fixture
def begun(monkeypatch):
    """Return a list of the first commands that were simulated, one for each simulation."""
    begun = []
    apply = prediction.apply

    def count(state, command, *arguments):
        if command.stamp == 0:
            begun.append(command)
        return apply(state, command, *arguments)

    monkeypatch.setattr(prediction, "apply", count)
    return begun


@pytest.mark.parametrize("grid", [None, FREE])
def test_a_plan_is_simulated_once(grid, begun):
    report, states = predict(PLAN, "car", Car(), grid)
    assert len(begun) == 1
    assert states is report.states and not report.faults
    assert (states[-1].stamp, states[-1].pose) == prediction.rest(PLAN, Car())


@pytest.mark.parametrize(
    ("car", "grid"), [(Car(), ROOM), (Car(speed_noise=0.1), FREE), (Car(speed_noise=0.1), ROOM)]
)
def test_with_a_wall_or_noise_a_plan_is_simulated_twice(car, grid, begun):
    """The car reverses away from the wall, and the prediction contains this."""
    report, states = predict(PLAN, "car", car, grid)
    assert len(begun) == 2
    assert bool(report.collision) == (grid is ROOM)
    assert states[-1].pose != report.final_pose
    assert states[-1].stamp == PLAN.duration


NO_CAR, WITH_MAP, WITHOUT_MAP = (
    Parameters(values) for values in ({}, {"expects_map": True}, {"expects_map": False})
)
NOT_PLACED = "the car is not placed at the start pose of the plan"
NO_MAP = "no node publishes a map on /map"


@pytest.mark.parametrize(
    ("simulated", "is_placed", "problem", "level"),
    [
        (WITH_MAP, True, NO_MAP, "warn"),
        (WITH_MAP, False, NOT_PLACED, "warn"),
        (WITHOUT_MAP, True, NO_MAP, "info"),
        (NO_CAR, True, NO_MAP, "warn"),
        (NO_CAR, False, NOT_PLACED, "info"),  # an actual car
    ],
)
def test_walls_that_cannot_be_checked(monkeypatch, simulated, is_placed, problem, level):
    """A warning, unless the car is known to have no walls."""

    def read_no_map(is_expected):
        assert is_expected == (simulated is WITH_MAP)
        raise UserError(NO_MAP)

    logged = []
    monkeypatch.setattr(expectation, "receive_map", read_no_map)
    for each in ("info", "warn"):
        log = lambda text, *values, each=each: logged.append((each, text % values))  # noqa: E731
        monkeypatch.setattr(expectation.rospy, f"log{each}", log)
    assert read_walls(simulated, is_placed) is None
    assert logged == [(level, f"walls are not checked: {problem}")]


def test_a_map_that_can_be_read(monkeypatch):
    monkeypatch.setattr(expectation, "receive_map", lambda is_expected: ROOM)
    assert read_walls(WITH_MAP, is_placed=True) is ROOM


def test_a_map_whose_node_starts_with_the_car(monkeypatch):
    msg = conversions.grid_to_msg(ROOM, 0, "map")
    monkeypatch.setattr(expectation, "is_published", lambda topic: False)
    monkeypatch.setattr(expectation.rospy, "wait_for_message", lambda *_: msg)
    assert np.array_equal(receive_map(is_expected=True).cells, ROOM.cells)
    with pytest.raises(UserError, match="no node publishes a map on /map"):
        receive_map(is_expected=False)
