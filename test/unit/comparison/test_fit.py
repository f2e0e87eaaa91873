"""The fit finds the parameters of simulated cars, and tells what it cannot find."""

import math
import random
import re
import statistics

import numpy as np
import pytest

from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.fit import Value, combined, fit
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import CARS, plan_named, plan_of
from support.recorded_drive import driven
from support.true_car import TrueCar, recorded

NANO = CARS["mushr_nano"]
NOISE = {"speed_noise": 0.013, "steering_noise": 0.01}

STANDARD_ERRORS = 3.5
"""Random errors exceed this in one of 2000 cases; the seeds are fixed."""

HIDDEN = {"speed_gain": 0.94, "steering_gain": 1.08, "steering_offset": 0.021}


@pytest.fixture(scope="module")
def identified():
    """Return the log of a drive of identification.txt by a car with hidden parameters, and its fit.

    The clocks of the commands and of the poses differ by 0.4 s.
    """
    car = NANO._replace(seed=5, **HIDDEN, **NOISE)
    log = driven(plan_named("identification"), car, random.Random(5), delay=0.45)
    return log, fit(log, NANO)


def test_hidden_parameters_are_found(identified):
    _, result = identified
    for name, true in HIDDEN.items():
        value = result.values[name]
        assert value.is_fitted
        assert value.error < 0.012, name
        assert abs(value.new - true) < STANDARD_ERRORS * value.error, name
    assert abs(result.delay - 0.45) < STANDARD_ERRORS * result.values["delay"].error
    assert result.position_noise == pytest.approx(0.02, rel=0.2)
    assert not result.misfit.is_found


def test_the_sentence_names_what_dominates(identified):
    text, result = diagnosis.sentence(*identified), identified[1]
    assert "steers 0.02" in text
    assert "rad to the left" in text
    assert "% slower than predicted" in text
    assert "the delay from a command to its effect is 0.4" in text
    assert result.path_error < 0.2 * result.profile_error
    assert (result.causes, result.is_certain, result.is_profile) == ((), True, True)


def test_a_change_is_that_from_the_profile(identified):
    log, _ = identified
    before = NANO._replace(speed_gain=0.8)
    assert re.search(
        r"is 1[67].\d % faster than predicted", diagnosis.sentence(log, fit(log, before))
    )


def test_the_values_of_several_drives_are_the_means_of_their_fits():
    """The gains and offsets of the drives are chosen, so their standard deviations are known."""
    gains, offsets = (0.86, 0.92, 0.88), (0.02, 0.03, 0.04)
    plan = plan_of("0, 0, 0\n0.6, 0.2, 2\n0.6, -0.2, 2")
    logs = [
        driven(
            plan,
            NANO._replace(speed_gain=gain, steering_offset=offset, seed=seed, **NOISE),
            random.Random(seed),
            delay=0.1 * seed,
            position=0.005,
            heading=0.005,
        )
        for seed, (gain, offset) in enumerate(zip(gains, offsets))
    ]
    result = combined([fit(log, NANO) for log in logs])
    assert result.car.speed_gain == pytest.approx(statistics.mean(gains), abs=0.015)
    assert result.car.steering_offset == pytest.approx(statistics.mean(offsets), abs=0.005)
    assert result.car.speed_gain_spread == pytest.approx(statistics.stdev(gains), rel=0.2)
    assert result.car.steering_offset_spread == pytest.approx(statistics.stdev(offsets), rel=0.2)
    value = result.values["speed_gain"]
    assert value.error == pytest.approx(result.car.speed_gain_spread / math.sqrt(3.0))


def test_a_straight_line_says_nothing_about_the_steering_gain():
    plan = plan_of("0, 0, 0\n0.5, 0, 4")
    log = driven(plan, NANO._replace(seed=1, **HIDDEN, **NOISE), random.Random(1), rate=6.0)
    result = fit(log, NANO)
    assert result.values["speed_gain"].is_fitted
    assert not result.values["steering_gain"].is_fitted
    assert result.car.steering_gain == NANO.steering_gain
    assert re.search(
        "the drive does not determine .*steering_gain.* plans/identification.txt",
        diagnosis.sentence(log, result),
    )


