"""Many cars at once: against the single car, and against the moments in closed form."""

import math
import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.find import read_plan
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview import spread as module
from mushr_ros_intro.preview.spread import Errors, ellipse, marks, sample, spread
from support.moments import moments
from support.paths import PLANS

ROUNDING = 1e-12
"""[m, rad] Between one arc per row and one per command, in doubles."""

RAMPS = 1e-6
"""[m, rad] Between two quadratures along a plan; 1e-7 was measured."""

SIGMAS = 5.0
"""Standard errors that a mean of random numbers may be off: by chance 1 in 2 million is."""

RUNS = 20_000

AT_THE_END = 10**9
"""[commands] Longer than any plan."""

IDEAL = Car()
NANO = Car(
    wheelbase=0.3,
    speed_limit=0.9286,
    steering_limit_left=0.4375,
    steering_limit_right=0.26,
    acceleration=2.5,
    steering_rate=3.2,
)
CARS = [IDEAL, NANO, NANO._replace(steering_rate=math.inf), NANO._replace(acceleration=math.inf)]

ALL = Errors(0.02, 0.01, 0.05, 0.03, 0.05, 0.02)
NOISE = Errors(speed=0.05, steering_angle=0.02)

NAMES = sorted(entry[:-4] for entry in os.listdir(PLANS))


def plan_named(name):
    return read_plan(os.path.join(PLANS, name + ".txt"))


def plan_of(*rows, start="0, 0, 0"):
    return parse_plan("\n".join((start, *rows)).encode(), "plan")


def drive(plan, errors, runs=1, seed=1, every=AT_THE_END, car=IDEAL):
    """Return the poses (instants, runs, 3)."""
    return np.concatenate(list(sample(plan, car, errors, runs, seed, every)), axis=1)


def assert_is(values, mean, deviation):
    """Assert that random values have a mean and a standard deviation, within their errors."""
    count = len(values)
    assert abs(values.mean() - mean) <= SIGMAS * deviation / math.sqrt(count)
    assert abs(values.var() / deviation**2 - 1.0) <= SIGMAS * math.sqrt(2.0 / count)


# Without errors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("name", NAMES)
def test_without_errors_every_car_comes_to_rest_at_the_final_pose(name, car):
    plan = plan_named(name)
    poses = drive(plan, Errors(), runs=3, car=car)
    assert poses.shape == (1, 3, 3)
    expected = np.array(prediction.final_pose(plan, car))
    assert np.abs(poses[0] - expected).max() <= (ROUNDING if car == IDEAL else RAMPS)


@given(
    st.lists(
        st.tuples(
            st.floats(-5, 5), st.floats(-0.6, 0.6), st.sampled_from([0.05, 0.1, 0.25, 1, 3.14])
        ),
        min_size=1,
        max_size=6,
    ),
    st.integers(1, 20),
    st.sampled_from(CARS),
)
def test_without_errors_the_cars_are_where_the_single_car_is(rows, every, car):
    plan = plan_of(*("{:.6f}, {:.6f}, {}".format(*row) for row in rows), start="1, 2, 3")
    poses = drive(plan, Errors(), every=every, car=car)[:, 0]
    instants = marks(plan, every)
    assert len(instants) == len(poses)
    assert instants[-1] == plan.duration
    expected = [state.pose for state in prediction.states_at(plan, car, instants[:-1])]
    expected.append(prediction.final_pose(plan, car))
    assert np.abs(poses - np.array(expected)).max() <= (ROUNDING if car == IDEAL else RAMPS)


@pytest.mark.parametrize("angle", [0.0, 1e-30, 1e-15, 1e-8, 0.0099, -0.0099])
def test_there_is_no_dead_band(angle):
    plan = plan_of(f"2, {angle}, 22")
    expected = np.array(prediction.final_pose(plan, IDEAL))
    assert np.abs(drive(plan, Errors())[0, 0] - expected).max() <= ROUNDING


