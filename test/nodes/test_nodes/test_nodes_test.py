#!/usr/bin/python3
"""Check the test nodes on a drive, on a mux, and on topics that are wrong on purpose.

Their cases run side by side in threads of this one process, since a process of its own costs each
of them a second of computing; that the nodes are processes too is checked in a test file.
"""

import copy
import functools
import math
import os
import re
import shutil
import sys
import tempfile
import threading
import unittest
import xmlrpc.client
from unittest import mock
from xml.etree import ElementTree

import roslib.packages
import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from support.helpers import Process, Recording, closed_form, node, wait_for

PACKAGE = roslib.packages.get_pkg_dir("mushr_ros_intro")
sys.path.append(os.path.join(PACKAGE, "src"))
import muxtest  # noqa: E402
import odomtest  # noqa: E402
import posetest  # noqa: E402
import ratetest  # noqa: E402
from mushr_ros_intro.grading import checks  # noqa: E402
from mushr_ros_intro.ros.connections import registered_nodes  # noqa: E402

PATIENCE = 90.0
"""[s] For all the nodes to start, on a busy machine."""

ROWS = [(1.0, 0.1, 1.0), (2.0, -0.1, 1.0), (1.5, 0.2, 1.5)]
START = (1.0, 2.0, 0.5)
END = closed_form(START, ROWS)
HALF = closed_form(START, ROWS[:1])

NAVIGATION = "/car/mux/ackermann_cmd_mux/input/navigation"
MUX = {
    "inputs": {"navigation": NAVIGATION, "teleop": "/car/mux/ackermann_cmd_mux/input/teleop"},
    "output": "/car/mux/ackermann_cmd_mux/output",
    "active": "/car/mux/ackermann_cmd_mux/active",
}
RIGHT_STEPS = [
    {"send": ["navigation"], "wins": "navigation"},
    {"send": ["navigation", "teleop"], "wins": "teleop"},
    {"send": ["teleop"], "wins": "teleop"},
    {"send": [], "wins": "idle"},
]
WRONG_STEPS = [
    {"send": ["navigation", "teleop"], "wins": "navigation"},
    {"send": ["navigation"], "wins": "idle"},
]

POSE = {"topic": "/car/car_pose", "test_duration": 5.0}
AT_END = {"x": END[0], "y": END[1], "theta": END[2], "position_tolerance": 0.00001}
ODOM = {"odom_topic": "/car/odom", "pose_topic": "/car/car_pose", "test_duration": 5.0}
PUPPET = {"tf": False, "test_duration": 5.0}
MISSING = {"wait_time": 1.0}

