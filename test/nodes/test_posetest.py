"""Check the test node posetest.py in this process, with poses that the test publishes."""

import math
import os
import sys
import unittest

import rospy
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock

from support.helpers import RosTestCase
from support.messages import placement
from support.paths import PACKAGE

sys.path.append(os.path.join(PACKAGE, "src"))
import posetest  # noqa: E402

POSE = {"topic": "/pose", "x": 1.0, "y": 2.0, "test_duration": 0.2}

# The parameters of a test, and a part of its failure; if empty, the test passes.
CASES = [
    ({**POSE, "theta": 0.5, "position_tolerance": 1e-5, "angle_tolerance": 1e-5}, ""),
    ({**POSE, "topic": "/late"}, ""),
    ({**POSE, "x": 1.1}, "), 0.1 m from the expected (1.1000 m, 2.0000 m); tolerance 0.05 m"),
    ({**POSE, "theta": 3.0, "position_tolerance": 1e-5}, "tolerances 1e-05 m and 0.05 rad"),
    ({"topic": "/pose"}, "parameter ~x is not set; expected a number from -1e+06 to 1e+06 m"),
    ({"x": 0, "y": 0}, "parameter ~topic is not set; expected a topic"),
    ({**POSE, "topic": "/broken"}, "is not finite"),
    ({**POSE, "topic": "/clock"}, "expected one of geometry_msgs/PoseStamped, "),
]


def start_world():
    return []


class TestPoseTest(RosTestCase):
    def setUp(self):
        super().setUp()
        poses = {"/pose": (1.0, 2.0, 0.5), "/broken": (math.nan, 0.0, 0.0)}
        publishers = [
            (rospy.Publisher(topic, PoseStamped, queue_size=10), pose)
            for topic, pose in poses.items()
        ]
        late, count = rospy.Publisher("/late", PoseStamped, queue_size=10), 0
        clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
        clock.publish(Clock())

        def publish(_):
            nonlocal count
            if late.get_num_connections():  # the stamps pass half as fast as the clock
                count += 1
                x = 1.0 if count > 15 else 0.0
                placed = placement(rospy.Time.from_sec(1.0 + 0.01 * count), x, 2.0, 0.5)
                late.publish(PoseStamped(header=placed.header, pose=placed.pose.pose))
            for publisher, pose in publishers:
                placed = placement(rospy.Time.now(), *pose)
                publisher.publish(PoseStamped(header=placed.header, pose=placed.pose.pose))

        timer = rospy.Timer(rospy.Duration(0.02), publish)
        self.addCleanup(timer.join)
        self.addCleanup(timer.shutdown)

    def test_poses(self):
        for parameters, expected in CASES:
            result = unittest.TestResult()
            with self.subTest(parameters):
                rospy.set_param(rospy.get_name(), {"wait_time": 60.0, **parameters})
                posetest.PoseTest("test_pose").run(result)
                self.assertEqual((result.testsRun, result.errors), (1, []))
                failure = "".join(text for _, text in result.failures)
                self.assertEqual(bool(failure), bool(expected), failure)
                self.assertIn(expected, failure)