def test_marks_are_ends_of_commands():
    plan = plan_of("1, 0, 0.25", "1, 0, 0.3")
    for every, expected in (
        (1, [100, 200, 250, 350, 450, 550]),
        (3, [250, 550]),
        (4, [350, 550]),
        (AT_THE_END, [550]),
    ):
        assert [round(each / 1e6) for each in marks(plan, every)] == expected


# The errors -------------------------------------------------------------------------------------


@pytest.mark.parametrize("errors", [NOISE, ALL])
@pytest.mark.parametrize("name", ["figure_8", "parallel_parking", "slalom"])
def test_mean_and_covariance_are_those_in_closed_form(name, errors):
    """Every entry, within its standard error."""
    plan = plan_named(name)
    expected_mean, expected_covariance = moments(plan, errors)
    poses = drive(plan, errors, runs=RUNS)[-1]
    deviations = poses - expected_mean
    products = deviations[:, :, np.newaxis] * deviations[:, np.newaxis, :]
    for values, expected in ((poses, expected_mean), (products, expected_covariance)):
        error = values.std(axis=0) / math.sqrt(RUNS)
        assert (np.abs(values.mean(axis=0) - expected) <= SIGMAS * error + ROUNDING).all()


@pytest.mark.parametrize(
    "errors, deviation",
    [
        (Errors(speed_scale=0.1), 0.1 * 20.0),
        (Errors(speed=0.1), 0.1 * 0.1 * math.sqrt(100)),
    ],
)
@pytest.mark.parametrize("car", [IDEAL, Car(acceleration=1e6, steering_rate=1e6)])
def test_straight_ahead_the_spread_is_known(errors, deviation, car):
    """100 commands of 0.1 s at 2 m/s are 20 m; steep ramps change little."""
    x, y, theta = drive(plan_of("2, 0, 10"), errors, runs=RUNS, car=car)[0].T
    assert_is(x, 20.0, deviation)
    assert (y == 0.0).all()
    assert (theta == 0.0).all()


def test_errors_are_added_after_the_command_has_been_cut_to_the_limits():
    car = Car(speed_limit=6.6)
    x = drive(plan_of("9, 0, 2"), Errors(speed_scale=0.02), runs=RUNS, car=car)[-1, :, 0]
    assert_is(x, 13.2, 0.02 * 13.2)


def test_a_car_that_stands_has_no_errors():
    poses = drive(plan_of("0, 0.3, 5"), NOISE, runs=100)
    assert (poses == 0.0).all()


def test_a_car_that_brakes_gets_no_new_errors():
    slow = Car(acceleration=0.5)
    poses = drive(plan_of("2, 0, 1", "0, 0, 3"), NOISE, runs=100, every=10, car=slow)
    assert len(np.unique(poses[0, :, 2])) == 100
    assert (poses[:, :, 2] == poses[0, :, 2]).all()
    assert (np.diff(poses[:, :, 0], axis=0) >= 0.0).all()


def test_the_seed_decides():
    plan = plan_named("slalom")
    poses = drive(plan, ALL, runs=50, seed=7)
    assert (poses == drive(plan, ALL, runs=50, seed=7)).all()
    assert (poses[-1] == drive(plan, ALL, runs=50, seed=7, every=3)[-1]).all()
    assert (poses != drive(plan, ALL, runs=50, seed=8)).all()
    assert len(np.unique(poses[0, :, 0])) == 50


def test_cars_of_different_blocks_have_different_errors():
    x = drive(plan_of("1, 0"), Errors(speed_scale=0.1), runs=RUNS)[0, :, 0]
    assert len(np.unique(x)) == RUNS


# The result -------------------------------------------------------------------------------------


