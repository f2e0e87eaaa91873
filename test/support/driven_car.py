"""The base class of tests with faults during a drive."""

import math

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from mushr_ros_intro.ros.connections import wait_until_connected
from support.geometry import closed_form, planar
from support.helpers import Recording, RosTestCase, node, publisher
from support.messages import COMMAND_TIMEOUT, NAVIGATION, OUTPUT, at, command, placement

LEAD = 0.4
"""[s] The stamp of the first message is in the future by this time."""
ROWS = [(2.0, 0.3, 0.1), (-1.0, -0.2, 0.1), (1.5, 0.1, COMMAND_TIMEOUT)]
"""[m/s, rad, s]"""


def start_car(**environment):
    """Start the car and its mux."""
    return (
        node("car_sim.py", "__ns:=/car", "initialpose:=/initialpose", **environment),
        node("ackermann_cmd_mux.py", "__ns:=/car/mux", **environment),
    )


class DrivenCarTestCase(RosTestCase):
    """A test case with recordings of a car's topics.

    It starts the car and its mux, unless `starts_car` is False.
    """

    starts_car = True

    @classmethod
    def setUpClass(cls):
        cls.nodes = cls.car, cls.mux = start_car() if cls.starts_car else (None, None)
        cls.poses = Recording("/car/car_pose", PoseStamped).connected()
        cls.output = Recording(OUTPUT, AckermannDriveStamped).connected()
        cls.placements = publisher("/initialpose", PoseWithCovarianceStamped)
        cls.commands = publisher(NAVIGATION, AckermannDriveStamped)

    @classmethod
    def tearDownClass(cls):
        for each in filter(None, cls.nodes):
            each.end()

    def setUp(self):
        super().setUp()
        self.poses.clear()
        self.output.clear()

    def assert_recovered(self):
        """Fail unless the nodes run, the car stands, and a drive ends at the right pose."""
        for each in filter(None, self.nodes):
            self.assertTrue(each.running)
        for each in (self.placements, self.commands):
            self.assertTrue(wait_until_connected(each, "subscribers"))
        self.poses.pose_at_rest(rospy.Time.now())
        start = (1.0, 2.0, 0.5)
        self.placements.publish(placement(rospy.Time.now(), *start))
        self.poses.shows(start, rospy.Time())
        stamp = at(rospy.Time.now(), LEAD)
        for speed, angle, _ in ROWS:
            self.commands.publish(command(stamp, speed, angle))
            last, stamp = stamp, at(stamp, 0.1)
        self.output.after(at(last, -0.05))  # the mux has passed the last command
        pose = self.poses.pose_at_rest(max(rospy.Time.now(), at(stamp, COMMAND_TIMEOUT)))
        self.assert_pose(pose, closed_form(start, ROWS))
        for msg in self.poses.messages:
            self.assertTrue(all(map(math.isfinite, planar(msg.pose))))

    def count(self, speed):
        """Return how many commands with a speed [m/s] the mux has passed."""
        return sum(msg.drive.speed == speed for msg in self.output.messages)
