"""Cars without a fault take the same paths as the simulated car."""

import math

import numpy as np

from mushr_ros_intro.comparison.faults import NUMBERS, PARAMETERS, paths
from mushr_ros_intro.comparison.problem import numbers_of
from mushr_ros_intro.geometry import ORIGIN
from mushr_ros_intro.preview.prediction import states_at
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import CARS, plan_named

NO_NOISE = {"speed_noise": 0.0, "steering_noise": 0.0}

DEVIATION = 2e-3
"""Of the arcs of 0.04 s from the exact path of identification [m, rad]."""


def vector_of(car):
    """Return the numbers of a car without a fault."""
    return [*numbers_of(car), *(each.neutral for each in NUMBERS[len(PARAMETERS) :])]


def test_paths():
    """Each car has its own instants, also before the first command and after the rest."""
    plan = plan_named("identification")._replace(start=ORIGIN)
    gains = {"speed_gain": 0.93, "steering_gain": 1.1, "steering_offset": 0.02}
    nano = CARS["mushr_nano"]._replace(**gains, **NO_NOISE)
    cars = [nano, nano._replace(acceleration=math.inf), nano._replace(steering_rate=math.inf)]
    last = plan.duration / NANOSECONDS
    instants = np.array([np.linspace(-1.0, last + 1.0 + 0.1 * i, 200) for i in range(len(cars))])
    found = paths(plan, nano, np.array([vector_of(car) for car in cars]), instants)
    for car, each, path in zip(cars, instants, found):
        stamps = (each * NANOSECONDS).astype(int).tolist()
        exact = [state.pose for state in states_at(plan, car, stamps)]
        assert np.abs(path - exact).max() < DEVIATION


def test_only_the_instants_count_and_not_the_length_of_the_plan():
    """A recorded command may be years after the others."""
    plan = plan_named("identification")
    years = plan.rows[-1]._replace(duration=500_000_000 * NANOSECONDS)
    long = plan._replace(rows=(*plan.rows[:-1], years))
    car = CARS["mushr_nano"]._replace(**NO_NOISE)
    vectors, instants = np.array([vector_of(car)]), np.linspace(0.0, 5.0, 50)[None]
    assert np.array_equal(paths(long, car, vectors, instants), paths(plan, car, vectors, instants))