def test_the_result_is_the_mean_and_covariance_of_the_sample():
    plan, runs = plan_named("slalom"), 10_000  # in several blocks
    car = NANO._replace(speed_noise=0.05, steering_noise=0.02)
    result = spread(plan, car, runs, 3)
    poses = drive(plan, result.errors, runs=runs, seed=3, every=8, car=car)
    assert result.errors == module.RUN_ERRORS._replace(speed=0.05, steering_angle=0.02)
    assert (result.runs, len(result.seconds)) == (runs, 9)
    assert (result.cloud == poses[-1, : module.CLOUD]).all()
    assert result.seconds * 1e9 == pytest.approx(marks(plan, 8))
    for number, each in enumerate(poses):
        assert result.mean[number] == pytest.approx(each.mean(axis=0), abs=ROUNDING)
        assert result.covariance[number] == pytest.approx(np.cov(each.T), abs=ROUNDING)
        error = np.hypot(*(each - result.planned[number]).T[:2])
        rms = math.sqrt((error**2).mean())
        assert result.rms_errors[number] == pytest.approx(rms, rel=1.0 / runs)


def test_the_planned_poses_and_distances_are_those_of_the_car_without_errors():
    plan = plan_of("2, 0, 3", "-2, 0.1, 2")
    car = Car(acceleration=2.0, speed_noise=0.05)
    result = spread(plan, car, 2, 1)
    assert result.seconds.tolist() == pytest.approx([0.5 * number for number in range(1, 11)])
    ramp = [0.25, 1.0]  # a t^2 / 2
    there = [2.0, 3.0, 4.0, 5.0]
    back = [5.75, 6.0, 6.25, 7.0 + 1.0]  # it turns round after 1 m, and rolls out after the end
    assert result.distances.tolist() == pytest.approx(ramp + there + back)
    assert tuple(result.planned[2]) == pytest.approx((2.0, 0.0, 0.0))
    quiet = car._replace(speed_noise=0.0)
    assert tuple(result.planned[-1]) == tuple(prediction.final_pose(plan, quiet))


def test_an_error_of_the_speed_grows_with_the_distance(monkeypatch):
    monkeypatch.setattr(module, "RUN_ERRORS", Errors(speed_scale=0.02))
    result = spread(plan_of("1, 0, 20"), Car(speed_noise=1e-9), 4000, 1)
    assert result.growth == pytest.approx(1.0, abs=1e-3)
    assert result.rms_errors / result.distances == pytest.approx(0.02, rel=SIGMAS / math.sqrt(8000))


def test_without_noise_there_is_no_spread():
    result = spread(plan_named("circle"), IDEAL, 10, 1)
    assert result.errors == Errors()
    assert result.rms_errors.max() <= ROUNDING
    assert result.growth is None


def test_memory_does_not_grow_with_the_number_of_runs():
    plan, car = plan_of("1, 0.1, 0.3"), Car(speed_noise=0.1)
    peaks = []
    for runs in (20_000, 200_000):
        tracemalloc.start()
        result = spread(plan, car, runs, 1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(result.cloud) == module.CLOUD
    assert peaks[1] <= 1.1 * peaks[0]  # Python's own objects come and go


@pytest.mark.parametrize(
    "covariance, major, minor, direction",
    [
        ([[9.0, 0.0], [0.0, 1.0]], 3.0, 1.0, 0.0),
        ([[1.0, 0.0], [0.0, 9.0]], 3.0, 1.0, 0.5 * math.pi),
        ([[2.0, 1.0, 7.0], [1.0, 2.0, 7.0], [7.0, 7.0, 7.0]], 3.0**0.5, 1.0, 0.25 * math.pi),
        ([[4.0 / 49, 4.0 / 21], [4.0 / 21, 4.0 / 9]], 2.0 * 58**0.5 / 21, 0.0, math.atan2(7, 3)),
        ([[0.0, 0.0], [0.0, 0.0]], 0.0, 0.0, 0.0),
    ],
)
def test_ellipse(covariance, major, minor, direction):
    """The axes are the roots of the eigenvalues, times that of chi-square at 95 %."""
    factor = math.sqrt(-2.0 * math.log(0.05))
    expected = (factor * major, factor * minor, direction)
    assert ellipse(np.array(covariance)) == pytest.approx(expected, abs=1e-7)