# Name: the test, its parameters, and what it says; nothing: it passes.
# Within a process rospy takes a topic's messages as one type only, and ratetest takes any: its
# topics are no other test's.
CASES = {
    "ends": (posetest.PoseTest, {**POSE, **AT_END}, ""),
    "ends_in_tf": (
        posetest.PoseTest,
        {"frame": "map", "child_frame": "car/base_footprint", "test_duration": 5.0, **AT_END},
        "",
    ),
    "passes": (
        posetest.PoseTest,
        {**POSE, "x": HALF[0], "y": HALF[1], "position_tolerance": 0.05, "passes": True},
        "",
    ),
    "ends_elsewhere": (
        posetest.PoseTest,
        {**POSE, "x": HALF[0], "y": HALF[1]},
        r"after 5 s the pose \(.*\) is .* m and .* rad from \(1\..*; allowed are 0.05 m",
    ),
    "ends_askew": (
        posetest.PoseTest,
        {**POSE, **AT_END, "theta": 3.0},
        "allowed are .* and 0.05 rad",
    ),
    "never_passes": (
        posetest.PoseTest,
        {**POSE, "x": -5.0, "y": 0.0, "passes": True},
        "in 5 s it did not pass; at its nearest the pose",
    ),
    "pose_missing": (
        posetest.PoseTest,
        {"topic": "/nowhere", "x": 0.0, "y": 0.0, **MISSING},
        "waited 1 s for a publisher of /nowhere",
    ),
    "pose_broken": (
        posetest.PoseTest,
        {"topic": "/broken", "x": 0.0, "y": 0.0, "position_tolerance": 100.0},
        r"a pose on /broken: pose \(nan, .* is not finite",
    ),
    "pose_of_no_kind": (
        posetest.PoseTest,
        {"topic": "/clock", "x": 0, "y": 0},
        "/clock is a rosgraph",
    ),
    "pose_nowhere": (posetest.PoseTest, POSE, "parameter ~x is None; expected a number"),
    "tf_missing": (
        posetest.PoseTest,
        {"frame": "map", "child_frame": "moon", "x": 0.0, "y": 0.0, **MISSING},
        "waited 1 s for a transform from map to moon",
    ),
    "rate": (ratetest.RateTest, {"topic": NAVIGATION, "plan_file": "PLAN"}, ""),
    "rate_of_wheels": (ratetest.RateTest, {"topic": "/car/joint_states", "hz": 50.0}, ""),
    "rate_of_another_plan": (
        ratetest.RateTest,
        {"topic": NAVIGATION, "plan_file": "OTHER_PLAN"},
        r"row 3 \(5 s\) has 16 messages; expected 50",
    ),
    "rate_too_low": (
        ratetest.RateTest,
        {"topic": "/car/joint_states", "hz": 100.0},
        "there are 0.02 s between the stamps of messages 1 and 2; expected 0.01 s",
    ),
    "rate_missing": (
        ratetest.RateTest,
        {"topic": "/nowhere", **MISSING},
        "waited 1 s for a message on /nowhere",
    ),
    "rate_back": (
        ratetest.RateTest,
        {"topic": "/back", "hz": 20.0},
        r"message \d+ is stamped 0.01 s before the one before it",
    ),
    "rate_unstamped": (ratetest.RateTest, {"topic": "/unstamped"}, "/unstamped has no stamp"),
    "rate_headless": (
        ratetest.RateTest,
        {"topic": "/clock"},
        "/clock is a rosgraph_msgs/Clock, which",
    ),
    "odom": (odomtest.OdomTest, ODOM, ""),
    "odom_of_puppet": (odomtest.OdomTest, {"odom_topic": "/right", **PUPPET}, ""),
    "odom_per_tick": (
        odomtest.OdomTest,
        {"odom_topic": "/per_tick", **PUPPET},
        "that is 1 m/s, but the twist says 0.05 m/s in the child frame",
    ),
    "odom_turn": (
        odomtest.OdomTest,
        {"odom_topic": "/turn", **PUPPET},
        "that is 0.5 rad/s, but the twist says 0.4 rad/s",
    ),
    "odom_jump": (
        odomtest.OdomTest,
        {"odom_topic": "/jump", **PUPPET},
        r"the pose moves by 3\..* m, that is 6.* m/s, but",
    ),
    "odom_sideways": (
        odomtest.OdomTest,
        {"odom_topic": "/sideways", **PUPPET},
        "the pose moves sideways",
    ),
    "odom_broken": (
        odomtest.OdomTest,
        {"odom_topic": "/broken", **PUPPET},
        r"pose \(nan, .* is not finite",
    ),
    "odom_missing": (
        odomtest.OdomTest,
        {"odom_topic": "/nowhere", **MISSING},
        "waited 1 s for odometry on /nowhere",
    ),
    "odom_and_another_pose": (
        odomtest.OdomTest,
        {**ODOM, "pose_topic": "/shifted", "test_duration": 5.0},
        "TF says something else than the pose: the pose .* is 0.1 m and 0 rad from",
    ),
}
LATE_CASES = {  # their patience begins with the clock
    "odom_without_tf": (
        odomtest.OdomTest,
        {"odom_topic": "/right", **MISSING},
        "waited 1 s for a transform from 'puppet/odom' to 'puppet/base'",
    ),
}


class HeldUp(muxtest.MuxTest):
    """Does not get to send for longer than a command holds, once, as if the machine were busy."""

    def setUp(self):
        super().setUp()
        self._rounds = 0
        teleop = self._publishers["teleop"]
        teleop.publish = functools.partial(self._publish, teleop.publish)

    def _publish(self, publish, msg):
        publish(msg)
        self._rounds += 1
        if self._rounds == 6:
            rospy.sleep(0.3)


class Late(muxtest.MuxTest):
    """Finds messages late in every step."""

    def _try(self, *arguments):
        faults = super()._try(*arguments)
        self._delays.append(1.0)
        return faults


MUX_CASES = {
    "mux": (muxtest.MuxTest, {**MUX, "steps": RIGHT_STEPS}, ""),
    "mux_held_up": (HeldUp, {**MUX, "steps": RIGHT_STEPS[1:2]}, ""),
    "mux_wrong_and_late": (
        Late,
        {**MUX, "steps": WRONG_STEPS[:1]},
        "step 1, in which navigation and teleop send: teleop came out; expected navigation\n"
        "step 1, .*: teleop is said to drive; expected navigation\n"
        r"step 1, .*: messages were up to 1\.0 s late, in each of 3 tries; the machine may be too",
    ),
    "mux_wrong": (
        muxtest.MuxTest,
        {**MUX, "steps": WRONG_STEPS},
        "step 1, in which navigation and teleop send: teleop came out; expected navigation\n"
        "step 1, .*: teleop is said to drive; expected navigation\n"
        "step 2, in which navigation send: navigation came out; expected nothing\n",
    ),
    "mux_missing": (
        muxtest.MuxTest,
        {**MUX, "output": "/nowhere", "steps": RIGHT_STEPS, **MISSING},
        "waited 1 s for a publisher of /nowhere",
    ),
    "mux_misspelt": (
        muxtest.MuxTest,
        {**MUX, "steps": [{"send": ["teleoperation"], "wins": "idle"}]},
        "expected {send: .*, with names out of navigation, teleop, idle",
    ),
}