def test_a_car_as_in_its_profile_has_random_errors():
    plan = plan_of("0, 0, 0\n0.5, 0.2, 2\n0.5, -0.2, 2")
    log = driven(plan, NANO._replace(seed=2, **NOISE), random.Random(2), rate=5.0)
    result = fit(log, NANO)
    assert "no known cause explains more than random errors" in diagnosis.sentence(log, result)
    assert result.car[:12] == NANO[:12]


def test_a_drive_that_no_car_of_the_model_drives_is_a_misfit():
    """The car of the third row slips: it drives half as far as the others."""
    plan = plan_of("0, 0, 0\n0.6, 0.1, 2\n0.6, -0.1, 2\n0.6, 0.1, 2\n0.6, -0.1, 2")
    slipping = plan._replace(
        rows=tuple(
            row._replace(speed=0.5 * row.speed) if index == 2 else row
            for index, row in enumerate(plan.rows)
        )
    )
    log = driven(slipping, NANO._replace(seed=3, **NOISE), random.Random(3), rate=5.0)
    log = log._replace(plan=plan)
    result = fit(log, NANO)
    text = diagnosis.sentence(log, result)
    assert text.startswith(
        "nothing known explains this drive: from 4.0 s on (0.6 m/s, 0.1 rad), the distance"
    )
    assert not [*diagnosis.fit_text(result)]
    assert not result.is_certain


def test_a_misfit_after_the_last_command():
    """The car is pushed after its drive of 4 s."""
    plan = plan_of("0, 0, 0\n0.6, 0.1, 2\n0.6, -0.1, 2")
    log = driven(plan, NANO._replace(**NOISE), random.Random(3), rate=5.0)
    poses = log.poses.copy()
    poses[:, 1] += np.clip(log.stamps / NANOSECONDS - 4.5, 0.0, 1.0)
    text = diagnosis.sentence(log, fit(log._replace(poses=poses), NANO))
    assert text.startswith("nothing known explains this drive: from 4.0 s on (the end), ")


def test_two_centimetres_are_neither_a_misfit_nor_a_jump():
    """The car rolls on for 0.3 s after its stop, as a car with motion capture did."""
    plan = plan_of("0, 0, 0\n0.6, 0.1, 2\n0.6, -0.1, 2\n0.3, 0, 2")
    log = recorded(plan, TrueCar(), random.Random(1), 50.0, position=0.0003, heading=0.0003)
    since = log.stamps / NANOSECONDS - 6.2
    rolled = 0.02 * np.clip(since / 0.3, 0.0, 1.0)[:, None]
    headings = log.poses[:, 2]
    along = np.column_stack([np.cos(headings), np.sin(headings), np.zeros(len(headings))])
    result = fit(log._replace(poses=log.poses + rolled * along), NANO)
    assert (result.is_found, result.causes) == (True, ())


def test_a_healthy_car_has_no_cause():
    """Its random errors are larger than usual; understeer improves the criterion by 9.6."""
    car = TrueCar(speed_gain=0.96, steering_offset=0.01, speed_noise=0.03, steering_noise=0.02)
    log = recorded(plan_named("identification"), car, random.Random(3), 20.0)
    assert fit(log, NANO).causes == ()


def test_a_cause_that_makes_the_path_worse_is_none():
    """The headings are wrong for 0.4 s.

    A jump explains where this begins, but then the rest of the path turns.
    """
    car = TrueCar(speed_gain=0.96, steering_offset=0.01)
    log = recorded(
        plan_named("identification"), car, random.Random(1), 20.0, position=0.01, heading=0.01
    )
    seconds = log.stamps / NANOSECONDS
    is_wrong = (seconds > 4.0) & (seconds < 4.4)
    result = fit(log._replace(poses=log.poses + np.outer(is_wrong, (0.0, 0.0, 0.2))), NANO)
    assert (result.is_found, result.causes) == (True, ())
    assert result.path_error < 0.04  # and 0.11 with the jump


def test_a_drive_that_tells_nothing():
    plan = plan_of("0, 0, 0\n0.02, 0, 4")
    log = driven(plan, NANO, random.Random(1), rate=6.0)
    result = fit(log, NANO)
    assert not any(value.is_fitted for value in result.values.values())
    assert result.car[:12] == NANO[:12]
    assert "no known cause explains" in diagnosis.sentence(log, result)


