"""The tests of test_lock_step.py for every plan, with an ideal car and 2.5 poses per second."""

import os

import pytest
import rosgraph
import test_lock_step

from support.paths import PLANS
from support.world import LOCK_STEP, launch

pytestmark = pytest.mark.full


def start_world():
    rosgraph.Master("/world").setParam("/busy", False)
    arguments = {"map": "none", "laser": False, "model": False, **LOCK_STEP}
    return launch("sim.launch", [("/car/car_sim/pose_rate", 2.5)], **arguments)


class TestEveryPlan(test_lock_step.TestLockStep):
    plans = sorted(os.path.splitext(name)[0] for name in os.listdir(PLANS))
