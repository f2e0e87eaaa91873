"""The prediction of a plan: against closed forms, and against the simulated car's history."""

import cmath
import math

import numpy as np
import pytest

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.world.footprint import Footprint, World
from mushr_ros_intro.world.grid import Grid
from support.cars import PROFILES, SECOND, plan_named, plan_of

ROUNDING = 1e-12
"""[m, rad] Between one arc per row and ten of them, in doubles."""

DRIVEN = 1e-9
"""[m, rad] Between a prediction and the drive."""

WALLS = World(
    Grid(np.pad(np.zeros((40, 40), np.int8), 1, constant_values=100), 0.1, Pose(-2.1, -2.1, 0.0))
)
"""A room of 4 m by 4 m around the origin."""


def test_the_trajectory_of_figure_8_consists_of_arcs():
    """Each arc by its turning centre, in complex numbers."""
    plan = plan_named("figure_8")
    states = {s.stamp: s for s in prediction.trajectory(plan, Car())}
    position, heading = complex(*plan.start[:2]), plan.start[2]
    for number, row in enumerate(plan.rows):
        rate = row.speed * math.tan(row.steering_angle) / 0.33
        for tenth in range(11):
            turned = heading + rate * tenth / 10
            chord = cmath.exp(1j * heading) - cmath.exp(1j * turned)
            point = position + row.speed / rate * 1j * chord
            pose = states[number * SECOND + tenth * SECOND // 10].pose
            assert pose == pytest.approx((point.real, point.imag, turned), abs=ROUNDING)
        position, heading = point, turned
    assert prediction.rest(plan, Car())[1] == pytest.approx(pose, abs=ROUNDING)


def test_a_straight_line_is_exact():
    plan = plan_named("straight_line")
    assert prediction.rest(plan, Car()) == (11 * SECOND, (46.0, 0.0, 0.0))
    assert prediction.length(plan) == 46.0
    states = prediction.states_at(plan, Car(), range(0, 12 * SECOND, SECOND))
    xs = (0, 2, 5, 9, 14, 20, 26, 32, 37, 41, 44, 46)
    assert [state.pose for state in states] == [(x, 0.0, 0.0) for x in xs]


def test_rows_have_durations_and_go_in_reverse():
    plan = plan_of("1,2,0\n2,0,0.25\n-4,0,0.5\n0,0.3,9\n")
    states = prediction.states_at(plan, Car(), [0, SECOND // 4, 3 * SECOND // 4, 10 * SECOND])
    assert [state.pose for state in states] == [(x, 2.0, 0.0) for x in (1.0, 1.5, -0.5, -0.5)]
    assert prediction.length(plan) == 2.5
    assert prediction.count_commands(plan) == 3 + 5 + 90


def test_when_a_car_with_limits_comes_to_rest():
    plan, car = plan_of("0,0,0\n0.5,0\n"), Car(acceleration=2.5)
    assert prediction.rest(plan, car) == (12 * SECOND // 10, pytest.approx((0.5, 0, 0)))
    stamps = [state.stamp for state in prediction.trajectory(plan, car)]
    assert stamps == list(range(0, 121 * SECOND // 100, SECOND // 100))
    plan = plan_of("0,0,0\n0.5,0\n0,0\n0,0\n")  # it is at rest before the end
    assert prediction.rest(plan, car) == (3 * SECOND, pytest.approx((0.5, 0, 0)))


def test_a_wall_stops_the_car():
    plan = plan_named("straight_line")
    end = prediction.rest(plan, Car(), WALLS)[1]
    assert end.x == pytest.approx(2.0 - Footprint().front, abs=1e-8)  # [m] walls are known to 1e-9
    assert any(state.collision for state in prediction.trajectory(plan, Car(), WALLS))


def driven(car, plan, world):
    """Drive with the commands of path_publisher; return the states every 0.1 s and at rest."""
    due = 1000 * SECOND
    history = History(car, at_rest(due - SECOND, Pose(9.0, 9.0, 9.0)), world)
    history.add(Command(due - SECOND, 1.0, 0.2), due - SECOND)
    history.add(InitialPose(due - SECOND // 10, plan.start), due - SECOND // 10)
    states = []
    for row in plan.rows:
        for stamp in range(due, due + row.duration, SECOND // 10):
            history.add(Command(stamp, row.speed, row.steering_angle), stamp)
            states.append(history.state_at(stamp))
        due += row.duration
    history.add(Command(due, 0.0, 0.0), due)
    history.add(Command(due + SECOND // 5, 0.0, 0.0), due + SECOND // 5)  # the stop of the mux
    states += [history.state_at(due), history.state_at(due + 60 * SECOND)]
    return [state._replace(stamp=state.stamp - 1000 * SECOND) for state in states]


def apart(some, others):
    """Return the largest difference between the poses and speeds of states [m, rad, m/s]."""
    one, other = (
        np.array([(*each.pose, each.speed) for each in group]) for group in (some, others)
    )
    return np.abs(one - other).max()


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(
    "name, noise, walls",
    [("parallel_parking", False, False), ("slalom", True, False), ("slalom", False, True)],
)
def test_every_car_drives_as_predicted(name, profile, noise, walls):
    car = car_from(Parameters({**PROFILES[profile], "noise": noise, "seed": 3}, "~"))
    world = WALLS if walls else None
    plan = plan_named(name)
    states = driven(car, plan, world)
    last = states.pop()

    instants = [-SECOND, *(state.stamp for state in states)]
    before, *predicted = prediction.states_at(plan, car, instants, world)
    assert (before.pose, before.speed) == (plan.start, 0.0)
    assert apart(predicted, states) < DRIVEN
    for one, other in zip(predicted, states):
        assert (one.collision is None) == (other.collision is None)

    trajectory = list(prediction.trajectory(plan, car, world))
    stamps = [number * SECOND // 100 for number in range(len(trajectory) - 1)]
    assert [state.stamp for state in trajectory[:-1]] == stamps
    at = {state.stamp: state for state in trajectory[:-1]}
    both = [state for state in states if state.stamp in at]
    assert apart([at[state.stamp] for state in both], both) < DRIVEN
    assert trajectory[-1].speed == last.speed == 0.0
    assert trajectory[-1].pose == pytest.approx(last.pose, abs=DRIVEN)
    assert prediction.rest(plan, car, world) == (trajectory[-1].stamp, trajectory[-1].pose)


def test_a_command_that_expires_when_the_stop_comes():
    """The car ignores the stop, and steers on while it brakes."""
    car = Car(acceleration=2.0, command_timeout=SECOND // 10)
    plan = plan_of("0, 0, 0\n2, 0.25, 1")
    assert prediction.rest(plan, car)[1] == pytest.approx(
        driven(car, plan, None)[-1].pose, abs=DRIVEN
    )


def test_noise_of_the_steering_angle_alone_is_drawn_for_each_command():
    plan, car = plan_of("0,0,0\n1,0.1\n"), Car(steering_noise=0.1, seed=3)
    last = driven(car, plan, None)[-1]
    assert last.pose == pytest.approx(prediction.rest(plan, car)[1], abs=DRIVEN)


def test_commands_that_expire_before_the_next_one():
    """A plain stop after the last command has expired does not turn the wheels back."""
    car = Car(acceleration=2.0, steering_rate=1.0, command_timeout=SECOND // 20)
    for text in ("0,0,0\n1,0.3\n", "0,0,0\n1,0.3\n0,0\n1,-0.2\n0,0\n"):
        last = driven(car, plan_of(text), None)[-1]
        assert last.pose == pytest.approx(prediction.rest(plan_of(text), car)[1], abs=DRIVEN)
