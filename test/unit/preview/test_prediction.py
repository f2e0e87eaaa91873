"""Where a plan takes the car: the closed form, rounded as the commands are that travel."""

import cmath
import math
import os

import numpy as np
import pytest
import yaml

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.find import read_plan
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.world.footprint import Footprint
from mushr_ros_intro.world.grid import Grid
from support.paths import PLANS

SECOND = 1_000_000_000

TRAVELLED = 1e-9
"""[m] The digits to which the expected pose is known."""

ROUNDING = 1e-12
"""[m, rad] Between one arc a row and ten of them, in doubles."""

PROMISED = 1e-9
"""[m, rad] Between a prediction and the drive."""

WALLS = World(
    Grid(np.pad(np.zeros((40, 40), np.int8), 1, constant_values=100), 0.1, Pose(-2.1, -2.1, 0.0))
)
"""A room of 4 m by 4 m round the origin."""


def plan_named(name):
    return read_plan(os.path.join(PLANS, name + ".txt"))


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
        speed, angle = row.speed, row.steering_angle
        for stamp in range(due, due + row.duration, SECOND // 10):
            history.add(Command(stamp, speed, angle), stamp)
        due += row.duration
    history.add(Command(due, 0.0, 0.0), due)
    final = history.state_at(due + SECOND).pose
    assert final == pytest.approx(next(predicted), abs=ROUNDING)
    assert final == pytest.approx(prediction.final_pose(plan, car), abs=ROUNDING)


def states_of(car, plan, world):
    """Drive with the commands that path_publisher sends; return where the car is every 0.1 s."""
    due = 1000 * SECOND
    history = History(car, at_rest(due - SECOND, Pose(9.0, 9.0, 9.0)), world)
    history.add(Command(due - SECOND, 1.0, 0.2), due - SECOND)
    history.add(InitialPose(due - SECOND // 10, Pose(*plan.start)), due - SECOND // 10)
    states = []
    for row in plan.rows:
        speed, angle = row.speed, row.steering_angle
        for stamp in range(due, due + row.duration, SECOND // 10):
            history.add(Command(stamp, speed, angle), stamp)
            states.append(history.state_at(stamp))
        due += row.duration
    history.add(Command(due, 0.0, 0.0), due)
    history.add(Command(due + SECOND // 5, 0.0, 0.0), due + SECOND // 5)  # the mux's own stop
    states += [history.state_at(due), history.state_at(due + 60 * SECOND)]
    return [state._replace(stamp=state.stamp - 1000 * SECOND) for state in states]


@pytest.mark.parametrize("profile", ["ideal", "mushr_nano", "mushr_tx2", "racecar_mit"])
@pytest.mark.parametrize("name", sorted(entry[:-4] for entry in os.listdir(PLANS)))
@pytest.mark.parametrize("noise, walls", [(False, False), (True, False), (False, True)])
def test_every_car_does_what_was_predicted(name, profile, noise, walls):
    with open(os.path.join(PLANS, "..", "config", "cars", f"{profile}.yaml")) as file:
        values = yaml.safe_load(file)
    car = car_from(Parameters({**values, "noise": noise, "seed": 3}, "~"))
    world = WALLS if walls else None
    plan = plan_named(name)
    states = states_of(car, plan, world)
    last = states.pop()
    predicted = list(prediction.trajectory(plan, car, SECOND // 100, world))
    assert [state.stamp for state in predicted[:-1]] == [
        number * SECOND // 100 for number in range(len(predicted) - 1)
    ]
    at = {state.stamp: state for state in predicted}
    for state in states:
        if state.stamp in at:  # rows of other lengths than tenths of a second begin between
            assert state.pose == pytest.approx(at[state.stamp].pose, abs=PROMISED)
            assert (state.collision is None) == (at[state.stamp].collision is None)
    assert predicted[-1].speed == last.speed == 0.0
    assert last.pose == pytest.approx(predicted[-1].pose, abs=PROMISED)
    assert last.pose == pytest.approx(prediction.final_pose(plan, car, world), abs=PROMISED)
    ends = [state.pose for state in states if state.stamp in row_ends(plan)]
    rows = list(prediction.row_poses(plan, car, world))
    assert len(ends) == len(rows) == len(plan.rows) + 1
    for one, other in zip(ends, rows):
        assert one == pytest.approx(other, abs=PROMISED)


def test_a_car_with_noise_in_its_steering_alone_does_what_was_predicted():
    plan = parse_plan(b"0,0,0\n1,0.1\n", "plan")
    car = Car(steering_noise=0.1, seed=3)
    last = states_of(car, plan, None)[-1]
    assert last.pose == pytest.approx(prediction.final_pose(plan, car), abs=PROMISED)


@pytest.mark.parametrize(
    "profile, noise", [("ideal", False), ("mushr_nano", False), ("mushr_nano", True)]
)
def test_where_the_car_is_at_any_instants(profile, noise):
    """The same as where the simulated car is then; before the first command, at the start."""
    with open(os.path.join(PLANS, "..", "config", "cars", f"{profile}.yaml")) as file:
        car = car_from(Parameters({**yaml.safe_load(file), "noise": noise, "seed": 3}, "~"))
    plan = plan_named("figure_8")
    states = states_of(car, plan, None)
    instants = [state.stamp for state in states]
    before, *then = prediction.states_at(plan, car, [-SECOND, *instants])
    assert before.pose == plan.start
    for one, other in zip(then, states):
        assert one.pose == pytest.approx(other.pose, abs=PROMISED)
        assert one.speed == pytest.approx(other.speed, abs=PROMISED)
    assert len(then) == len(states)


def row_ends(plan):
    ends = [0]
    for row in plan.rows:
        ends.append(ends[-1] + row.duration)
    return ends


def test_walls_are_hit_on_the_way():
    """Or the test above would show little."""
    plan = plan_named("straight_line")
    end = prediction.final_pose(plan, Car(), WALLS)
    assert end.x == pytest.approx(2.0 - Footprint().front, abs=1e-8)  # [m] narrowed down to 1e-9
    assert any(state.collision for state in prediction.trajectory(plan, Car(), SECOND, WALLS))


def test_a_car_that_forgets_a_command_before_the_next_one_stops_between_them():
    plan = parse_plan(b"0,0,0\n1,0\n", "plan")
    forgetful = Car(command_timeout=SECOND // 20)
    assert prediction.final_pose(plan, forgetful).x == pytest.approx(0.5, abs=ROUNDING)


def test_a_limited_car_comes_to_rest_after_the_end():
    plan = parse_plan(b"0,0,0\n0.5,0\n", "plan")
    car = Car(acceleration=2.5)
    assert prediction.rest(plan, car) == (12 * SECOND // 10, pytest.approx((0.5, 0, 0)))
    assert prediction.rest(plan, Car()) == (SECOND, (0.5, 0.0, 0.0))
    stamps = [state.stamp for state in prediction.trajectory(plan, car, SECOND // 2)]
    assert stamps == [0, SECOND // 2, SECOND, 12 * SECOND // 10]


def test_the_ideal_car_s_trajectory_is_figure_8_s_closed_form():
    """Each arc by its turning centre, in complex numbers."""
    plan = plan_named("figure_8")
    states = {s.stamp: s for s in prediction.trajectory(plan, Car(), SECOND // 10)}
    position, heading = complex(*plan.start[:2]), plan.start[2]
    for number, row in enumerate(plan.rows):
        speed, angle = row.speed, row.steering_angle
        rate = speed * math.tan(angle) / 0.33
        for tenth in range(10):
            turned = heading + rate * tenth / 10
            there = position + speed / rate * 1j * (
                cmath.exp(1j * heading) - cmath.exp(1j * turned)
            )
            got = states[number * SECOND + tenth * SECOND // 10].pose
            assert got == pytest.approx((there.real, there.imag, turned), abs=ROUNDING)
        turned = heading + rate
        position += speed / rate * 1j * (cmath.exp(1j * heading) - cmath.exp(1j * turned))
        heading = turned
