#!/usr/bin/python3
"""The frames of the car's model, as robot_state_publisher serves them to a car of any name."""

import math
import unittest

import rospy
import rostest
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from tf.transformations import euler_from_quaternion
from tf2_msgs.msg import TFMessage

PATIENCE = 20.0
"""For anything that must happen [s]; on a busy machine nodes take long to start."""

ROUNDING = 1e-6
"""Of lengths and angles [m, rad]: robot_state_publisher rounds rotations on the way."""

STEERING_ANGLE = 0.34
"""Of the virtual middle front wheel [rad]."""


class ModelTest(unittest.TestCase):
    """Two cars under two names."""

    def setUp(self):
        self.names = set()
        for topic in ("/tf", "/tf_static"):
            rospy.Subscriber(topic, TFMessage, self._on_transforms)
        self.buffer = tf2_ros.Buffer()
        self.listener = tf2_ros.TransformListener(self.buffer)

    def _on_transforms(self, msg):
        for transform in msg.transforms:
            self.names |= {transform.header.frame_id, transform.child_frame_id}

    def lookup(self, target, source):
        """Return the newest transform between two frames, waiting until there is one."""
        wait = rospy.Duration(PATIENCE)
        return self.buffer.lookup_transform(target, source, rospy.Time(0), wait).transform

    def test_frames(self):
        """Every frame hangs on the map, under its car's name, and none begins with a slash."""
        for car in ("car", "second"):
            laser = self.lookup(f"{car}/base_footprint", f"{car}/laser_link").translation
            expected = (0.158 - 0.0353, 0.0, 0.0947 + 0.1078)
            for got, wanted in zip((laser.x, laser.y, laser.z), expected):
                self.assertAlmostEqual(got, wanted, delta=ROUNDING)
            for end, x in (("front", 0.33), ("back", 0.0)):
                for side, y in (("left", 0.125), ("right", -0.125)):
                    wheel = self.lookup("map", f"{car}/{end}_{side}_wheel_link").translation
                    for got, wanted in zip((wheel.x, wheel.y, wheel.z), (x, y, 0.0488)):
                        self.assertAlmostEqual(got, wanted, delta=ROUNDING)
        strangers = [name for name in self.names if not name.startswith(("car/", "second/"))]
        self.assertEqual(strangers, ["map"])

    def test_steering(self):
        """Each front wheel stands at a right angle to the line to the turning centre."""
        publisher = rospy.Publisher(
            "/car/mux/ackermann_cmd_mux/input/default", AckermannDriveStamped, queue_size=1
        )
        centre = 0.33 / math.tan(STEERING_ANGLE)
        expected = {
            "left": math.atan2(0.33, centre - 0.125),
            "right": math.atan2(0.33, centre + 0.125),
        }
        angles = {}
        deadline = rospy.Time.now() + rospy.Duration(PATIENCE)
        while rospy.Time.now() < deadline:
            msg = AckermannDriveStamped()
            msg.header.stamp = rospy.Time.now()
            msg.drive.steering_angle = STEERING_ANGLE
            publisher.publish(msg)
            for side in expected:
                q = self.lookup("car/base_link", f"car/front_{side}_wheel_steer_link").rotation
                angles[side] = euler_from_quaternion((q.x, q.y, q.z, q.w))[2]
            if all(abs(angles[side] - expected[side]) <= ROUNDING for side in expected):
                return
            rospy.sleep(0.05)
        self.fail(f"the front wheels stand at {angles}; expected {expected} rad")


if __name__ == "__main__":
    rospy.init_node("model_test")
    rostest.rosrun("mushr_ros_intro", "model", ModelTest)
