"""Cars and plans of the package, plans from text, and histories of simulated cars."""

import os

import pytest

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Command, InitialPose
from mushr_ros_intro.car.profile import car_from, names_in, read_profile
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.parse import parse_plan, read_plan
from support.paths import PACKAGE, PLANS

FOLDER = os.path.join(PACKAGE, "config", "cars")
PROFILES = {name: read_profile(os.path.join(FOLDER, f"{name}.yaml")) for name in names_in(FOLDER)}
CARS = {name: car_from(Parameters(values)) for name, values in PROFILES.items()}
PLAN_NAMES = sorted(entry[:-4] for entry in os.listdir(PLANS) if entry.endswith(".txt"))

MS = 1_000_000
SECOND = 1000 * MS
"""[ns]"""

BEGIN = 1_700_000_000 * SECOND
"""The instant of the offset 0 [ns]."""

ROUNDING = 1e-12
"""[m, rad, m/s] The error of some operations on doubles of about 10."""


def plan_named(name):
    return read_plan(os.path.join(PLANS, f"{name}.txt"))


def _each_plan():
    for name in PLAN_NAMES:
        is_long = plan_named(name).duration > 10 * SECOND
        yield pytest.param(name, marks=pytest.mark.full) if is_long else name


EACH_PLAN = list(_each_plan())
"""The parameters of a test of each plan; long plans are driven with scripts/test --all only."""


def plan_of(text):
    return parse_plan(text.encode(), "my.txt")


def history_of(car, start, *events, world=None):
    """Return a history of events; each event arrives at its stamp.

    An event is an offset [ms] with a pose, or with a speed [m/s], a steering angle [rad] and
    optional rates.
    """
    history = History(car, start, world)
    for offset, *values in events:
        stamp = BEGIN + offset * MS
        kind = InitialPose if isinstance(values[0], Pose) else Command
        history.add(kind(stamp, *values), stamp)
    return history


def at(history, offset):
    """Return the state at an offset [ms]."""
    return history.state_at(BEGIN + round(offset * MS))
