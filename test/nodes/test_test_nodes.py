"""Check the test nodes on a drive, and on wrong topics.

The cases run in threads of this process, because a process for each takes one second of CPU time.
`test_in_a_test_file` runs the test nodes as nodes.
"""

import math
import os
import re
import sys
import threading
import unittest
from xml.etree import ElementTree

import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_srvs.srv import Trigger

from support.geometry import closed_form
from support.helpers import (
    ForkedProcess,
    Recording,
    RosTestCase,
    driver,
    wait_for,
    wait_for_receiver,
)
from support.messages import at
from support.paths import FIXTURES, PACKAGE
from support.world import LOCK_STEP, launch

sys.path.append(os.path.join(PACKAGE, "src"))
import posetest  # noqa: E402
from mushr_ros_intro.ros.connections import receivers  # noqa: E402

PATIENCE = 90.0
"""[s] The time limit for the start of all nodes on a busy machine."""

ROWS = [(1.0, 0.1, 1.0), (2.0, -0.1, 1.0), (1.5, 0.2, 1.5)]
START = (1.0, 2.0, 0.5)
END = closed_form(START, ROWS)

POSE = {"topic": "/car/car_pose"}
AT_END = {"x": END[0], "y": END[1], "theta": END[2], "position_tolerance": "1e-5"}
AT_START = {"x": START[0], "y": START[1]}


def pose(topic, **parameters):
    return posetest.PoseTest, {"topic": topic, "x": 0.0, "y": 0.0, **parameters}


# A test, its parameters, and the expression that its failure matches; if empty, the test passes.
CASES = [
    ((posetest.PoseTest, {**POSE, **AT_END}), ""),
    (
        (posetest.PoseTest, {**POSE, **AT_START}),
        r"after 5 s the pose is \(.* m from the expected \(1\.[^,]*, \S* m\); tolerance 0.05 m$",
    ),
    ((posetest.PoseTest, {**POSE, **AT_END, "theta": 3.0}), "tolerances 1e-05 m and 0.05 rad"),
    ((posetest.PoseTest, POSE), "parameter ~x is not set; expected a number"),
    ((posetest.PoseTest, {"x": 0, "y": 0}), "parameter ~topic is not set; expected a topic"),
    (pose("/broken", position_tolerance=99), r"a pose on /broken: pose \(nan, .* is not finite"),
    (pose("/clock"), "/clock has the type rosgraph"),
]


def start_world():
    return launch("sim.launch", **LOCK_STEP, map="none", laser=False, model=False, watched=False)


class Puppet(threading.Thread):
    """Publishes a pose on /broken every 0.05 s until it is ended; one of them is not finite."""

    def __init__(self):
        super().__init__()
        self._publisher = rospy.Publisher("/broken", PoseStamped, queue_size=1000)
        self._ended = threading.Event()
        self.start()

    def run(self):
        begin, number = rospy.Time.now(), 0
        while not self._ended.is_set():
            number += 1
            due = at(begin, 0.05 * number)
            wait_for(lambda due=due: rospy.Time.now() >= due, "the clock to run", PATIENCE)
            message = PoseStamped()
            message.header.stamp = due
            message.pose.orientation.w = 1.0
            message.pose.position.x = math.nan if number == 40 else 0.0
            self._publisher.publish(message)

    def end(self):
        self._ended.set()
        self.join()


class Case(threading.Thread):
    """Runs a test node's test in a thread, with its own parameters and its own result."""

    _parameters = threading.Lock()  # all cases use the private parameters of this node

    def __init__(self, kind, parameters, expected):
        super().__init__(name=f"{kind.__name__} {parameters}", daemon=True)
        self._expected = expected
        self._result = unittest.TestResult()
        self.is_waiting = False
        case = self

        class Test(kind):
            def setUp(self):
                with Case._parameters:
                    # This also deletes the parameters of the previous case.
                    rospy.set_param(rospy.get_name(), {"wait_time": PATIENCE, **parameters})
                    super().setUp()

            def wait_for(self, condition, what, seconds):
                def noted():
                    value = condition()
                    case.is_waiting |= not value
                    return value

                return super().wait_for(noted, what, seconds)

        self._tests = unittest.defaultTestLoader.loadTestsFromTestCase(Test)
        self.start()

    def run(self):
        self._tests.run(self._result)

    def faults(self):
        """Wait for the verdict; return what is wrong with it."""
        self.join(PATIENCE)
        if self.is_alive():
            return [f"{self.name} did not end"]
        failures = [text for _, text in self._result.failures]
        errors = [text for _, text in self._result.errors]
        is_right = len(failures) == bool(self._expected) and self._result.testsRun == 1
        if is_right and not errors and all(re.search(self._expected, text) for text in failures):
            return []
        return ["\n".join([f"{self.name}:", *failures, *errors])]


def is_connected():
    """Return whether all publishers of the topics of this node are connected with it."""
    name, master = rospy.get_name(), rospy.get_master()
    _, _, (publishers, subscribers, _) = master.getSystemState()
    topics = {topic for topic, names in subscribers if name in names}
    return all(
        name in receivers(master.lookupNode(sender)[2], PATIENCE, name, topic)
        for topic, senders in publishers
        if topic in topics
        for sender in senders
    )


class TestTestNodes(RosTestCase):
    def start(self, cases):
        """Start cases in parallel."""
        found = []
        for (kind, parameters), expected in cases:
            found.append(Case(kind, parameters, expected))
        return found

    def check(self, cases):
        """Wait for the verdicts of cases, and fail if one is wrong."""
        faults = [fault for case in cases for fault in case.faults()]
        self.assertEqual(faults, [], "\n".join(faults))

    def test_poses(self):
        """All cases observe the same few seconds, which begin when the clock resumes."""
        rospy.wait_for_service("/car/car_sim/pause", PATIENCE)
        wait_for(rospy.get_time, "the clock", PATIENCE)
        rospy.ServiceProxy("/car/car_sim/pause", Trigger)()
        resume = rospy.ServiceProxy("/car/car_sim/resume", Trigger)
        self.ending(Puppet())
        self.addCleanup(resume)

        placements = Recording("/initialpose", PoseWithCovarianceStamped)
        cases = self.start(CASES)
        plan = self.plan("\n".join(", ".join(map(str, row)) for row in [START, *ROWS]))
        process = self.ending(driver(plan, "__name:=case_driver"))

        def do_listen():
            return all(case.is_waiting or not case.is_alive() for case in cases)

        wait_for(do_listen, "the test nodes to listen", PATIENCE)
        wait_for_receiver("/case_driver", "/car/car_sim", "/car/car_pose")
        wait_for(is_connected, "the test nodes to be connected", PATIENCE)
        # At first, the driver places the car.
        rospy.ServiceProxy("/car/car_sim/step", Trigger)()
        wait_for(lambda: placements.messages, "the start pose", PATIENCE)
        resume()
        self.assertEqual(process.wait(PATIENCE), 0)
        self.check(cases)

    def test_in_a_test_file(self):
        """The result files of rostest contain the failures of the test nodes."""
        fixture = os.path.join(FIXTURES, "missing_topics.test.xml")
        with ForkedProcess("rostest", fixture, ROS_TEST_RESULTS_DIR=self.folder) as run:
            self.assertNotEqual(run.wait(PATIENCE), 0, run.output)
        path = os.path.join(self.folder, "mushr_ros_intro", "rosunit-pose_nowhere.xml")
        (failure,) = ElementTree.parse(path).iter("failure")
        self.assertIn("waited 0.5 s for a pose on /nowhere", failure.text)
