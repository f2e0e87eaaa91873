"""Cars that are driven side by side take the same paths as one car alone."""

import math

import numpy as np
import pytest

from mushr_ros_intro.preview.prediction import states_at
from mushr_ros_intro.preview.side_by_side import paths
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import CARS, plan_named

NO_NOISE = {"speed_noise": 0.0, "steering_noise": 0.0}

DEVIATION = 2e-4
"""Of the arcs of 0.01 s from the exact path [m, rad]; it is 1.6e-4 m with figure_8 at 2 m/s."""


@pytest.mark.parametrize("name", ["identification", "figure_8", "straight_line"])
def test_paths(name):
    """Each car has its own instants, also before the first command and after the rest."""
    plan = plan_named(name)
    gains = {"speed_gain": 0.93, "steering_gain": 1.1, "steering_offset": 0.02}
    cars = [CARS[each]._replace(**gains, **NO_NOISE) for each in ("mushr_nano", "mushr_tx2")]
    cars += [cars[0]._replace(acceleration=math.inf), cars[0]._replace(steering_rate=math.inf)]
    last = plan.duration / NANOSECONDS
    instants = np.array([np.linspace(-1.0, last + 1.0 + 0.1 * i, 200) for i in range(len(cars))])
    found = paths(plan, cars, instants)
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
    instants = np.linspace(0.0, 5.0, 50)[None]
    assert np.array_equal(paths(long, [car], instants), paths(plan, [car], instants))
