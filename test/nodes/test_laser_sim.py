"""Check laser_sim. The test publishes the poses of the car."""

import math
import os
import sys

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import LaserScan

from support.helpers import Recording, RosTestCase, node, publisher, wait_for
from support.messages import placement
from support.paths import PACKAGE
from support.world import load

sys.path.append(os.path.join(PACKAGE, "src"))

HALF_TRACK = 1.4
"""[m] Distance of the walls from the middle of race_loop's straight."""
OFFSET = 0.1227
"""[m] Position of the scanner in front of the rear axle."""
EXACT = 2e-6
"""[m] Ranges and angles of the message are float32."""
BEAM = 90
"""Number of beams in an eighth of a turn; the first beam points backwards."""
LOST_DIGITS = 3e-6
"""[rad] angle_min is pi with six digits."""


def start_world():
    load("laser.yaml", "/car/laser_sim")
    load("laser.yaml", "/noisy/laser_sim")
    noisy = ("_noise_std:=0.01", "_seed:=3", "_offset:=0.0", "car_pose:=/car/car_pose")
    return [
        node("map_server.py", "_map_file:=race_loop"),
        node("laser_sim.py", "__ns:=/car"),
        node("laser_sim.py", "__ns:=/noisy", *noisy),
    ]


class TestLaserSim(RosTestCase):
    begin = 1_000_000

    def setUp(self):
        super().setUp()
        self.scans = Recording("/car/scan", LaserScan).connected()
        self.noisy = Recording("/noisy/scan", LaserScan).connected()
        self.poses = publisher("/car/car_pose", PoseStamped)
        wait_for(lambda: self.poses.get_num_connections() >= 2, "both lasers")
        # Stamps of different tests differ, because scans of the previous test may still arrive.
        TestLaserSim.begin += 1000
        self.stamp = rospy.Time(TestLaserSim.begin)

    def report(self, stamp, x, y, theta):
        placed = placement(stamp, x, y, theta)
        self.poses.publish(PoseStamped(header=placed.header, pose=placed.pose.pose))

    def scan_of(self, x, y, theta):
        """Return both scans at a pose; publish it until the lasers have their map."""

        def find():
            self.stamp += rospy.Duration(0.1)
            self.report(self.stamp, x, y, theta)
            both = []
            for recording in (self.scans, self.noisy):
                try:
                    both.append(recording.after(begin, 0.2))
                except AssertionError:
                    return None
            return both

        self.stamp += rospy.Duration(1)
        begin = self.stamp
        return wait_for(find, "a scan")

    def since(self, begin):
        """Return the stamps of the scans since `begin` [ns]; older ones may still arrive."""
        stamps = [(scan.header.stamp - begin).to_nsec() for scan in self.scans.messages]
        return [stamp for stamp in stamps if stamp >= 0]

    def test_ranges_and_noise(self):
        scan, noisy = self.scan_of(0.0, 0.4, 0.0)
        self.assertEqual(scan.header.frame_id, "car/laser_link")
        self.assertEqual(noisy.header.frame_id, "noisy/laser_link")
        self.assertEqual(len(scan.ranges), 720)
        self.assertAlmostEqual(scan.angle_min, -3.14159, delta=LOST_DIGITS)
        last = scan.angle_min + 719 * scan.angle_increment
        self.assertAlmostEqual(scan.angle_max, last, delta=1e-5)
        self.assertAlmostEqual(scan.range_max, 10.0)
        right, left = scan.ranges[2 * BEAM], scan.ranges[6 * BEAM]
        self.assertAlmostEqual(right, HALF_TRACK + 0.4, delta=EXACT)
        self.assertAlmostEqual(left, HALF_TRACK - 0.4, delta=EXACT)
        # There is noise of about 0.01 m.
        differences = [a - b for a, b in zip(noisy.ranges[170:190], scan.ranges[170:190])]
        self.assertGreater(max(map(abs, differences)), 1e-4)
        self.assertLess(max(map(abs, differences)), 0.1)

    def test_offset(self):
        """The scanner is in front of the rear axle."""
        scan, _ = self.scan_of(2.0, 0.0, math.pi / 2)
        self.assertAlmostEqual(scan.ranges[4 * BEAM], HALF_TRACK - OFFSET, delta=EXACT)

    def test_ten_scans_a_second_by_the_stamps(self):
        """At 50 Hz there is a scan at every fifth pose, with its stamp, at any speed of arrival."""
        self.scan_of(0.0, 0.0, 0.0)
        begin = self.stamp + rospy.Duration(100)
        for number in range(51):
            stamp = begin + rospy.Duration(0, number * 20_000_000)
            self.report(stamp, 0.01 * number, 0.0, 0.0)
            if number % 5 == 0:
                self.scans.first(lambda scan, s=stamp: scan.header.stamp >= s, "the next scan")
        self.assertEqual(self.since(begin), [number * 100_000_000 for number in range(11)])

    def test_bad_parameters(self):
        message = "900 beams are 0.00872665 rad apart; expected at least one beam, and"
        self.assert_refused(("laser_sim.py", ["_beams:=900"], message))
