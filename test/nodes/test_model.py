"""Check the frames of the models of two cars."""

import math
import unittest

import rospy
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from tf.transformations import euler_from_quaternion
from tf2_msgs.msg import TFMessage

from support.helpers import PATIENCE, publisher, wait_for
from support.messages import command
from support.world import launch

ROUNDING = 1e-6
"""[m, rad] The rounding errors of robot_state_publisher."""

STEERING_ANGLE = 0.34
"""[rad] Of the virtual middle front wheel."""


def start_world():
    cars = ("car", "second")
    arguments = {"map": "none", "laser": False, "watched": False}
    return [each for car in cars for each in launch("sim.launch", car_name=car, **arguments)]


class TestModel(unittest.TestCase):
    def setUp(self):
        self.names = set()
        for topic in ("/tf", "/tf_static"):
            rospy.Subscriber(topic, TFMessage, self.note_names)
        self.buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.buffer)

    def note_names(self, msg):
        for transform in msg.transforms:
            self.names |= {transform.header.frame_id, transform.child_frame_id}

    def lookup(self, target, source):
        """Wait for a transform between two frames; return the newest one."""
        wait = rospy.Duration(PATIENCE)
        return self.buffer.lookup_transform(target, source, rospy.Time(0), wait).transform

    def test_frames(self):
        """All frames are connected to the map. Their names begin with that of their car."""
        for car in ("car", "second"):
            laser = self.lookup(f"{car}/base_footprint", f"{car}/laser_link").translation
            expected = (0.158 - 0.0353, 0.0, 0.0947 + 0.1078)
            self.assertLess(math.dist((laser.x, laser.y, laser.z), expected), ROUNDING)
            for end, x in (("front", 0.33), ("back", 0.0)):
                for side, y in (("left", 0.125), ("right", -0.125)):
                    wheel = self.lookup("map", f"{car}/{end}_{side}_wheel_link").translation
                    distance = math.dist((wheel.x, wheel.y, wheel.z), (x, y, 0.0488))
                    self.assertLess(distance, ROUNDING)
        strangers = [name for name in self.names if not name.startswith(("car/", "second/"))]
        self.assertEqual(strangers, ["map"])

    def test_steering(self):
        """Each front wheel is perpendicular to the line to the turning centre."""
        commands = publisher("/car/mux/ackermann_cmd_mux/input/default", AckermannDriveStamped)
        centre = 0.33 / math.tan(STEERING_ANGLE)
        expected = [math.atan2(0.33, centre - side) for side in (0.125, -0.125)]

        def is_steered():
            commands.publish(command(rospy.Time.now(), 0.0, STEERING_ANGLE))
            angles = []
            for side in ("left", "right"):
                link = f"car/front_{side}_wheel_steer_link"
                q = self.lookup("car/base_link", link).rotation
                angles.append(euler_from_quaternion((q.x, q.y, q.z, q.w))[2])
            return all(abs(a - b) <= ROUNDING for a, b in zip(angles, expected))

        wait_for(is_steered, f"the front wheels at {expected} rad")
