"""The profiles of cars: the shipped ones, and errors in others."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.car.profile import NUMBERS, car_from, named_car, read_profile
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import ORIGIN
from mushr_ros_intro.parameters import Parameters
from support.cars import CARS, PROFILES

NOISES = {
    "speed_noise": 0.013,
    "steering_noise": 0.01,
    "speed_gain_spread": 0.02,
    "steering_offset_spread": 0.01,
    "odom_distance_noise": 0.01,
    "odom_heading_noise": 0.01,
}
"""Of mushr_nano."""


def test_profiles():
    assert CARS["ideal"] == Car() == car_from(Parameters({}))
    names = {name for name, *_ in NUMBERS}
    for name, values in PROFILES.items():
        # A second profile on the parameter server replaces every key.
        assert (
            set(values) == names
        ), f"expected NUMBERS of car/profile.py in config/cars/{name}.yaml"
    noisy = car_from(Parameters({**PROFILES["mushr_nano"], "noise": True, "seed": 7}))
    assert noisy == CARS["mushr_nano"]._replace(**NOISES, seed=7)
    assert str(Car()) == "ideal"
    slow = Car(speed_gain=0.9, command_timeout=300_000_000, seed=123456789)
    assert str(slow) == "ideal except command_timeout: 0.3, speed_gain: 0.9, seed: 123456789"
    assert [getattr(CARS["mushr_nano"], each) for each in NOISES] == [0.0] * 6


@pytest.mark.parametrize(
    "name, erpm_gain, servo_gain, servo_offset, max_erpm",
    [
        ("mushr_nano", -3500.0, 0.95, 0.55, 3250.0),
        ("mushr_tx2", -2000.0, 1.2135, 0.55, 3250.0),
        ("mushr_sim", 4614.0, -1.2135, 0.5304, 30500.0),
        ("racecar_mit", 4614.0, -1.2135, 0.5304, 3250.0),
    ],
)
def test_limits_are_those_of_the_motor_controller(
    name, erpm_gain, servo_gain, servo_offset, max_erpm
):
    """In MuSHR's vesc.yaml erpm and servo are gain * command + offset, and then clipped."""
    car = CARS[name]
    servo = sorted((servo - servo_offset) / servo_gain for servo in (0.15, 0.85))
    assert (-car.steering_limit_right, car.steering_limit_left) == pytest.approx(servo, abs=1e-4)
    assert car.speed_limit == pytest.approx(max_erpm / abs(erpm_gain), abs=1e-4)
    # throttle_interpolator changes erpm by at most `step`, and does so `step` times per second.
    step = abs(erpm_gain) * 2.5 / 75.0
    assert car.acceleration == pytest.approx(step * step / abs(erpm_gain), abs=1e-4)


@pytest.mark.parametrize(
    "name, value, expected",
    [
        ("wheelbase", 0.0, "from 0.01 to 100 m"),
        ("track", 0.0, "from 0.01 to 100 m"),
        ("wheel_radius", 0.0, "from 0.001 to 10 m"),
        ("command_timeout", 0.0, "from 0.001 to 10 s"),
        ("speed_limit", -1.0, "from 0.001 to inf m/s"),
        ("speed_limit", math.nan, "from 0.001 to inf m/s"),
        ("acceleration", 0, "from 0.01 to inf m/s^2"),
        ("steering_rate", 0.0, "from 0.01 to inf rad/s"),
        ("steering_limit_left", "wide", "from 0 to inf rad"),
        ("speed_gain", 0.0, "from 0.1 to 10"),
        ("steering_gain", math.nan, "from 0.1 to 10"),
        ("steering_offset", 1.0, "from -0.5 to 0.5 rad"),
        ("noise", 1, "true or false"),
        ("seed", 1.5, "a whole number"),
        ("speed_noise", math.inf, "from 0 to 10 m/s"),
        ("steering_noise", 2.0, "from 0 to 1 rad"),
        ("odom_distance_noise", -0.1, "from 0 to 10 m"),
        ("odom_heading_noise", math.nan, "from 0 to 10 rad"),
    ],
)
def test_a_bad_parameter(name, value, expected):
    with pytest.raises(UserError) as error:
        car_from(Parameters({name: value}, "/car/car_sim/"))
    assert str(error.value).startswith(f"parameter /car/car_sim/{name} is ")
    assert expected in str(error.value)


def test_a_broken_profile(tmp_path):
    (tmp_path / "mine.yaml").write_text("- wheelbase")
    with pytest.raises(UserError, match="expected parameters such as 'track: 0.25'"):
        read_profile(str(tmp_path / "mine.yaml"))


values = st.sampled_from(
    [0, -1, 1, 0.3, 1e-45, 1e30, 10**400, math.nan, math.inf, -math.inf]
    + [True, None, "", "1", [1.0], {"a": 1}]
)
keys = st.sampled_from(sorted(PROFILES["ideal"]))


@given(st.dictionaries(keys, values, max_size=3))
def test_any_parameters_make_a_car_or_an_error(values):
    """The car drives to a finite pose, or there is a clear error."""
    try:
        car = car_from(Parameters(values))
    except UserError as error:
        assert "; expected" in str(error)
        return
    driving = apply(at_rest(0, ORIGIN), Command(0, 1.0, 0.3), car)
    state = advance(driving, 10**9, car)
    assert all(map(math.isfinite, (*state.pose, *state.odom_pose)))


def test_a_misspelt_key(tmp_path):
    """The limit would not exist."""
    (tmp_path / "mine.yaml").write_text("wheelbase: 0.33\nspeed_limt: 0.5\n")
    with pytest.raises(UserError, match="speed_limt is 0.5; expected only the keys noise, wheel"):
        named_car("mine", str(tmp_path))
