#!/usr/bin/python3
"""Check that in lock-step a drive is the same to the bit, and ends where it is predicted to."""

import glob
import io
import os
import re
import time
import unittest

import rosnode
import rospkg
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from std_srvs.srv import Trigger

from mushr_ros_intro.ros.connections import wait_until_connected
from support.helpers import PATIENCE, Recording, node, publisher, wait_for

PROMISED = 1e-9
"""[m, rad] Between the predicted and the driven final pose."""

MUX_TIMEOUT = 0.2
"""[s] How long after a command the mux stops the car; the commands of a plan are closer."""

TAIL = rospy.Duration(0.5)
"""How long after its last command a drive is recorded: it stands after 0.2 s."""

HELD_UP = 0.5
"""[s] How late a message is that is held up: less than the publisher's lead of 0.9 s, and than the
clock waits after a stop."""

DIFFERENCE = re.compile(r"difference (\S+) m, (\S+) rad")

NAVIGATION = "/car/mux/ackermann_cmd_mux/input/navigation"

TOPICS = {
    "/car/car_pose": PoseStamped,
    "/car/odom": Odometry,
    "/car/mux/ackermann_cmd_mux/output": AckermannDriveStamped,
}


def in_bits(message, begin):
    """Return a message as it travels, with its stamp counted from `begin`."""
    since = message.header.stamp - begin
    message.header.seq = 0  # counts what the publisher has published since it began
    message.header.stamp = rospy.Time(0)
    buffer = io.BytesIO()
    message.serialize(buffer)
    return since.to_nsec(), buffer.getvalue()


def apart(messages):
    """Return how far apart the stamps of two messages are [s]."""
    stamps = [message.header.stamp for message in messages]
    return (max(stamps) - min(stamps)).to_sec()


def hold_up(topic, to, kind):
    """Pass the messages of a topic on to another: late the first, and the one after a stop."""
    out = publisher(to, kind)
    before = "nothing"
    late = {"nothing", "a stop"}

    def pass_on(message):
        nonlocal before
        if before in late:
            late.remove(before)
            time.sleep(HELD_UP)
        out.publish(message)
        drive = getattr(message, "drive", None)
        is_stop = drive and not drive.speed and not drive.steering_angle
        before = "a stop" if is_stop else "another"

    rospy.Subscriber(topic, kind, pass_on, tcp_nodelay=True)


class TestLockStep(unittest.TestCase):
    def setUp(self):
        rospy.wait_for_service("/car/car_sim/reset")
        self.reset = rospy.ServiceProxy("/car/car_sim/reset", Trigger)
        self.recordings = [Recording(topic, kind).connected() for topic, kind in TOPICS.items()]
        self.log = Recording("/rosout", Log)
        self.assertTrue(wait_until_connected(self.log.subscriber, "publishers", PATIENCE))

    def drive(self, plan, *arguments):
        """Drive a plan; return what came on every topic."""
        self.assertTrue(self.reset().success)  # or the odometry would go on
        for recording in self.recordings:
            recording.clear()
        poses, _, commands = self.recordings
        with node("path_publisher.py", f"_plan_file:={plan}", *arguments) as driver:
            self.assertEqual(driver.wait(60.0), 0, driver.output)
        found = DIFFERENCE.search(driver.output)
        self.assertTrue(found, driver.output)
        self.assertLess(max(map(float, found.groups())), PROMISED, driver.output)
        begin = commands.messages[0].header.stamp
        wait_for(lambda: apart(commands.messages[-2:]) == MUX_TIMEOUT, "the mux to stop the car")
        said = [m.msg for m in self.log.messages if m.name == "/car/car_sim"]
        self.assertFalse([text for text in said if "no command came" in text])
        # The plan's stop, and the one that the mux adds when nothing comes any more.
        end = next(m.header.stamp for m in commands.messages[::-1] if m.drive.speed) + TAIL
        poses.after(end)
        self.recordings[1].after(end)
        return [
            [in_bits(m, begin) for m in r.messages if begin <= m.header.stamp <= end]
            for r in self.recordings
        ]

    def test_to_the_bit(self):
        folder = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "plans")
        plans = sorted(glob.glob(folder + "/*.txt"))
        self.assertGreaterEqual(len(plans), 6)
        first_round = {plan: self.drive(plan) for plan in plans}
        if rospy.get_param("~busy"):
            for number in range(os.cpu_count()):
                busy = node("busy.py", f"__name:=busy_{number}")
                self.addCleanup(busy.end)
                wait_for(lambda name=f"/busy_{number}": name in rosnode.get_node_names(), "busy.py")
        for plan in plans:
            self.assert_same_to_the_bit(plan, first_round[plan], self.drive(plan))

    def test_to_the_bit_where_messages_are_held_up(self):
        """The car stands at the start pose from the beginning, so what it reports tells nothing."""
        hold_up("/held_up/initialpose", "/initialpose", PoseWithCovarianceStamped)
        hold_up("/held_up/navigation", NAVIGATION, AckermannDriveStamped)
        held_up = ("_init_pose_topic:=/held_up/initialpose", "_control_topic:=/held_up/navigation")
        plan = "parallel_parking"
        self.assert_same_to_the_bit(plan, self.drive(plan), self.drive(plan, *held_up))

    def assert_same_to_the_bit(self, plan, drive, again):
        for topic, one, other in zip(TOPICS, drive, again):
            is_slow = rospy.get_param("/car/car_sim/pose_rate") < 10.0 and "output" not in topic
            self.assertGreater(len(one), 10 if is_slow else 50, f"{plan}: {topic}")
            for first, second in zip(one, other):
                self.assertEqual(first, second, f"{plan}: {topic}")
            self.assertEqual(len(one), len(other), f"{plan}: {topic}")


if __name__ == "__main__":
    rospy.init_node("lock_step_test")
    rostest.rosrun("mushr_ros_intro", "lock_step", TestLockStep)
