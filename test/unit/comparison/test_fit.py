"""The fit finds the parameters of simulated cars, and tells what it cannot find."""

import math
import random
import statistics

import pytest

from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.comparison import compare
from mushr_ros_intro.comparison.fit import fit
from mushr_ros_intro.comparison.fitted_car import Z_95, combined, fitted_value
from support.cars import CARS, plan_named, plan_of
from support.recorded_drive import driven

NANO = CARS["mushr_nano"]
NOISE = {"speed_noise": 0.013, "steering_noise": 0.01}

STANDARD_ERRORS = 3.5
"""Random errors exceed this in one of 2000 cases; the seeds are fixed."""

HIDDEN = {"speed_gain": 0.94, "steering_gain": 1.08, "steering_offset": 0.021}


def verdict(log, result, car=NANO):
    found, fitted = (compare(log, each, result.delay) for each in (car, result.car))
    return diagnosis.sentence(found, result, fitted), found, fitted


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
        assert abs(value.value - true) < STANDARD_ERRORS * value.error, name
    assert abs(result.delay - 0.45) < STANDARD_ERRORS * result.values["delay"].error
    assert result.position_noise == pytest.approx(0.02, rel=0.2)
    assert not result.misfit.is_found


def test_the_sentence_names_what_dominates(identified):
    text, found, fitted = verdict(*identified)
    assert "steers 0.02" in text
    assert "rad to the left" in text
    assert "% slower than commanded" in text
    assert fitted.rms < 0.2 * found.rms


def test_the_values_of_several_drives_are_the_means_of_their_fits():
    """The gains and offsets of the drives are chosen, so their standard deviations are known."""
    gains, offsets = (0.88, 0.96, 1.0), (0.02, -0.01, 0.04)
    plan = plan_of("0, 0, 0\n0.6, 0.2, 2\n0.6, -0.2, 2")
    logs = [
        driven(
            plan,
            NANO._replace(speed_gain=gain, steering_offset=offset, seed=seed, **NOISE),
            random.Random(seed),
            delay=0.1 * seed,
        )
        for seed, (gain, offset) in enumerate(zip(gains, offsets))
    ]
    result = combined([fit(log, NANO) for log in logs], NANO)
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
    assert "the drive does not determine steering_gain" in verdict(log, result)[0]
    text = "\n".join(diagnosis.fit_text(result, NANO))
    assert "identification.txt" in text


def test_a_car_as_in_its_profile_has_random_errors():
    plan = plan_of("0, 0, 0\n0.5, 0.2, 2\n0.5, -0.2, 2")
    log = driven(plan, NANO._replace(seed=2, **NOISE), random.Random(2), rate=5.0)
    text, _, _ = verdict(log, fit(log, NANO))
    assert "the fit explains none of it" in text


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
    text, _, _ = verdict(log, result)
    assert text.startswith("no car of this model drives like that: line 4 (distance)")
    note = "note: the drive differs from the fitted car by more than random errors"
    assert note in "\n".join(diagnosis.fit_text(result, NANO))
    assert "random errors" not in text


def test_a_drive_that_tells_nothing():
    plan = plan_of("0, 0, 0\n0.02, 0, 4")
    log = driven(plan, NANO, random.Random(1), rate=6.0)
    result = fit(log, NANO)
    assert not any(value.is_fitted for value in result.values.values())
    assert result.car[:12] == NANO[:12]
    assert "the fit explains none of it" in verdict(log, result)[0]


def test_the_range_of_a_rate_is_not_symmetric():
    """The inverse is fitted."""
    value = fitted_value("acceleration", 0.3, 0.2 / Z_95)
    assert (value.value, value.low, value.high) == pytest.approx((1.0 / 0.3, 2.0, 10.0))
    assert fitted_value("acceleration", 0.3, 0.31 / Z_95).high == math.inf
    none = fitted_value("acceleration", 1e-9, 0.2 / Z_95)
    assert (none.value, none.low, none.high) == pytest.approx((math.inf, 5.0, math.inf))


def test_poses_without_noise_may_be_computed_from_the_commands():
    plan = plan_of("0, 0, 0\n0.5, 0.2, 3")
    log = driven(plan, NANO, random.Random(4), rate=8.0, position=0.0, heading=0.0, delay=0.0)
    assert "cannot show a wrong gain" in "\n".join(diagnosis.fit_text(fit(log, NANO), NANO))
