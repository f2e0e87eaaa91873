"""The tests of test_lock_step.py for every plan, with an ideal car and 2.5 poses per second."""

import pytest
import rosgraph
import test_lock_step

from support.cars import PLAN_NAMES
from support.world import LOCK_STEP, launch

pytestmark = pytest.mark.full


def start_world():
    rosgraph.Master("/world").setParam("/busy", False)
    arguments = {"map": "none", "laser": False, "model": False, **LOCK_STEP}
    return launch("sim.launch", [("/car/car_sim/pose_rate", 2.5)], **arguments)


class TestEveryPlan(test_lock_step.TestLockStep):
    plans = PLAN_NAMES
