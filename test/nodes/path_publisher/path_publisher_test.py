#!/usr/bin/python3
"""Check how path_publisher begins, ends, is interrupted, and refuses."""

import glob
import math
import os
import shutil
import signal
import tempfile
import unittest

import rospkg
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from mushr_ros_intro.parameters import ParameterError
from mushr_ros_intro.plan.model import PlanError
from support.helpers import (
    ANGLE_TOLERANCE,
    POSITION_TOLERANCE,
    Ghost,
    Process,
    Recording,
    angle_between,
    closed_form,
    kill,
    module,
    node,
    private_parameters,
    wait_for,
)

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
PACKAGE = rospkg.RosPack().get_path("mushr_ros_intro")
COMMAND_TIMEOUT = 0.2
"""[s] How long the car obeys its last command."""


class TestPathPublisher(unittest.TestCase):
    def setUp(self):
        self.commands = Recording(CONTROL, AckermannDriveStamped)
        self.placements = Recording("/initialpose", PoseWithCovarianceStamped)
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)

    def plan(self, text, name="plan.txt"):
        """Write a plan file; return its path."""
        path = os.path.join(self.folder, name)
        with open(path, "w") as file:
            file.write(text)
        return path

    def wait_for_commands(self, count):
        wait_for(lambda: len(self.commands.messages) >= count, f"{count} commands")

    def assert_rests_at(self, expected):
        last = self.commands.last.header.stamp
        x, y, theta = self.poses.pose_at_rest(last + rospy.Duration(COMMAND_TIMEOUT))
        self.assertLess(math.hypot(x - expected[0], y - expected[1]), POSITION_TOLERANCE)
        self.assertLess(angle_between(theta, expected[2]), ANGLE_TOLERANCE)

    def driven_until_stopped(self, commands):
        """Return where commands like those of the test's plan have taken the car."""
        seconds = (commands[-1].header.stamp - commands[0].header.stamp).to_sec()
        return closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)])

    def test_interrupted(self):
        """Ctrl-C: the last message is a stop, and the car obeys it."""
        path = self.plan("0,0,0\n1.0,0.2,60\n")
        for number in (signal.SIGINT, signal.SIGTERM):
            self.setUp()
            with node("path_publisher.py", f"_plan_file:={path}") as publisher:
                self.wait_for_commands(5)
                publisher.send_signal(number)
                self.assertEqual(publisher.wait(), 0, publisher.output)
            wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
            self.assert_rests_at(self.driven_until_stopped(self.commands.messages))

    def test_killed(self):
        """kill -9: no stop comes, and the car stops when the last command runs out."""
        path = self.plan("0,0,0\n1.0,0.2,60\n")
        obeyed = Recording("/car/mux/ackermann_cmd_mux/output", AckermannDriveStamped).connected()
        with node("path_publisher.py", f"_plan_file:={path}", "__name:=killed") as publisher:
            wait_for(lambda: len(obeyed.messages) >= 5, "five commands")
            kill("/killed", publisher.pid)
            publisher.wait()
        self.assertEqual(self.commands.last.drive.speed, 1.0)
        # It may have died between sending its last command to the mux and to this test.
        wait_for(lambda: obeyed.last.drive.speed == 0.0, "the mux to stop the car")
        self.assert_rests_at(self.driven_until_stopped(obeyed.messages))

    def test_stalled(self):
        """A publisher that cannot keep to its plan says so, stops the car and fails."""
        path = self.plan("0,0,0\n1.0,0.0,60\n")
        with node("path_publisher.py", f"_plan_file:={path}") as publisher:
            self.wait_for_commands(5)
            publisher.send_signal(signal.SIGSTOP)
            stopped = rospy.Time.now()
            wait_for(lambda: (rospy.Time.now() - stopped).to_sec() > 1.5, "time to pass")
            publisher.send_signal(signal.SIGCONT)
            self.assertEqual(publisher.wait(), 1, publisher.output)
        self.assertIn("stood still", publisher.output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")

    def test_loop(self):
        """Each lap begins with the start pose and is due 0.1 s after the end of the one before."""
        path = self.plan("1,2,0.5\n1.0,0.2,0.25\n-1.0,0.1,0.3\n")
        with Process(
            "roslaunch",
            "mushr_ros_intro",
            "path_publisher.launch",
            f"plan_file:={path}",
            "loop:=true",
        ) as publisher:
            wait_for(lambda: len(self.placements.messages) >= 4, "four laps", 60.0)
            publisher.send_signal(signal.SIGINT)
            publisher.wait()
        self.assertIn("plan.txt: 2 rows, 0.55 s, 0.55 m, in a loop; commands to", publisher.output)
        commands = [m.header.stamp.to_nsec() for m in self.commands.messages]
        begin = commands[0]
        lap = [0, 100, 200, 250, 350, 450, 550]  # [ms], the last one is the stop
        expected = [begin + (number * 650 + due) * 10**6 for number in range(3) for due in lap]
        self.assertEqual(commands[: len(expected)], expected)
        placements = [m.header.stamp.to_nsec() for m in self.placements.messages]
        self.assertLessEqual(placements[0], begin)
        self.assertEqual(placements[1:3], [begin + 550 * 10**6, begin + 1200 * 10**6])

    def test_tutorial_listing(self):
        """The tutorial's own way ends within the 0.2 s that the stop it does not send costs."""
        rows = [(2.0, 0.09, 1.0), (3.0, -0.15, 1.0)]
        path = self.plan("0,0,0.0\n2.0,0.09\n3.0,-0.15")
        with node("listing.py", f"_plan_file:={path}") as listing:
            self.assertEqual(listing.wait(), 0, listing.output)
        self.assertGreaterEqual(len(self.commands.messages), 19)
        x, y, _ = self.poses.pose_at_rest(rospy.Time.now() + rospy.Duration(COMMAND_TIMEOUT))
        # Its rows begin when its thread wakes: they share 2 s, but not to the last millisecond.
        slack = 3.0 * (COMMAND_TIMEOUT + 0.05)
        expected = closed_form((0.0, 0.0, 0.0), rows)
        self.assertLess(math.hypot(x - expected[0], y - expected[1]), slack)

    def test_plans_by_name_and_by_path(self):
        rospy.set_param("/path_publisher/send_init_pose", False)  # of an earlier drive
        # So slow that what a busy machine adds on the way does not show in two digits.
        path = self.plan("3,4,1\n0.02,0.1,1\n", "mine.txt")
        expected = closed_form((3.0, 4.0, 1.0), [(0.02, 0.1, 1.0)])
        for name in (path, "mine.txt"):  # a relative path leads from where the user stands
            self.commands.clear()
            with Process(
                "roslaunch",
                "mushr_ros_intro",
                "path_publisher.launch",
                f"plan_file:={name}",
                PWD=self.folder,
            ) as publisher:
                self.assertEqual(publisher.wait(), 0, publisher.output)
                self.assertIn("the car drove 0.02 m", publisher.output)
            self.assert_rests_at(expected)
        for name in ("parallel_parking", "parallel_parking.txt"):
            self.commands.clear()
            with node("path_publisher.py", f"_plan_file:={name}") as publisher:
                self.wait_for_commands(1)
            self.assertEqual(self.commands.messages[0].drive.speed, 1.0)

    def test_when_the_first_command_is_due(self):
        """One period after the placement, or after what there was to wait for."""
        first_due, period = module("path_publisher.py").first_due, 10**8
        for placed, reported, now, leads, expected in (
            (0, 1, 1, False, period),
            (0, 1, 3 * period, False, 3 * period),
            (0, 1, 3 * period, True, period),  # the present is what the clock happens to show
            (0, period - 1, 3 * period, True, period),
            (0, period, period, True, 2 * period),
            (0, 2 * period + 7, 9 * period, True, 3 * period + 7),
        ):
            self.assertEqual(first_due(placed, reported, now, leads), expected)

    def test_reminds_a_subscriber_that_was_not_told_of_it(self):
        parameters = {
            "plan_file": "circle",
            "control_topic": "/told_late",
            "subscriber_timeout": 3.0,
        }
        path_publisher = module("path_publisher.py")
        with private_parameters(parameters):
            made = path_publisher.PathPublisher()
        ghost = Ghost(subscribes=["/told_late"])
        self.addCleanup(ghost.end)
        with self.assertRaisesRegex(path_publisher.DriveError, "knows who should be: /ghost. Does"):
            made.run()
        calls = wait_for(lambda: ghost.calls["publisherUpdate"], "the subscriber to be told")
        self.assertEqual(calls, [["/told_late", [rospy.get_node_uri()]]] * len(calls))

    def test_reminds_the_car_that_reports_its_pose(self):
        ghost = Ghost(publishes=["/ghost/car_pose"])
        self.addCleanup(ghost.end)
        path_publisher = module("path_publisher.py")
        parameters = {"plan_file": "circle", "car_name": "ghost", "subscriber_timeout": 3.0}
        parameters.update(control_topic=CONTROL, init_pose_topic="/initialpose")
        with private_parameters(parameters):
            made = path_publisher.PathPublisher()
        wait_for(lambda: ghost.calls["requestTopic"], "the node to ask once")
        with self.assertRaisesRegex(path_publisher.DriveError, "did not take the start pose"):
            made.run()
        self.assertGreater(len(ghost.calls["requestTopic"]), 1)
        self.assertEqual(self.commands.messages, [])

    def test_refuses_every_broken_plan_and_parameter(self):
        """The node that this process would be is not made, and says where the fault is."""
        broken = sorted(
            glob.glob(os.path.join(PACKAGE, "test", "fixtures", "broken_plans", "*.txt"))
        )
        self.assertGreater(len(broken), 5)
        cases = [({"plan_file": path}, f"{path}:") for path in broken]
        cases += [
            ({"plan_file": self.folder}, f"{self.folder}:1:1: this is a directory"),
            ({"plan_file": "/no/such/plan.txt"}, "/no/such/plan.txt:1:1: no such plan file"),
            ({"plan_file": 8}, "parameter ~plan_file is 8; expected text"),
            ({}, "parameter ~plan_file is not set"),
            ({"plan_file": "circle", "loop": "maybe"}, "parameter ~loop is 'maybe'"),
            ({"plan_file": "circle", "subscriber_timeout": -1}, "parameter ~subscriber_timeout"),
        ]
        path_publisher = module("path_publisher.py")
        for parameters, message in cases:
            refused = self.assertRaises((ParameterError, PlanError), msg=str(parameters))
            with private_parameters(parameters), refused as caught:
                path_publisher.PathPublisher()
            self.assertIn(message, str(caught.exception))
        self.assertEqual(self.commands.messages, [])
        self.assertEqual(self.placements.messages, [])

    def test_refuses_and_publishes_nothing(self):
        """Whatever is wrong: one message, status 1, nothing published."""
        broken = os.path.join(PACKAGE, "test", "fixtures", "broken_plans", "not_a_number.txt")
        cases = [
            ([f"_plan_file:={broken}"], f"{broken}:"),
            (["_plan_file:=figure_9"], "circle, closed_figure_8, figure_8"),
            (["_plan_file:=circle", "_loop:=maybe"], "parameter ~loop is 'maybe'"),
            (
                ["_plan_file:=circle", "_control_topic:=/nobody", "_subscriber_timeout:=0.5"],
                "nobody subscribes to /nobody",
            ),
            (
                ["_plan_file:=circle", "_init_pose_topic:=/nowhere", "_subscriber_timeout:=3.0"],
                "nobody subscribes to /nowhere",
            ),
        ]
        nodes = [
            node("path_publisher.py", f"__name:=refused_{index}", *arguments)
            for index, (arguments, _) in enumerate(cases)
        ]
        for process, (arguments, message) in zip(nodes, cases):
            with process:
                self.assertEqual(process.wait(60.0), 1, (arguments, process.output))
                self.assertIn(message, process.output)
                self.assertNotIn("Traceback", process.output)
        self.assertEqual(self.commands.messages, [])
        self.assertEqual(self.placements.messages, [])

    def test_start_pose_that_is_not_taken(self):
        """Where the car reports another pose, the node says so, and sends no command."""
        wrong = rospy.Subscriber("/wrong_initialpose", PoseWithCovarianceStamped)
        with node(
            "path_publisher.py",
            "_plan_file:=slalom",
            "_init_pose_topic:=/wrong_initialpose",
            "_subscriber_timeout:=3.0",
        ) as publisher:
            # slalom starts at the origin, so the car must be elsewhere
            self.assertEqual(publisher.wait(), 1, publisher.output)
        wrong.unregister()
        self.assertIn("did not take the start pose (0.0000 m", publisher.output)
        self.assertEqual(self.commands.messages, [])


if __name__ == "__main__":
    rospy.init_node("path_publisher_test")
    rostest.rosrun("mushr_ros_intro", "path_publisher", TestPathPublisher)
