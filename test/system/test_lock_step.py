"""Check that in lock-step a drive is the same to the bit, and ends where it is predicted to."""

import copy
import io
import itertools
import os
import re
import signal
import time

import rosgraph
import rosnode
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from std_srvs.srv import Trigger

from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.simulator.clock import CLOCK_PATIENCE_AT_REST
from support.helpers import PATIENCE, Recording, Relay, RosTestCase, driver, node, wait_for
from support.messages import NAVIGATION, OUTPUT, is_stop
from support.world import LOCK_STEP, launch

PROMISED = 1e-9
"""[m, rad] The largest difference between the predicted and the driven final pose."""

MUX_TIMEOUT = 0.2
"""[s] The mux stops the car this long after the last command of a plan."""

TAIL = rospy.Duration(0.5)
"""The end of a recording, after the last command. The car stands after 0.2 s."""

HELD_UP = 0.5
"""[s] The delay of a message: less than the publisher's lead of 0.9 s, and less than the clock's
patience at rest."""

LAPS = 2

PLAN = "slalom"
"""The plan to drive twice. It starts at the pose of the car after a reset. test_lock_step_ideal.py
drives every plan."""

DIFFERENCE = re.compile(r"difference (\S+) m, (\S+) rad")


TOPICS = {
    "/car/car_pose": PoseStamped,
    "/car/odom": Odometry,
    OUTPUT: AckermannDriveStamped,
}


def in_bits(message, begin):
    """Return the stamp of a message since `begin` [ns], and the rest of the message in bytes."""
    since = message.header.stamp - begin
    message = copy.deepcopy(message)
    message.header.seq = 0  # counts all messages of the publisher
    message.header.stamp = rospy.Time(0)
    buffer = io.BytesIO()
    message.serialize(buffer)
    return since.to_nsec(), buffer.getvalue()


def apart(messages):
    """Return the difference between the stamps of messages [s]."""
    stamps = [message.header.stamp for message in messages]
    return (max(stamps) - min(stamps)).to_sec()


def is_pause(one, other):
    """Return whether a lap ends between two commands: laps are a second apart."""
    return other.header.stamp - one.header.stamp > rospy.Duration(0.5)


def start_world():
    """Run a car with limits and noise; in the second round, every core is busy."""
    rosgraph.Master("/launch").setParam("/busy", True)
    arguments = {"map": "none", "laser": False, "model": False, **LOCK_STEP}
    return launch("sim.launch", car="mushr_nano", noise=True, seed=7, watched=False, **arguments)


class Delay:
    """Delays the first command of each drive, and each initial pose."""

    def __init__(self):
        self.seconds = 0.0
        self.is_next = True

    def __call__(self, message):
        if self.is_next:
            time.sleep(self.seconds)
        self.is_next = not hasattr(message, "drive") or is_stop(message)


class TestLockStep(RosTestCase):
    plans = (PLAN,)
    drives = {}
    delays = []

    def setUp(self):
        super().setUp()
        rospy.wait_for_service("/car/car_sim/reset")
        self.reset = rospy.ServiceProxy("/car/car_sim/reset", Trigger)
        self.recordings = [Recording(topic, kind).connected() for topic, kind in TOPICS.items()]
        self.log = Recording("/rosout", Log)
        self.assertTrue(wait_until_connected(self.log.subscriber, "publishers", PATIENCE))

    def drive(self, plan, *arguments):
        """Drive a plan; return the messages of every topic."""
        self.assertTrue(self.reset().success)  # this resets the odometry
        for recording in self.recordings:
            recording.clear()
        poses, _, commands = self.recordings
        if plan in self.drives:  # it is compared with the first drive
            with driver(plan, *arguments) as process:
                self.assertEqual(process.wait(), 0)
        else:
            found = DIFFERENCE.search(self.drive_plan(plan, *arguments))
            self.assertLess(max(map(float, found.groups())), PROMISED)
        begin = commands.messages[0].header.stamp
        self.wait_for_mux()
        said = [m.msg for m in self.log.messages if m.name == "/car/car_sim"]
        self.assertFalse([text for text in said if "no command arrived" in text])
        # The last two messages are the stop of the plan and the stop of the mux.
        end = next(m.header.stamp for m in commands.messages[::-1] if m.drive.speed) + TAIL
        poses.after(end)
        self.recordings[1].after(end)
        return [
            [in_bits(m, begin) for m in r.messages if begin <= m.header.stamp <= end]
            for r in self.recordings
        ]

    def first_drive(self, plan):
        """Return the messages of the first drive of a plan."""
        if plan not in self.drives:
            self.drives[plan] = self.drive(plan)
        return self.drives[plan]

    def test_to_the_bit(self):
        for plan in self.plans:
            self.first_drive(plan)
        if rospy.get_param("/busy"):
            for number in range(os.cpu_count()):
                self.ending(node("busy.py", f"__name:=busy_{number}"))
                wait_for(lambda name=f"/busy_{number}": name in rosnode.get_node_names(), "busy.py")
        for plan in self.plans:
            self.assert_same_to_the_bit(plan, self.first_drive(plan), self.drive(plan))

    def delay(self, seconds):
        """Delay the messages of a node; return the arguments for its start."""
        # The relays stay: rospy of Debian 11 may not connect a publisher that comes a second time.
        if not self.delays:
            self.delays[:] = Delay(), Delay()
            initial_pose = ("/delayed/initialpose", "/initialpose", PoseWithCovarianceStamped)
            Relay(*initial_pose, self.delays[0])
            Relay("/delayed/navigation", NAVIGATION, AckermannDriveStamped, self.delays[1])
        for each in self.delays:
            each.seconds, each.is_next = seconds, True
        return ("_init_pose_topic:=/delayed/initialpose", "_control_topic:=/delayed/navigation")

    def test_to_the_bit_if_messages_are_delayed(self):
        again = self.drive(PLAN, *self.delay(HELD_UP))
        self.assert_same_to_the_bit(PLAN, self.first_drive(PLAN), again)

    def test_laps_to_the_bit(self):
        """All laps are the same, even if the clock goes on without the node between two laps.

        The first lap of the delayed node does not count: its initial pose arrives too late.
        """
        expected = self.first_drive(PLAN)
        poses, _, commands = self.recordings
        for arguments in ((), self.delay(CLOCK_PATIENCE_AT_REST + 0.1)):
            for recording in self.recordings:
                recording.clear()
            with driver(PLAN, "_loop:=true", "__name:=laps", *arguments) as process:
                wait_for(lambda: len(self.begins()) > LAPS, "laps")
                process.send_signal(signal.SIGINT)
                self.assertEqual(process.wait(), 0)
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
            for first, second in itertools.zip_longest(one, other):
                self.assertEqual(first, second, f"{plan}: {topic}")
