#!/usr/bin/python3
"""Check the test nodes on a drive, on a mux, and on topics that are wrong on purpose."""

import math
import os
import re
import shutil
import tempfile
import threading
import unittest

import rospkg
import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from helpers import Process, closed_form, node, wait_for

PATIENCE = 90.0
"""[s] For all the nodes to start, on a busy machine."""

ROWS = [(1.0, 0.1, 1.0), (2.0, -0.1, 1.0), (1.5, 0.2, 1.5)]
START = (1.0, 2.0, 0.5)
END = closed_form(START, ROWS)
HALF = closed_form(START, ROWS[:1])

NAVIGATION = "/car/mux/ackermann_cmd_mux/input/navigation"
MUX = {
    "inputs": f"{{navigation: {NAVIGATION}, teleop: /car/mux/ackermann_cmd_mux/input/teleop}}",
    "output": "/car/mux/ackermann_cmd_mux/output",
    "active": "/car/mux/ackermann_cmd_mux/active",
}
RIGHT_STEPS = (
    "[{send: [navigation], wins: navigation}, {send: [navigation, teleop], wins: teleop}, "
    "{send: [teleop], wins: teleop}, {send: [], wins: idle}]"
)
WRONG_STEPS = "[{send: [navigation, teleop], wins: navigation}, {send: [navigation], wins: idle}]"

POSE = {"topic": "/car/car_pose", "test_duration": 5.0}
AT_END = {"x": END[0], "y": END[1], "theta": END[2], "position_tolerance": 0.00001}
ODOM = {"odom_topic": "/car/odom", "pose_topic": "/car/car_pose", "test_duration": 5.0}
PUPPET = {"tf": "false", "test_duration": 5.0}
MISSING = {"wait_time": 1.0}

