"""Check that cars of two profiles end at the predicted pose; unit tests drive each profile."""

import contextlib
import re
import time

import pytest
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rosgraph_msgs.msg import Log

from support.geometry import planar
from support.helpers import Recording, Relay, RosTestCase, wait_for
from support.world import LOCK_STEP, launch

PROMISED = 1e-9
"""[m, rad] The largest difference between the predicted and the final pose."""

PRINTED = 1e-4
"""[m, rad] Accuracy of printed poses."""

ENDS = re.compile(r"should end at \((\S+) m, (\S+) m, (\S+) rad\)")
DIFFERENCE = re.compile(r"difference (\S+) m, (\S+) rad")


@contextlib.contextmanager
def car(**arguments):
    """Run a car in lock-step."""
    options = {"map": "none", "laser": False, "model": False}
    nodes = launch("sim.launch", **LOCK_STEP, **options, **arguments)
    try:
        yield
    finally:
        for each in nodes:
            each.end()
        rospy.delete_param("/car/car_sim")


pytestmark = pytest.mark.full


def start_world():
    return []  # each test starts its car


class TestProfiles(RosTestCase):
    def drive(self, plan, *arguments):
        """Drive a plan; return the predicted final pose."""
        began = time.monotonic()
        output = self.drive_plan(plan, "__name:=driver", *arguments)
        # There are progress lines, but at most 20 per second.
        lines = output.count(" s left\n")
        self.assertGreaterEqual(lines, 1)
        self.assertLessEqual(lines, 1 + 20 * (time.monotonic() - began))
        for difference in map(float, DIFFERENCE.search(output).groups()):
            self.assertLess(difference, PROMISED)
        return tuple(map(float, ENDS.search(output).groups()))

    def test_two_profiles(self):
        ends = set()
        log = Recording("/rosout", Log)
        at_its_limits = self.plan("0, 0, 0\n0.9286, 0.3158, 0.2\n-0.9286, -0.4211, 0.2\n")
        paths = Recording("/car/predicted_path", Path)

        def path_of_figure_8():  # the longest plan
            return next((each for each in paths.messages if len(each.poses) > 2200), None)

        def wait_for_path(_):
            wait_for(path_of_figure_8, "the predicted path")

        for profile in ("racecar_mit", "mushr_nano"):
            with car(car=profile):
                if profile == "mushr_nano":
                    log.connected().clear()
                    self.drive(at_its_limits)
                ends.add(self.drive("parallel_parking"))
                if profile == "mushr_nano":
                    # The node waits for the start pose until its path has arrived.
                    held, kind = "/held/initialpose", PoseWithCovarianceStamped
                    self.ending(Relay(held, "/initialpose", kind, wait_for_path))
                    figure_8 = self.drive("figure_8", f"_init_pose_topic:={held}")

        # The car warns of a plan that exceeds its limits, but not of one that reaches them.
        def warnings():
            return [m.msg for m in log.messages if "within its limits" in m.msg]

        self.assertIn("asks for 1 m/s and 0 rad", wait_for(warnings, "a warning")[0])

        self.assertEqual(len(ends), 2)  # the profiles differ

        self.check_path(path_of_figure_8(), figure_8)

    def check_path(self, path, end):
        self.assertEqual(path.header.frame_id, "map")
        self.assertEqual({pose.header.frame_id for pose in path.poses}, {"map"})
        self.assertEqual(planar(path.poses[0].pose)[:2], (0.0, 0.0))
        self.assert_pose(planar(path.poses[-1].pose), end, PRINTED)
        stamps = [(pose.header.stamp - path.header.stamp).to_nsec() for pose in path.poses]
        self.assertEqual(stamps[:2201], list(range(0, 22_010_000_000, 10_000_000)))
        # Braking from 0.929 m/s takes 0.24 s.
        self.assertAlmostEqual(stamps[-1] / 1e9, 22.0 + 0.9286 / 3.8889, delta=1e-3)