def test_the_range_of_a_rate_is_not_symmetric():
    """The inverse is fitted."""
    value = Value("acceleration", 0.25, 0.3, 0.2 / 1.96)
    assert (value.new, *value.limits) == pytest.approx((1.0 / 0.3, 2.0, 10.0))
    assert value._replace(error=0.31 / 1.96).limits[1] == math.inf
    none = value._replace(number=1e-9)
    assert (none.new, *none.limits) == pytest.approx((math.inf, 5.0, math.inf))


def test_poses_without_noise_may_be_computed_from_the_commands():
    plan = plan_of("0, 0, 0\n0.5, 0.2, 3")
    log = driven(plan, NANO, random.Random(4), rate=8.0, position=0.0, heading=0.0, delay=0.0)
    assert "cannot show a wrong gain" in "\n".join(diagnosis.fit_text(fit(log, NANO)))


FAULTS = [
    (
        {"left_stop": 0.12},
        r"at most 0.1\d\d rad to the left or has 0.\d+ rad.*; to tell them apart: drive",
        False,
        False,
    ),
    ({"speed_cap": 0.45, "point": 0.2}, "reports the pose.* and drives at most 0.4", True, False),
    ({"speed_dead_band": 0.4}, r"does not move at commands below 0.3\d m/s", False, False),
    ({"steering_dead_band": 0.15}, r"does not steer at commands below 0.1\d\d rad", False, False),
    ({"imbalance": 0.08}, r"steers \d+% more to the left", False, False),
    ({"fading": 0.02}, r"loses \d.\d% of its speed", False, False),
    # Another gain may make up for some of the play, so a correction of the gain could do harm.
    ({"play": 0.08}, r"has 0.0\d\d rad of play", False, False),
    ({"speed_lag": 0.3}, r"follows a speed with a lag of 0.(2[5-9]|3[0-5]) s", True, False),
    ({"steering_lag": 0.3}, r"follows a steering angle with a lag of 0.[23]\d s", True, False),
    ({"understeer": 1.5}, r"turns less .* 1 / \(1 \+ [12].\d\d v\^2\)", False, False),
    ({"point": 0.2}, r"reports the pose of a point 0.(19|2\d) m in front of", True, True),
    (
        {"jump": (0.2, 0.1, 0.05), "jump_time": 5.0},
        "a localisation that jumps at 5.[01] s",
        True,
        True,
    ),
    ({"speed_gain": -0.95}, "drives backwards", True, False),
    ({"steering_gain": -1.05}, "steers to the other side", True, False),
    ({"steering_gain": 0.0}, "hardly steers", False, False),
]
"""Numbers of the true car, what is said, and whether the gains and a profile are right."""


@pytest.mark.parametrize(
    ("numbers", "expected", "is_certain", "is_profile"),
    [*FAULTS[:3], *(pytest.param(*each, marks=pytest.mark.full) for each in FAULTS[3:])],
    ids=str,
)
def test_the_fault_of_a_car_is_named(numbers, expected, is_certain, is_profile):
    car = TrueCar(**{"speed_gain": 0.96, "steering_offset": 0.01, **numbers})
    log = recorded(plan_named("identification"), car, random.Random(3), 20.0)
    result = fit(log, NANO)
    assert re.search(expected, diagnosis.sentence(log, result))
    assert (result.is_certain, result.is_profile) == (is_certain, is_profile)
    if is_certain:
        for name in ("speed_gain", "steering_gain", "steering_offset"):
            value = result.values[name]
            assert abs(value.new - getattr(car, name)) < STANDARD_ERRORS * value.error, name


def test_a_drive_at_one_speed_does_not_tell_a_slow_car_from_a_limited_one():
    car = TrueCar(speed_gain=0.8)
    log = recorded(plan_of("0, 0, 0\n0.5, 0.1, 3\n0.5, -0.1, 3"), car, random.Random(1), 20.0)
    result = fit(log, NANO)
    assert "speed_gain may also be a limit of the car" in diagnosis.sentence(log, result)
    assert not result.is_certain


def test_commands_that_are_missing_at_the_beginning():
    log = recorded(plan_named("identification"), TrueCar(), random.Random(1), 20.0, missing=0.85)
    result = fit(log, NANO)
    assert "commands are missing" in diagnosis.sentence(log, result)
    assert not [*diagnosis.fit_text(result)]
    assert not result.is_certain
