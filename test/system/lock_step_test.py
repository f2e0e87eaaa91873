#!/usr/bin/python3
"""Check that in lock-step a drive is the same to the bit, and ends where it is predicted to."""

import copy
import io
import os
import re
import signal
import time

import rosnode
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from std_srvs.srv import Trigger

from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.sim.stamps import CLOCK_PATIENCE_AT_REST
from support.helpers import PATIENCE, Recording, Relay, RosTestCase, is_stop, node, wait_for
from support.paths import PLANS

PROMISED = 1e-9
"""[m, rad] Between the predicted and the driven final pose."""

MUX_TIMEOUT = 0.2
"""[s] How long after a command the mux stops the car; the commands of a plan are closer."""

TAIL = rospy.Duration(0.5)
"""How long after its last command a drive is recorded: it stands after 0.2 s."""

HELD_UP = 0.5
"""[s] The delay of a message: less than the publisher's lead of 0.9 s, and less than the clock's
patience at rest."""

LAPS = 3

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
    message = copy.deepcopy(message)
    message.header.seq = 0  # counts what the publisher has published since it began
    message.header.stamp = rospy.Time(0)
    buffer = io.BytesIO()
    message.serialize(buffer)
    return since.to_nsec(), buffer.getvalue()


def apart(messages):
    """Return how far apart the stamps of two messages are [s]."""
    stamps = [message.header.stamp for message in messages]
    return (max(stamps) - min(stamps)).to_sec()


def is_pause(one, other):
    """Return whether a lap ends between two commands: laps are a second apart."""
    return other.header.stamp - one.header.stamp > rospy.Duration(0.5)


class Delay:
    """Delays the first command of each drive, and each initial pose."""

    def __init__(self, seconds=HELD_UP):
        self._seconds = seconds
        self._is_next = True

    def __call__(self, message):
        if self._is_next:
            time.sleep(self._seconds)
        self._is_next = not hasattr(message, "drive") or is_stop(message)


class TestLockStep(RosTestCase):
    drives = {}

    def setUp(self):
        super().setUp()
        rospy.wait_for_service("/car/car_sim/reset")
        self.reset = rospy.ServiceProxy("/car/car_sim/reset", Trigger)
        self.recordings = [Recording(topic, kind).connected() for topic, kind in TOPICS.items()]
        self.log = Recording("/rosout", Log)
        self.assertTrue(wait_until_connected(self.log.subscriber, "publishers", PATIENCE))

    def drive(self, plan, *arguments):
        """Drive a plan; return the messages of every topic."""
        self.assertTrue(self.reset().success)  # or the odometry would go on
        for recording in self.recordings:
            recording.clear()
        poses, _, commands = self.recordings
        with node("path_publisher.py", f"_plan_file:={plan}", *arguments) as driver:
            self.assertEqual(driver.wait(), 0)
        found = DIFFERENCE.search(driver.output)
        self.assertTrue(found)
        self.assertLess(max(map(float, found.groups())), PROMISED)
        begin = commands.messages[0].header.stamp
        self.wait_for_mux()
        said = [m.msg for m in self.log.messages if m.name == "/car/car_sim"]
        self.assertFalse([text for text in said if "no command arrived" in text])
        # The plan's stop, and the one that the mux adds when nothing comes any more.
        end = next(m.header.stamp for m in commands.messages[::-1] if m.drive.speed) + TAIL
        poses.after(end)
        self.recordings[1].after(end)
        return [
            [in_bits(m, begin) for m in r.messages if begin <= m.header.stamp <= end]
            for r in self.recordings
        ]

    def first_drive(self, plan):
        """Return what came on every topic when the plan was driven for the first time."""
        if plan not in self.drives:
            self.drives[plan] = self.drive(plan)
        return self.drives[plan]

    def test_to_the_bit(self):
        plans = ["parallel_parking", "slalom"]
        if rospy.get_param("~every_plan"):
            plans = sorted(os.path.splitext(name)[0] for name in os.listdir(PLANS))
        for plan in plans:
            self.first_drive(plan)
        if rospy.get_param("~busy"):
            for number in range(os.cpu_count()):
                busy = node("busy.py", f"__name:=busy_{number}")
                self.addCleanup(busy.end)
                wait_for(lambda name=f"/busy_{number}": name in rosnode.get_node_names(), "busy.py")
        for plan in plans:
            self.assert_same_to_the_bit(plan, self.first_drive(plan), self.drive(plan))

    def delay(self, seconds):
        """Delay the messages of a node; return the arguments with which it has to be started."""
        for topic, to, kind in (
            ("/delayed/initialpose", "/initialpose", PoseWithCovarianceStamped),
            ("/delayed/navigation", NAVIGATION, AckermannDriveStamped),
        ):
            self.addCleanup(Relay(topic, to, kind, Delay(seconds)).end)
        return ("_init_pose_topic:=/delayed/initialpose", "_control_topic:=/delayed/navigation")

    def test_to_the_bit_if_messages_are_delayed(self):
        """The car stands at the start pose from the beginning, so its reports tell nothing."""
        plan = "parallel_parking"
        again = self.drive(plan, *self.delay(HELD_UP))
        self.assert_same_to_the_bit(plan, self.first_drive(plan), again)

    def test_laps_to_the_bit(self):
        """Also if the clock loses its patience between two laps. The plan has no row to stand.

        The first lap of the delayed node does not count: its initial pose comes after its stamp.
        """
        plan = "slalom"
        expected = self.first_drive(plan)
        poses, _, commands = self.recordings
        for arguments in ((), self.delay(CLOCK_PATIENCE_AT_REST + 0.1)):
            for recording in self.recordings:
                recording.clear()
            options = (f"_plan_file:={plan}", "_loop:=true", "__name:=laps")
            driver = node("path_publisher.py", *options, *arguments)
            with driver:
                wait_for(lambda: len(self.begins()) > LAPS, "laps")
                driver.send_signal(signal.SIGINT)
                self.assertEqual(driver.wait(), 0)
            self.wait_for_mux()
            end = expected[2][-1][0]
            for begin in self.begins()[bool(arguments) : LAPS]:
                for one, recording in ((expected[0], poses), (expected[2], commands)):
                    lap = [in_bits(m, begin) for m in recording.messages if m.header.stamp >= begin]
                    lap = [each for each in lap if each[0] <= end]
                    self.assertEqual(lap, [each for each in one if each[0] <= end])

    def wait_for_mux(self):
        """Wait until the mux has stopped the car after the last command."""
        messages = self.recordings[2]
        wait_for(lambda: apart(messages.messages[-2:]) == MUX_TIMEOUT, "the mux to stop the car")

    def begins(self):
        """Return the stamps of the first command of each lap."""
        messages = self.recordings[2].messages
        pairs = zip([None, *messages], messages)
        return [m.header.stamp for last, m in pairs if last is None or is_pause(last, m)]

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
