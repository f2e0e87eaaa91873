"""Check the simulated clock that the car publishes, at ten times real time."""

from test_clock import AnyFactor

from support.helpers import RosTestCase
from support.world import launch


def start_world():
    arguments = {"map": "none", "laser": False, "model": False, "watched": False}
    return launch("sim.launch", use_sim_time=True, real_time_factor=10.0, **arguments)


class TestFast(AnyFactor, RosTestCase):
    """The clock at ten times real time."""