def odometry(stamp, seconds, speed=1.0, turn_rate=0.5, ahead=0.0, askew=0.0):
    """Return a message of a circle driven at 1 m/s and 0.5 rad/s, with what is to be wrong."""
    theta = 0.5 * seconds
    msg = Odometry()
    msg.header.stamp = stamp
    msg.header.frame_id, msg.child_frame_id = "puppet/odom", "puppet/base"
    msg.pose.pose.position.x = 2.0 * math.sin(theta) + ahead
    msg.pose.pose.position.y = 2.0 - 2.0 * math.cos(theta)
    msg.pose.pose.orientation.z = math.sin(0.5 * (theta + askew))
    msg.pose.pose.orientation.w = math.cos(0.5 * (theta + askew))
    msg.twist.twist.linear.x = speed
    msg.twist.twist.angular.z = turn_rate
    return msg


class Puppet:
    """Publishes topics that are wrong, twenty times a second, until it is ended."""

    def __init__(self):
        names = ("right", "per_tick", "turn", "jump", "sideways", "back", "unstamped", "broken")
        self._odometry = {
            name: rospy.Publisher(f"/{name}", Odometry, queue_size=1000) for name in names
        }
        self._shifted = rospy.Publisher("/shifted", PoseStamped, queue_size=1000)
        self._poses = rospy.Subscriber("/car/car_pose", PoseStamped, self._shift)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _shift(self, msg):
        shifted = copy.deepcopy(msg)  # it is the other subscribers' too
        shifted.pose.position.x += 0.1
        self._shifted.publish(shifted)

    def _run(self):
        begin = rospy.Time.now()
        number = 0
        while not self._ended.is_set():
            number += 1
            seconds = 0.05 * number
            stamp = begin + rospy.Duration.from_sec(seconds)
            wait_for(lambda stamp=stamp: rospy.Time.now() >= stamp, "the clock to run", PATIENCE)
            back = stamp - rospy.Duration.from_sec(0.06 if number % 20 == 0 else 0.0)
            messages = {
                "right": odometry(stamp, seconds),
                "per_tick": odometry(stamp, seconds, speed=0.05),
                "turn": odometry(stamp, seconds, turn_rate=0.4),
                "jump": odometry(stamp, seconds, ahead=3.0 * (number // 40)),
                "sideways": odometry(stamp, seconds, askew=0.1),
                "back": odometry(back, seconds),
                "unstamped": odometry(rospy.Time(0), seconds),
                "broken": odometry(stamp, seconds, ahead=math.nan if number == 40 else 0.0),
            }
            for name, msg in messages.items():
                self._odometry[name].publish(msg)

    def end(self):
        self._ended.set()
        self._thread.join()
        self._poses.unregister()


class Case(threading.Thread):
    """A test node's test, run in a thread with its own parameters and its own result."""

    _parameters = threading.Lock()  # the private ones are everybody's

    def __init__(self, name, kind, parameters, expected):
        super().__init__(name=name, daemon=True)
        self._expected = expected
        self._result = unittest.TestResult()
        self.is_waiting = False

        class Test(kind):
            def setUp(self):
                with Case._parameters:
                    # All at once, which takes away those of the case before.
                    rospy.set_param(rospy.get_name(), {"wait_time": PATIENCE, **parameters})
                    super().setUp()

        self._tests = unittest.defaultTestLoader.loadTestsFromTestCase(Test)
        self.start()

    def run(self):
        self._tests.run(self._result)

    @staticmethod
    def wait_for(condition, what, patience):
        """Wait in a case's thread as its node does, and note that it does."""

        def noted():
            value = condition()
            threading.current_thread().is_waiting |= not value
            return value

        return checks.wait_for(noted, what, patience)

    def faults(self):
        """Return what is wrong with the verdict, if anything is, when there is one."""
        self.join(PATIENCE)
        if self.is_alive():
            return [f"{self.name} did not end"]
        said = [text for _, text in self._result.failures]
        errors = [text for _, text in self._result.errors]  # exceptions, which are no verdict
        is_said = len(said) == bool(self._expected)
        is_right = is_said and all(re.search(self._expected, text) for text in said)
        if is_right and not errors and self._result.testsRun == 1:
            return []
        return [f"{self.name} said:\n" + "\n".join([*said, *errors])]


def is_connected():
    """Say whether all who publish what this node subscribes to know that it does."""
    name = rospy.get_name()
    _, _, (publishers, subscribers, _) = rospy.get_master().getSystemState()
    wanted = {topic for topic, names in subscribers if name in names}
    missing = {}
    for topic, names in publishers:
        for publisher in names if topic in wanted else ():
            missing.setdefault(publisher, set()).add(topic)
    for publisher, topics in missing.items():
        _, _, uri = rospy.get_master().lookupNode(publisher)
        _, _, connections = xmlrpc.client.ServerProxy(uri).getBusInfo(name)
        topics -= {topic for _, peer, _, _, topic, *_ in connections if peer == name}
    return not any(missing.values())


class TestTestNodes(unittest.TestCase):
    def setUp(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        self.files = {}
        for name, rows in (("PLAN", ROWS), ("OTHER_PLAN", [*ROWS[:2], (1.5, 0.2, 5.0)])):
            self.files[name] = os.path.join(folder, f"{name.lower()}.txt")
            with open(self.files[name], "w") as file:
                file.write("\n".join(", ".join(map(str, row)) for row in (START, *rows)))

    def start(self, cases):
        """Start cases, side by side."""
        found = []
        for name, (kind, parameters, expected) in cases.items():
            if parameters.get("plan_file") in self.files:
                parameters = {**parameters, "plan_file": self.files[parameters["plan_file"]]}
            found.append(Case(name, kind, parameters, expected))
        return found

    def check(self, cases):
        """Wait for the verdicts of cases, and fail where one is wrong."""
        faults = [fault for case in cases for fault in case.faults()]
        self.assertEqual(faults, [], "\n".join(faults))

    def test_poses_rates_and_odometry(self):
        """All of them listen to the same few seconds, which begin when the clock is let go."""
        rospy.wait_for_service("/car/car_sim/pause", PATIENCE)
        wait_for(rospy.get_time, "the clock", PATIENCE)
        rospy.ServiceProxy("/car/car_sim/pause", Trigger)()
        resume = rospy.ServiceProxy("/car/car_sim/resume", Trigger)
        puppet = Puppet()
        self.addCleanup(puppet.end)
        self.addCleanup(resume)
        # The first of a process offers a service, which several would do at once.
        buffer = tf2_ros.Buffer()
        self.addCleanup(buffer.frame_server.shutdown)
        placements = Recording("/initialpose", PoseWithCovarianceStamped)
        driver = node(
            "path_publisher.py",
            f"_plan_file:={self.files['PLAN']}",
            f"_subscriber_timeout:={PATIENCE}",
            "__name:=case_driver",
        )
        self.addCleanup(driver.end)
        for module in (posetest, ratetest, odomtest):
            patch = mock.patch.object(module, "wait_for", Case.wait_for)
            patch.start()
            self.addCleanup(patch.stop)
        cases = self.start(CASES)
        wait_for(
            lambda: all(case.is_waiting or not case.is_alive() for case in cases),
            "the test nodes to listen",
            PATIENCE,
        )
        wait_for(
            lambda: "/case_driver" in registered_nodes(NAVIGATION, "publishers")
            or not driver.running,
            "the driver",
            PATIENCE,
        )
        wait_for(is_connected, "the test nodes to be connected", PATIENCE)
        # The driver has had no time so far. It places the car before anything happens.
        rospy.ServiceProxy("/car/car_sim/step", Trigger)()
        wait_for(lambda: placements.messages, "the start pose", PATIENCE)
        resume()
        self.assertEqual(driver.wait(PATIENCE), 0, driver.output)
        self.check(cases)
        self.check(self.start(LATE_CASES))

    def test_mux(self):
        for name, case in MUX_CASES.items():  # one after the other
            self.check(self.start({name: case}))

    def test_in_a_test_file(self):
        """rostest takes the nodes' verdicts for its own."""
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        fixture = os.path.join(PACKAGE, "test", "fixtures", "missing_topics.test")
        with Process("rostest", fixture, ROS_TEST_RESULTS_DIR=folder) as run:
            self.assertNotEqual(run.wait(PATIENCE), 0, run.output)
        for kind, expected in (
            ("pose", "waited 0.5 s for a publisher of /nowhere"),
            ("rate", "waited 0.5 s for a message on /nowhere"),
            ("odom", "waited 0.5 s for odometry on /nowhere"),
            ("mux", "waited 0.5 s for a subscriber of /nowhere"),
        ):
            path = os.path.join(folder, "mushr_ros_intro", f"rosunit-{kind}_nowhere.xml")
            failures = list(ElementTree.parse(path).iter("failure"))
            self.assertEqual(len(failures), 1, path)
            self.assertIn(expected, failures[0].text)


if __name__ == "__main__":
    rospy.init_node("test_nodes_test")
    rostest.rosrun("mushr_ros_intro", "test_nodes", TestTestNodes)