# Name: the node, its parameters, and what it says; nothing: it passes.
CASES = {
    "ends": ("posetest.py", {**POSE, **AT_END}, ""),
    "ends_in_tf": (
        "posetest.py",
        {"frame": "map", "child_frame": "car/base_footprint", "test_duration": 5.0, **AT_END},
        "",
    ),
    "passes": (
        "posetest.py",
        {**POSE, "x": HALF[0], "y": HALF[1], "position_tolerance": 0.05, "passes": "true"},
        "",
    ),
    "ends_elsewhere": (
        "posetest.py",
        {**POSE, "x": HALF[0], "y": HALF[1]},
        r"after 5 s the pose \(.*\) is .* m and .* rad from \(1\..*; allowed are 0.05 m",
    ),
    "ends_askew": ("posetest.py", {**POSE, **AT_END, "theta": 3.0}, "allowed are .* and 0.05 rad"),
    "never_passes": (
        "posetest.py",
        {**POSE, "x": -5.0, "y": 0.0, "passes": "true"},
        "in 5 s it did not pass; at its nearest the pose",
    ),
    "pose_missing": (
        "posetest.py",
        {"topic": "/nowhere", "x": 0.0, "y": 0.0, **MISSING},
        "waited 1 s for a publisher of /nowhere",
    ),
    "pose_of_no_kind": ("posetest.py", {"topic": "/clock", "x": 0, "y": 0}, "/clock is a rosgraph"),
    "pose_nowhere": ("posetest.py", POSE, "parameter ~x is None; expected a number"),
    "tf_missing": (
        "posetest.py",
        {"frame": "map", "child_frame": "moon", "x": 0.0, "y": 0.0, **MISSING},
        "waited 1 s for a transform from map to moon",
    ),
    "rate": ("ratetest.py", {"topic": NAVIGATION, "plan_file": "PLAN"}, ""),
    "rate_of_poses": ("ratetest.py", {"topic": "/car/car_pose", "hz": 50.0}, ""),
    "rate_of_another_plan": (
        "ratetest.py",
        {"topic": NAVIGATION, "plan_file": "OTHER_PLAN"},
        r"row 3 \(5 s\) has 16 messages; expected 50",
    ),
    "rate_too_low": (
        "ratetest.py",
        {"topic": "/car/odom", "hz": 100.0},
        "there are 0.02 s between the stamps of messages 1 and 2; expected 0.01 s",
    ),
    "rate_missing": (
        "ratetest.py",
        {"topic": "/nowhere", **MISSING},
        "waited 1 s for a message on /nowhere",
    ),
    "rate_back": (
        "ratetest.py",
        {"topic": "/back", "hz": 20.0},
        r"message \d+ is stamped 0.01 s before the one before it",
    ),
    "rate_unstamped": ("ratetest.py", {"topic": "/unstamped"}, "/unstamped has no stamp"),
    "rate_headless": ("ratetest.py", {"topic": "/clock"}, "/clock is a rosgraph_msgs/Clock, which"),
    "odom": ("odomtest.py", ODOM, ""),
    "odom_of_puppet": ("odomtest.py", {"odom_topic": "/right", **PUPPET}, ""),
    "odom_per_tick": (
        "odomtest.py",
        {"odom_topic": "/per_tick", **PUPPET},
        "that is 1 m/s, but the twist says 0.05 m/s in the child frame",
    ),
    "odom_turn": (
        "odomtest.py",
        {"odom_topic": "/turn", **PUPPET},
        "that is 0.5 rad/s, but the twist says 0.4 rad/s",
    ),
    "odom_jump": (
        "odomtest.py",
        {"odom_topic": "/jump", **PUPPET},
        r"the pose moves by 3\..* m, that is 6.* m/s, but",
    ),
    "odom_sideways": (
        "odomtest.py",
        {"odom_topic": "/sideways", **PUPPET},
        "the pose moves sideways",
    ),
    "odom_missing": (
        "odomtest.py",
        {"odom_topic": "/nowhere", **MISSING},
        "waited 1 s for odometry on /nowhere",
    ),
    "odom_and_another_pose": (
        "odomtest.py",
        {**ODOM, "pose_topic": "/shifted", "test_duration": 5.0},
        "TF says something else than the pose: the pose .* is 0.1 m and 0 rad from",
    ),
}
LATE_CASES = {  # their patience begins with the clock
    "odom_without_tf": (
        "odomtest.py",
        {"odom_topic": "/right", **MISSING},
        "waited 1 s for a transform from 'puppet/odom' to 'puppet/base'",
    ),
}
MUX_CASES = {
    "mux": ("muxtest.py", {**MUX, "steps": RIGHT_STEPS}, ""),
    "mux_wrong": (
        "muxtest.py",
        {**MUX, "steps": WRONG_STEPS},
        "step 1, in which navigation and teleop send: teleop came out; expected navigation\n"
        "step 1, .*: teleop is said to drive; expected navigation\n"
        "step 2, in which navigation send: navigation came out; expected nothing\n",
    ),
    "mux_missing": (
        "muxtest.py",
        {**MUX, "output": "/nowhere", "steps": RIGHT_STEPS, **MISSING},
        "waited 1 s for a publisher of /nowhere",
    ),
    "mux_misspelt": (
        "muxtest.py",
        {**MUX, "steps": "[{send: [teleoperation], wins: idle}]"},
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
        names = ("right", "per_tick", "turn", "jump", "sideways", "back", "unstamped")
        self._odometry = {
            name: rospy.Publisher(f"/{name}", Odometry, queue_size=1000) for name in names
        }
        self._shifted = rospy.Publisher("/shifted", PoseStamped, queue_size=1000)
        self._poses = rospy.Subscriber("/car/car_pose", PoseStamped, self._shift)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _shift(self, msg):
        msg.pose.position.x += 0.1
        self._shifted.publish(msg)

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
            }
            for name, msg in messages.items():
                self._odometry[name].publish(msg)

    def end(self):
        self._ended.set()
        self._thread.join()
        self._poses.unregister()


class TestTestNodes(unittest.TestCase):
    def start(self, name, kind, parameters):
        """Start a test node."""
        every = {"wait_time": PATIENCE, **parameters}
        arguments = [f"_{key}:={self.files.get(value, value)}" for key, value in every.items()]
        process = node(kind, f"__name:=case_{name}", *arguments, "--text")
        self.addCleanup(process.end)
        return process

    def setUp(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        self.files = {}
        for name, rows in (("PLAN", ROWS), ("OTHER_PLAN", [*ROWS[:2], (1.5, 0.2, 5.0)])):
            self.files[name] = os.path.join(folder, f"{name.lower()}.txt")
            with open(self.files[name], "w") as file:
                file.write("\n".join(", ".join(map(str, row)) for row in (START, *rows)))

    @staticmethod
    def fault(name, process, expected):
        """Return what is wrong with the verdict of a node that is about to end, if anything is."""
        status = process.wait(PATIENCE)
        output = process.output
        is_right = status == bool(expected) and re.search(expected, output)
        if is_right and "ERROR:" not in output:  # which is an exception, and no verdict
            return []
        return [f"{name} said with the status {status}:\n{output}"]

    def test_poses_rates_and_odometry(self):
        """All of them listen to the same few seconds, which begin when the clock is let go."""
        rospy.wait_for_service("/car/car_sim/pause", PATIENCE)
        rospy.ServiceProxy("/car/car_sim/pause", Trigger)()
        resume = rospy.ServiceProxy("/car/car_sim/resume", Trigger)
        puppet = Puppet()
        self.addCleanup(puppet.end)
        self.addCleanup(resume)
        processes = {
            name: self.start(name, kind, parameters)
            for name, (kind, parameters, _) in CASES.items()
        }
        processes["driver"] = node(
            "path_publisher.py",
            f"_plan_file:={self.files['PLAN']}",
            f"_subscriber_timeout:={PATIENCE}",
            "__name:=case_driver",
        )
        self.addCleanup(processes["driver"].end)
        master = rospy.get_master()

        def have_subscribed():
            _, _, (_, subscribers, _) = master.getSystemState()
            nodes = {node for _, names in subscribers for node in names}
            return all(
                f"/case_{name}" in nodes or not process.running
                for name, process in processes.items()
            )

        wait_for(have_subscribed, "the test nodes to listen", PATIENCE)
        resume()
        self.assertEqual(processes["driver"].wait(PATIENCE), 0, processes["driver"].output)
        faults = []
        for name, (_, _, expected) in CASES.items():
            faults += self.fault(name, processes[name], expected)
        for name, (kind, parameters, expected) in LATE_CASES.items():
            faults += self.fault(name, self.start(name, kind, parameters), expected)
        self.assertEqual(faults, [], "\n".join(faults))

    def test_mux(self):
        for name, (kind, parameters, expected) in MUX_CASES.items():  # one after the other
            faults = self.fault(name, self.start(name, kind, parameters), expected)
            self.assertEqual(faults, [], "\n".join(faults))

    def test_in_a_test_file(self):
        """rostest takes a node's verdict for its own."""
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        package = rospkg.RosPack().get_path("mushr_ros_intro")
        fixture = os.path.join(package, "test", "fixtures", "posetest.test")
        with Process("rostest", fixture, ROS_TEST_RESULTS_DIR=folder) as run:
            self.assertNotEqual(run.wait(PATIENCE), 0, run.output)
        with open(os.path.join(folder, "mushr_ros_intro", "rosunit-nowhere.xml")) as file:
            self.assertIn("waited 1 s for a publisher of /nowhere", file.read())


if __name__ == "__main__":
    rospy.init_node("test_nodes_test")
    rostest.rosrun("mushr_ros_intro", "test_nodes", TestTestNodes)
