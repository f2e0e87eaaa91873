"""Where a plan takes the car: the closed form, rounded as the commands are that travel."""

import os

import pytest

from mushr_ros_intro import prediction
from mushr_ros_intro.bicycle import Pose
from mushr_ros_intro.car import Car, Command, History, at_rest
from mushr_ros_intro.plan import parse_plan, read_plan

PLANS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "plans")

SECOND = 1_000_000_000

TRAVELLED = 1e-9
"""[m] The digits to which the expected pose is known."""

ROUNDING = 1e-12
"""[m, rad] Between one arc a row and ten of them, in doubles."""


def plan_named(name):
    return read_plan(os.path.join(PLANS, name + ".txt"))


def test_as_float32():
    assert prediction.as_float32(0.5) == 0.5
    assert prediction.as_float32(0.09) == 0.09000000357627869
    assert prediction.as_float32(1e-46) == 0.0
    assert prediction.as_float32(2.0**24 + 1) == 2.0**24


def test_figure_8_ends_where_float32_commands_take_it():
    expected = (-1.547709166, -1.180325449, 0.785)
    assert prediction.final_pose(plan_named("figure_8"), Car()) == pytest.approx(
        expected, abs=TRAVELLED
    )


def test_straight_line_is_exact():
    plan = plan_named("straight_line")
    assert prediction.final_pose(plan, Car()) == (46.0, 0.0, 0.0)
    assert prediction.length(plan) == 46.0
    assert [pose.x for pose in prediction.row_poses(plan, Car())] == [
        *(0, 2, 5, 9, 14, 20, 26, 32, 37, 41, 44, 46)
    ]


def test_rows_begin_at_the_start_pose_and_last_their_duration():
    plan = parse_plan(b"1,2,0\n2,0,0.25\n-4,0,0.5\n0,0.3,9\n", "plan")
    assert list(prediction.row_poses(plan, Car())) == [
        (1.0, 2.0, 0.0),
        (1.5, 2.0, 0.0),
        (-0.5, 2.0, 0.0),
        (-0.5, 2.0, 0.0),
    ]
    assert prediction.length(plan) == 2.5


def test_the_wheelbase_counts():
    plan = parse_plan(b"0,0,0\n1,0.1\n", "plan")
    turns = [prediction.final_pose(plan, Car(wheelbase=length)).theta for length in (0.25, 0.5)]
    assert turns[0] == pytest.approx(2 * turns[1], rel=ROUNDING)


def test_circle_closes():
    pose = prediction.final_pose(plan_named("circle"), Car())
    assert pose[:2] == pytest.approx((0.0, 0.0), abs=1e-6)  # [m] what float32 commands allow


@pytest.mark.parametrize("name", sorted(entry[:-4] for entry in os.listdir(PLANS)))
def test_the_car_does_what_was_predicted(name):
    """Drive with a command every 0.1 s; each row ends where it was predicted to."""
    plan, car = plan_named(name), Car()
    due = 1000 * SECOND
    history = History(car, at_rest(due, Pose(*plan.start)))
    predicted = prediction.row_poses(plan, car)
    for row, expected in zip(plan.rows, predicted):
        assert history.state_at(due).pose == pytest.approx(expected, abs=ROUNDING)
        speed, angle = map(prediction.as_float32, (row.speed, row.steering_angle))
        for stamp in range(due, due + row.duration, SECOND // 10):
            history.add(Command(stamp, speed, angle), stamp)
        due += row.duration
    history.add(Command(due, 0.0, 0.0), due)
    final = history.state_at(due + SECOND).pose
    assert final == pytest.approx(next(predicted), abs=ROUNDING)
    assert final == pytest.approx(prediction.final_pose(plan, car), abs=ROUNDING)
