"""The tests of test_lock_step.py for the ideal car, which reports its pose 2.5 times per second."""

import pytest
import rosgraph
from test_lock_step import TestLockStep  # noqa: F401

from support.world import LOCK_STEP, launch

pytestmark = pytest.mark.full


def start_world():
    master = rosgraph.Master("/launch")
    master.setParam("/busy", False)
    arguments = {"map": "none", "laser": False, "model": False, **LOCK_STEP}
    return launch("sim.launch", [("/car/car_sim/pose_rate", 2.5)], **arguments)
