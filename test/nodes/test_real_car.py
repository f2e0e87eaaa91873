"""Check what path_publisher and drive_monitor do before a drive, and drives of a real car."""

import contextlib
import math
import re
import signal
from xml.etree import ElementTree

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Path
from std_msgs.msg import String

from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.errors import UserError
from support.cars import CARS
from support.geometry import closed_form, planar
from support.helpers import (
    ForkedProcess,
    Recording,
    RosTestCase,
    driver,
    failures_in,
    monitor,
    publisher,
    wait_for,
)
from support.messages import MUX, NAVIGATION, TELEOP
from support.world import LOCK_STEP, launch

NAME = "/path_publisher"

AT_WALL = 49.4 - 0.38
"""[m] The x coordinate of a car that drives along x and stops at the sandbox's wall."""

FOUND = 1e-6
"""[m, rad] The resolution of the contact, and the limit of the prediction's error."""

WARNINGS = re.compile(r"\[WARN\] \[[^]]*\]: (.*)")


nodes = []


def start_world():
    """Run a simulated car that stands in for the actual car."""
    nodes.extend(launch("sim.launch", car="mushr_nano", **LOCK_STEP, laser=False, model=False))
    return nodes


class TestRealCar(RosTestCase):
    def setUp(self):
        super().setUp()
        self.commands = Recording(NAVIGATION, AckermannDriveStamped)
        self.placements = Recording("/initialpose", PoseWithCovarianceStamped)
        self.paths = Recording("/car/predicted_path", Path)
        self.addCleanup(self.forget)

    def wait_for_prediction(self, *start, seconds=None):
        """Return the predicted path with a start pose, and perhaps a duration."""

        def is_found(path):
            lasts = path.poses[-1].header.stamp - path.header.stamp
            is_long = seconds is None or lasts == rospy.Duration(seconds)
            return is_long and math.dist(planar(path.poses[0].pose), start) < FOUND

        return wait_for(lambda: next(filter(is_found, self.paths.messages), None), "the path")

    @staticmethod
    def forget():
        """Delete the node's parameters, because the next node has the same name."""
        with contextlib.suppress(KeyError):
            rospy.delete_param(NAME)

    # Before it drives

    def test_faults_are_warnings_and_the_prediction_ends_at_the_wall(self):
        plan = self.plan("47,0,0\n0.9,0\n2.0, 0.0, 3\n")
        output = self.drive_plan(plan, status=1)
        fast = "line 3 asks for 2 m/s; the car does 0.9286 m/s at most"
        wall = "the car hits a wall at t = 2.3 s, (49.0, 0.0); it stops there"
        warnings = WARNINGS.findall(output)
        self.assertEqual(warnings[:-1], [f"{plan}:3:1: {each}" for each in (fast, wall)])
        self.assertIn("the car stopped at a wall at (49.0200 m", warnings[-1])
        at_wall = re.compile(
            r"FATAL.* the car stopped at a wall in line 3 of 3 at \((.*) m, 0.0000 m, 0.0000 rad\)"
        )
        self.assertAlmostEqual(float(at_wall.search(output)[1]), AT_WALL, delta=1e-4)
        end = planar(self.wait_for_prediction(47.0, 0.0, 0.0).poses[-1].pose)
        self.assertLess(math.dist(end, (AT_WALL, 0.0, 0.0)), FOUND)

    def test_refusals(self):
        """Each fault is one message and exit status 1."""
        name, circle = "path_publisher.py", "_plan_file:=circle"
        self.assert_refused(
            (name, [circle, "_max_speed:=0.0"], "parameter ~max_speed is 0.0; expected a number"),
            ("drive_monitor.py", ["_car:=tx2"], f"{max(CARS)}; did you mean mushr_tx2?"),
            ("drive_monitor.py", ["_plan_file:=figure_9"], "circle, closed_figure_8, figure_8"),
        )
        # In this process: in a node, an earlier wait could have the same timeout.
        unused = CommandPublisher("/unused", "/nobody")
        with self.assertRaisesRegex(UserError, "no message was published on /nobody within 0 s"):
            unused.wait_until_free(0.0, 0.0)

    def test_a_start_pose_in_a_wall_and_a_broken_map(self):
        """The node waits for the car, which refuses the start pose, and sends no command."""
        ready = "ready: the car is at"  # with the map, which this path_publisher does not wait for
        wait_for(lambda: any(ready in each.output for each in nodes), "the car")
        broken = rospy.Publisher("/broken_map", OccupancyGrid, queue_size=1, latch=True)
        self.addCleanup(broken.unregister)
        broken.publish(OccupancyGrid())
        plan = self.plan("49.4,0,0\n0.5,0.1\n")
        results = f"{plan}.xml"
        of_rostest = f"--gtest_output=xml:{results}", "--text"
        with monitor(plan, "/map:=/broken_map", *of_rostest) as watching, driver(plan) as process:
            wait_for(lambda: self.placements.last, "the start pose")
            said = "the map on /broken_map cannot be read: "
            wait_for(lambda: said in watching.output, "the message")
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(), 1)
            self.assertEqual(watching.wait(), 1)
        said = "/path_publisher has ended, and has not moved the car"
        self.assertIn(said, watching.output)
        self.assertEqual(failures_in(ElementTree.parse(results)), {"drive": said})
        self.assertEqual(self.commands.messages, [])

    # A real car

    def test_real_car_launch(self):
        """No initial pose, limited speeds, a countdown, a stop, the end relative to the start."""
        rospy.set_param("/path_publisher/loop", True)  # as if from an earlier drive
        plan = self.plan("5,6,1\n2.0,0.0\n-1.5,0.0,0.5\n0.5,0.0\n")
        arguments = (f"plan_file:={plan}", "countdown:=1", "car:=ideal")
        with ForkedProcess("roslaunch", "mushr_ros_intro", "real_car.launch", *arguments) as launch:
            launch.wait()
        self.assertEqual(launch.output.count("process has finished cleanly"), 2, launch.output)
        warning = "lines 2 to 3 ask for -1.5 to 2 m/s; the largest speed allowed is 1 m/s"
        self.assertIn(f"{plan}:2:1: {warning}", launch.output)
        self.assertIn("the car starts to drive in 1 s", launch.output)
        self.assertIn("should stand 1.00 m ahead of its start, 0.00 m to the left", launch.output)
        self.assertEqual(self.placements.messages, [])
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
        speeds = [message.drive.speed for message in self.commands.messages]
        self.assertEqual(speeds, [1.0] * 10 + [-1.0] * 5 + [0.5] * 10 + [0.0])

    def test_interrupted_countdown(self):
        """Ctrl-C in the countdown: no command at all, and a clean end; the path is shown before."""
        plan = self.plan("1,2,0.5\n0.5,0.3,2500\n")
        with monitor(plan, "_car:=ideal") as watching, driver(plan, "_countdown:=60") as process:
            wait_for(lambda: "the car starts to drive in 60 s" in process.output, "the countdown")
            path = self.wait_for_prediction(1.0, 2.0, 0.5, seconds=2500)  # not with the mushr_nano
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(), 1)
            self.assertEqual(watching.wait(), 1)
        self.assertEqual(self.commands.messages, [])
        self.assertEqual(self.placements.messages, [])
        stamps = [pose.header.stamp - path.header.stamp for pose in path.poses]
        self.assertEqual([stamp.to_nsec() for stamp in stamps[:3]], [0, 25 * 10**7, 50 * 10**7])
        self.assertEqual(stamps[-1], rospy.Duration(2500))
        for pose, stamp in zip(path.poses[::500], stamps[::500]):
            expected = closed_form((1.0, 2.0, 0.5), [(0.5, 0.3, stamp.to_sec())])
            self.assert_pose(planar(pose.pose), expected)

    def test_teleop_takes_over(self):
        """The node sends a stop, ends with exit status 1, and logs one message."""
        teleop = publisher(TELEOP, AckermannDriveStamped)
        plan = self.plan("0,0,0\n0.5,0.1,900\n")
        arguments = ("_send_init_pose:=false", f"_active_topic:={MUX}/active")
        with driver(plan, *arguments) as process:
            wait_for(lambda: len(self.commands.messages) > 5, "commands")
            teleop.publish(AckermannDriveStamped())
            self.assertEqual(process.wait(), 1)
        teleop.unregister()
        self.assertEqual(process.output.count("FATAL"), 1)
        self.assertIn("active is 'teleop': another input drives the car", process.output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
        self.assertEqual([m.drive.speed for m in self.commands.messages].count(0.0), 1)
        self.assertLess(len(self.commands.messages), 9000)

    def drive_under(self, mux, *names):
        """Drive while a mux publishes these active inputs; return the output of the node."""
        plan = self.plan("0,0,0\n0.5,0.1,900\n")
        mux.publish(String(names[0]))
        with driver(plan, "_send_init_pose:=false", "_active_topic:=/active") as process:
            for name in names[1:]:
                wait_for(lambda: self.commands.messages or not process.running, "a command")
                mux.publish(String(name))
            self.assertEqual(process.wait(), 1)
        self.assertEqual(process.output.count("FATAL"), 1)
        return process.output

    def test_the_active_inputs_of_mushrs_mux(self):
        """The inputs have other names, and the default input sends stops."""
        mux = rospy.Publisher("/active", String, queue_size=10, latch=True)
        output = self.drive_under(mux, "Teleoperation")
        self.assertIn("/active is 'Teleoperation': another input drives the car", output)
        self.assertIn("(RB) is pressed", output)
        self.assertEqual(self.commands.messages, [])
        output = self.drive_under(mux, "Default", "Navigation", "Default")
        self.assertIn("/active is 'Default': the commands did not reach the car in time", output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
        mux.unregister()

    def test_the_mux_is_killed(self):
        """The plan ends, although a node still subscribes to the commands; this car drives on."""
        plan = self.plan("0,0,0\n0.5,0.1,900\n")
        mux = ForkedProcess("rostopic", "pub", "/killed", "std_msgs/String", "Navigation")
        poses = rospy.Publisher("/other/car_pose", PoseStamped, queue_size=10)
        self.addCleanup(poses.unregister)
        pose = PoseStamped()
        pose.pose.orientation.w = 1.0

        def report(event):
            pose.header.stamp = event.current_real
            pose.pose.position.x += 0.1
            poses.publish(pose)

        timer = rospy.Timer(rospy.Duration(0.05), report)
        self.addCleanup(timer.join)
        self.addCleanup(timer.shutdown)
        other = ("_car_name:=other", f"_control_topic:={NAVIGATION}", "_active_topic:=/killed")
        moving = ("/car/car_pose:=/other/car_pose",)
        with mux, monitor(plan, *moving) as watching:
            with driver(plan, "_send_init_pose:=false", *other) as process:
                wait_for(lambda: self.commands.messages, "a command")
                mux.send_signal(signal.SIGKILL)
                self.assertEqual(process.wait(), 1)
            self.assertEqual(watching.wait(), 1)
        self.assertEqual(process.output.count("FATAL"), 1)
        self.assertIn("the node that published /killed is no longer connected", process.output)
        self.assertIn("ended in line 2 of 2; the car was last reported at", watching.output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
