"""Many cars at once: against the single car, and against closed forms."""

import math

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview.spread import START_ERRORS, sample, spread
from support.cars import plan_named, plan_of

ROUNDING = 1e-11
"""[m, rad] Between one arc per row and one per command, in doubles."""

RAMPS = 0.003
"""[m, rad] Of the approximation of ramps by arcs; 1.1 mm was measured."""

SIGMAS = 5.0
"""Standard errors that a mean of random numbers may be off: by chance 1 in 2 million is."""

RUNS = 5_000

IDEAL = Car()
NANO = Car(
    wheelbase=0.3,
    speed_limit=0.9286,
    steering_limit_left=0.4375,
    steering_limit_right=0.26,
    acceleration=2.5,
    steering_rate=3.2,
)
TRIMMED = NANO._replace(speed_gain=0.9, steering_gain=1.1, steering_offset=-0.03)
CARS = [
    IDEAL,
    NANO,
    NANO._replace(steering_rate=math.inf),
    NANO._replace(acceleration=math.inf),
    TRIMMED,
]

WALK = 0.2 / 0.33 * 1e-4 * math.sqrt(sum((k + 0.5) ** 2 for k in range(100)))
"""[rad] Of random steering angles of 1e-4 rad, one per 0.2 m, summed up over 100 commands."""

NOISE = {"speed_noise": 0.05, "steering_noise": 0.02}
ALL = {"speed_gain_spread": 0.02, "steering_offset_spread": 0.01, **NOISE}


def drive(plan, car=IDEAL, runs=1, seed=1, start=(0.0, 0.0), **errors):
    """Return the final poses of a car with errors (runs, 3)."""
    return sample(plan, car._replace(**errors), runs, seed, start)[:, :3]


def assert_is(values, mean, deviation):
    """Assert that random values have a mean and a standard deviation, within their errors."""
    count = len(values)
    assert abs(values.mean() - mean) <= SIGMAS * deviation / math.sqrt(count)
    assert abs(values.var() / deviation**2 - 1.0) <= SIGMAS * math.sqrt(2.0 / count)


@pytest.mark.parametrize("car", CARS)
def test_without_errors_every_car_is_where_the_single_car_is(car):
    """After each row, so that no errors cancel out until the end."""
    plan = plan_named("slalom")
    for count in range(1, len(plan.rows) + 1):
        part = plan._replace(rows=plan.rows[:count])
        expected = np.array(prediction.rest(part, car)[1])
        poses = drive(part, car, 3)
        assert poses.shape == (3, 3)
        assert np.abs(poses - expected).max() <= (ROUNDING if car == IDEAL else RAMPS)


@pytest.mark.parametrize(
    "errors, deviations",
    [
        ({"speed_gain_spread": 0.1}, (0.1 * 20.0, 0.0, 0.0)),
        ({"speed_noise": 0.1}, (0.1 * 0.1 * math.sqrt(100), 0.0, 0.0)),
        ({"start": (0.05, 0.0)}, (0.05, 0.05, 0.0)),
        ({"start": (0.0, 0.001)}, (0.0, 20.0 * 0.001, 0.001)),
        # A constant angle is a parabola; a random one adds up to a random walk of the heading.
        ({"steering_offset_spread": 1e-4}, (0.0, 20.0**2 / 2 / 0.33 * 1e-4, 20.0 / 0.33 * 1e-4)),
        ({"steering_noise": 1e-4}, (0.0, WALK * 0.2, 0.2 / 0.33 * 1e-4 * math.sqrt(100))),
    ],
)
def test_straight_ahead_the_spread_is_known(errors, deviations):
    """100 commands of 0.1 s at 2 m/s are 20 m; a steep ramp delays both start and end."""
    car = Car(acceleration=100.0, steering_rate=100.0)
    poses = drive(plan_of("0, 0, 0\n2, 0, 10"), car, RUNS, **errors)
    for values, mean, deviation in zip(poses.T, (20.0, 0.0, 0.0), deviations):
        if deviation:
            assert_is(values, mean, deviation)
        else:
            assert values == pytest.approx(mean, abs=0.01)  # turning shortens the way forward


def test_errors_of_speed_and_steering_angle_are_independent():
    """Their product has the mean zero, between runs and between commands."""
    between_runs = {"speed_gain_spread": 0.02, "steering_offset_spread": 1e-3}
    for errors in (between_runs, {"speed_noise": 0.1, "steering_noise": 1e-3}):
        x, _, theta = drive(plan_of("0, 0, 0\n2, 0, 1"), runs=RUNS, **errors).T
        assert abs(np.corrcoef(x, theta)[0, 1]) <= SIGMAS / math.sqrt(RUNS)


def test_errors_are_added_after_the_command_has_been_cut_to_the_limits():
    plan, car = plan_of("0, 0, 0\n9, 0, 2"), Car(speed_limit=6.6)
    x = drive(plan, car, RUNS, speed_gain_spread=0.02)[:, 0]
    assert_is(x, 13.2, 0.02 * 13.2)


def test_a_car_that_stands_has_no_errors():
    poses = drive(plan_of("0, 0, 0\n0, 0.3, 5"), runs=100, **NOISE)
    assert (poses == 0.0).all()


def test_a_car_that_brakes_gets_no_new_errors():
    slow = Car(acceleration=0.5)
    plan = plan_of("0, 0, 0\n2, 0, 1\n0, 0, 3")
    poses = drive(plan, slow, 100, **NOISE)
    assert len(np.unique(poses[:, 2])) == 100
    halfway = plan._replace(rows=plan.rows[:1])  # the stop at the end of the plan brakes likewise
    assert poses == pytest.approx(drive(halfway, slow, 100, **NOISE), abs=ROUNDING)


def test_the_errors_are_those_of_the_car_and_of_placing_it():
    plan = plan_named("slalom")
    result = spread(plan, NANO._replace(**ALL), RUNS, 3)
    assert result.start_errors == START_ERRORS
    assert (result.poses == drive(plan, NANO, RUNS, 3, START_ERRORS, **ALL)).all()


def test_the_speed_gain_is_scaled():
    """It is 0.5 plus an error of 0.01, so 2 % of it."""
    car = IDEAL._replace(speed_gain=0.5, speed_gain_spread=0.01)
    assert spread(plan_named("circle"), car, 10, 1).start_errors == START_ERRORS
    x = drive(plan_of("0, 0, 0\n2, 0, 5"), car, RUNS)[:, 0]
    assert_is(x, 5.0, 0.02 * 5.0)


def test_the_planned_pose_and_distance_are_those_of_the_car_without_errors():
    """It turns round after 1 m at 2 m/s^2, and rolls out for 1 m."""
    plan = plan_of("0, 0, 0\n2, 0, 3\n-2, 0.1, 2")
    car = Car(acceleration=2.0, speed_noise=0.05)
    result = spread(plan, car, 2, 1)
    assert result.distance == pytest.approx(8.0)
    quiet = car._replace(speed_noise=0.0)
    assert result.planned == pytest.approx(prediction.rest(plan, quiet)[1], abs=RAMPS)
    expected = [math.dist(each[:2], result.planned[:2]) for each in result.poses]
    assert result.distances == pytest.approx(expected)


def test_without_noise_there_is_no_spread():
    result = spread(plan_named("circle"), IDEAL, 10, 1)
    assert result.start_errors == (0.0, 0.0)
    assert result.distances.max() <= ROUNDING
