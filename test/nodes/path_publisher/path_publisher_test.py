#!/usr/bin/python3
"""Check how path_publisher begins, ends, is interrupted, and refuses."""

import math
import os
import signal

import rospkg
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from support.helpers import (
    Ghost,
    Process,
    Recording,
    RosTestCase,
    closed_form,
    kill,
    node,
    wait_for,
)

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
PACKAGE = rospkg.RosPack().get_path("mushr_ros_intro")
COMMAND_TIMEOUT = 0.2
"""[s] How long the car obeys its last command."""


class TestPathPublisher(RosTestCase):
    def setUp(self):
        super().setUp()
        self.commands = Recording(CONTROL, AckermannDriveStamped)
        self.placements = Recording("/initialpose", PoseWithCovarianceStamped)
        self.poses = Recording("/car/car_pose", PoseStamped).connected()

    def wait_for_commands(self, count):
        wait_for(lambda: len(self.commands.messages) >= count, f"{count} commands")

    def assert_rests_at(self, expected):
        last = self.commands.last.header.stamp
        self.assert_pose(self.poses.pose_at_rest(last + rospy.Duration(COMMAND_TIMEOUT)), expected)

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
        self.assertIn("was suspended", publisher.output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")

    def test_loop(self):
        """Each lap is a drive of its own, placed after the end of the last one."""
        path = self.plan("1,2,0.5\n1.0,0.2,0.25\n-1.0,0.1,0.3\n")
        options = (f"plan_file:={path}", "loop:=true")
        with Process(
            "roslaunch", "mushr_ros_intro", "path_publisher.launch", *options
        ) as publisher:
            wait_for(lambda: len(self.placements.messages) >= 4, "four laps", 60.0)
            publisher.send_signal(signal.SIGINT)
            publisher.wait()
        self.assertIn("plan.txt: 2 rows, 0.55 s, 0.55 m", publisher.output)
        commands = [m.header.stamp.to_nsec() for m in self.commands.messages]
        lap = [0, 100, 200, 250, 350, 450, 550]  # [ms], the last one is the stop
        placements = [m.header.stamp.to_nsec() for m in self.placements.messages]
        for number, placed in enumerate(placements[:3]):
            begin, *_ = stamps = commands[number * len(lap) : (number + 1) * len(lap)]
            self.assertEqual(stamps, [begin + due * 10**6 for due in lap])
            self.assertGreaterEqual(begin, placed + 10**8)
            self.assertGreater(placements[number + 1], stamps[-1])
            self.assertEqual(self.commands.messages[(number + 1) * len(lap) - 1].drive.speed, 0.0)

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

    def test_announces_itself_again_to_a_subscriber_that_missed_it(self):
        ghost = Ghost(subscribes=["/told_late"])
        self.addCleanup(ghost.end)
        options = ("_plan_file:=circle", "_control_topic:=/told_late", "_subscriber_timeout:=3.0")
        with node("path_publisher.py", *options) as publisher:
            self.assertEqual(publisher.wait(), 1, publisher.output)
        self.assertIn("these nodes are registered: /ghost. Do they respond", publisher.output)
        calls = [topic for topic, _ in ghost.calls["publisherUpdate"]]
        self.assertGreater(len(calls), 1)
        self.assertEqual(set(calls), {"/told_late"})

    def test_asks_again_for_the_pose_of_a_car_that_does_not_answer(self):
        ghost = Ghost(publishes=["/ghost/car_pose"])
        self.addCleanup(ghost.end)
        options = ("_plan_file:=circle", "_car_name:=ghost", "_subscriber_timeout:=3.0")
        topics = (f"_control_topic:={CONTROL}", "_init_pose_topic:=/initialpose")
        with node("path_publisher.py", *options, *topics) as publisher:
            self.assertEqual(publisher.wait(), 1, publisher.output)
        self.assertIn("was not at the start pose", publisher.output)
        self.assertGreater(len(ghost.calls["requestTopic"]), 1)
        self.assertEqual(self.commands.messages, [])

    def test_refuses_and_publishes_nothing(self):
        """Whatever is wrong: one message, status 1, nothing published."""
        broken = os.path.join(PACKAGE, "test", "fixtures", "broken_plans", "not_a_number.txt")
        cases = [
            ([f"_plan_file:={broken}"], f"{broken}:"),
            (["_plan_file:=figure_9"], "circle, closed_figure_8, figure_8"),
            (["_plan_file:=circle", "_loop:=maybe"], "parameter ~loop is 'maybe'"),
            ([], "parameter ~plan_file is not set; expected the name or the path of a plan"),
            (
                ["_plan_file:=circle", "_control_topic:=/nobody", "_subscriber_timeout:=0.5"],
                "no node subscribes to /nobody",
            ),
            (
                ["_plan_file:=circle", "_init_pose_topic:=/nowhere", "_subscriber_timeout:=3.0"],
                "no node subscribes to /nowhere",
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
        self.assertIn("was not at the start pose (0.0000 m", publisher.output)
        self.assertEqual(self.commands.messages, [])


if __name__ == "__main__":
    rospy.init_node("path_publisher_test")
    rostest.rosrun("mushr_ros_intro", "path_publisher", TestPathPublisher)
