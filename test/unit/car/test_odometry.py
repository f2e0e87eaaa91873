"""The measured odometry: gains and the steering offset are not in it, and it drifts."""

import math

import numpy as np
import pytest

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest
from mushr_ros_intro.car.odometry import Odometer
from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.stamps import NANOSECONDS

START = Pose(3.0, -2.0, 2.5)
COMMANDS = ((1.0, 0.3), (2.0, -0.1), (-1.5, 0.2), (0.0, 0.2), (1.0, -0.3))
"""[m/s, rad] One every 0.2 s."""
REPORT = NANOSECONDS // 25
MADE = 1e-12
"""[m, rad] Rounding errors."""


def drive(car, begin=0, history=None):
    """Return the states of a drive at 25 Hz, with its history."""
    history = history or History(car, at_rest(begin, START))
    for number, values in enumerate(COMMANDS):
        stamp = begin + number * NANOSECONDS // 5
        history.add(Command(stamp, *values), stamp)
    end = begin + len(COMMANDS) * NANOSECONDS // 5
    return [history.state_at(stamp) for stamp in range(begin, end, REPORT)], history


def readings(car):
    odometer = Odometer(car)
    states = [at_rest(0, START), *drive(car)[0]]
    return list(zip(states, map(odometer.read, states)))


def test_of_an_ideal_car_it_is_exact():
    for state, measured in readings(Car()):
        assert measured.state is state
        assert measured.yaw_rate == state.yaw_rate(Car())
        assert not measured.pose_covariance.any() and measured.twist_variances == (0.0, 0.0)


@pytest.mark.parametrize(
    "gains",
    [{"speed_gain": 0.9}, {"steering_gain": 1.2, "steering_offset": 0.05}],
)
def test_it_is_where_the_commands_would_have_led(gains):
    car = Car(**gains)
    expected, _ = drive(Car())
    found = readings(car)[1:]
    for ideal, (state, measured) in zip(expected, found):
        assert measured.state.odom_pose == pytest.approx(ideal.odom_pose, abs=MADE)
        assert measured.state.steering_angle == pytest.approx(ideal.steering_angle, abs=MADE)
        assert measured.state.pose == state.pose  # the true one
        assert compose(measured.state.map_from_odom, measured.state.odom_pose) == pytest.approx(
            state.pose, abs=MADE
        )
    (_, last), ideal = found[-1], expected[-1]
    assert last.state.speed == pytest.approx(ideal.speed, abs=1e-4)  # rounding
    assert last.yaw_rate == pytest.approx(ideal.yaw_rate(Car()), abs=1e-4)
    assert found[-1][0].odom_pose.distance_to(last.state.odom_pose) > 0.01


def test_the_covariance_is_that_of_the_errors():
    noise = {"odom_distance_noise": 0.02, "odom_heading_noise": 0.03}
    errors, twists = [], []
    for seed in range(100):
        _, last = readings(Car(seed=seed, **noise))[-1]
        truth = drive(Car())[0][-1]
        errors.append(np.subtract(last.state.odom_pose, truth.odom_pose))
        twists.append((last.state.speed - truth.speed, last.yaw_rate - truth.yaw_rate(Car())))
    squares = [error @ np.linalg.solve(last.pose_covariance, error) for error in errors]
    # The mean of 100 chi-squared numbers with 3 degrees of freedom, within 3 standard deviations.
    assert np.mean(squares) == pytest.approx(3.0, abs=3.0 * math.sqrt(6.0 / 100))
    variances = np.mean(np.square(twists), axis=0)
    assert variances == pytest.approx(last.twist_variances, rel=3.0 * math.sqrt(2.0 / 100))


def test_the_errors_repeat_after_a_placement():
    car = Car(odom_distance_noise=0.02, odom_heading_noise=0.03, seed=5)
    odometer = Odometer(car)
    ends, history, begin = [], None, 0
    for _ in range(2):
        states, history = drive(car, begin, history)
        first, *_, last = map(odometer.read, states)
        ends.append(last.state.odom_pose.distance_to(first.state.odom_pose))
        begin = states[-1].stamp + 10 * REPORT
        history.add(InitialPose(begin, START), begin)
    assert ends[0] == pytest.approx(ends[1], abs=MADE)
    straight = drive(Car())[0]
    assert ends[0] != pytest.approx(straight[-1].pose.distance_to(START), abs=1e-4)


def test_a_reset_sets_it_to_zero():
    car = Car(odom_distance_noise=0.02, odom_heading_noise=0.03)
    odometer = Odometer(car)
    for state in drive(car)[0]:
        odometer.read(state)
    zero = odometer.read(at_rest(2 * NANOSECONDS, START))
    assert zero.state.odom_pose == pytest.approx((0.0, 0.0, 0.0), abs=MADE)
    assert not zero.pose_covariance.any()
