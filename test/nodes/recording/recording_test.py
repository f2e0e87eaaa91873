#!/usr/bin/python3
"""Check that a plan that was clicked, and one that was recorded, end where they should."""

import math
import os
import shutil
import signal
import tempfile
import unittest

import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from std_srvs.srv import Trigger

from support.helpers import (
    Recording,
    closed_form,
    node,
    planar,
    publisher,
    wait_for,
    wait_for_recorder,
)

CLICK_TOLERANCE = 1e-3
"""[m] Between a click and where the car stops. Commands are float32, and round to about 1e-6."""

REPLAY_TOLERANCE = 1e-6
"""[m, rad] Between a drive and its replay, which are the same arcs."""

LENGTH_TOLERANCE = 5e-3
"""[m] Between the plan's length, and that of the chords of its path, which are 0.2 m long."""

LEAD = rospy.Duration(0.3)
"""How far ahead of the clock a drive begins: time to send its commands."""

DRIVE = [
    (0.0, 1.0, 0.2),
    (0.1, 1.0, 0.2),
    (0.17, 1.5, -0.3),  # good for 0.2 s; then the mux stops the car
    (0.55, -0.8, 0.1),
    (0.65, -0.8, 0.1),
]
"""[s, m/s, rad] When a hand sends what."""

ROWS = [(1.0, 0.2, 0.17), (1.5, -0.3, 0.2), (0.0, 0.0, 0.18), (-0.8, 0.1, 0.3)]
"""[m/s, rad, s] What is to be recorded of that."""


def pose_msg(x, y, theta):
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = rospy.Time.now()
    msg.header.frame_id = "map"
    msg.pose.pose.position.x, msg.pose.pose.position.y = x, y
    msg.pose.pose.orientation.z = math.sin(theta / 2.0)
    msg.pose.pose.orientation.w = math.cos(theta / 2.0)
    return msg


def read(path):
    """Read a plan file that is known to be good."""
    with open(path) as file:
        lines = [line.split("#")[0].strip() for line in file]
    numbers = [tuple(map(float, line.split(","))) for line in lines if line]
    return numbers[0], numbers[1:]


class TestRecording(unittest.TestCase):
    def setUp(self):
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)

    def start(self, name, *arguments):
        """Start a node that writes into the test's own folder, and wait for it."""
        process = node(name, f"_folder:={self.folder}", *arguments)
        self.addCleanup(process.end)
        self.name = name[:-3]
        rospy.wait_for_service(f"{self.name}/save", 30.0)
        return process

    def call(self, service, name=None):
        return rospy.ServiceProxy(f"{name or self.name}/{service}", Trigger)()

    def save(self, file):
        """Save the plan; return its path, which has to be that of a `file` in the folder."""
        answer = self.call("save")
        path = os.path.join(os.path.realpath(self.folder), file)
        self.assertTrue(answer.success, answer.message)
        self.assertIn(f"saved {path}; the plan has ", answer.message)
        return path

    def drive(self, path):
        """Drive a plan file; return where the car stops."""
        with node("path_publisher.py", f"_plan_file:={path}") as process:
            self.assertEqual(process.wait(60.0), 0, process.output)
        return self.poses.pose_at_rest(rospy.Time.now())

    def assert_at(self, pose, point, tolerance=CLICK_TOLERANCE):
        self.assertLess(math.hypot(pose[0] - point[0], pose[1] - point[1]), tolerance)

    def test_clicks(self):
        process = self.start("click_planner.py", "_speed:=4.0")
        paths = Recording("/click_planner/path", Path).connected()
        starts = publisher("/initialpose", PoseWithCovarianceStamped)
        points = publisher("/clicked_point", PointStamped)
        wait_for(lambda: paths.last is not None and not paths.last.poses, "an empty path")

        def click(point, frame="map"):
            msg = PointStamped()
            msg.header.stamp, msg.header.frame_id = rospy.Time.now(), frame
            msg.point.x, msg.point.y = point
            points.publish(msg)

        def wait_for_path(end, count):
            def is_there():
                path = paths.last
                if not path.poses or path.header.frame_id != "map":
                    return False
                x, y, _ = planar(path.poses[-1].pose)
                return math.hypot(x - end[0], y - end[1]) < CLICK_TOLERANCE

            wait_for(is_there, f"a path that ends in {end}")
            wait_for(lambda: f"the plan has {count} row" in process.output, f"{count} rows")

        click((1.0, 1.0))
        wait_for(lambda: "no start pose yet" in process.output, "a click without a start")
        starts.publish(pose_msg(1.0, 2.0, 0.5))
        wait_for(lambda: paths.last.poses, "the start of the path")
        self.assert_at(planar(paths.last.poses[0].pose), (1.0, 2.0))
        self.assertIn("there is no click", self.call("undo").message)
        self.assertFalse(self.call("save").success)

        clicks = [(3.0, 3.5), (1.5, 3.0), (3.0, 5.5)]  # the second one is behind the car
        for count, point in enumerate(clicks, 1):
            click(point)
            wait_for_path(point, count)
        self.assertIn("click 2: ", process.output)
        self.assertEqual(process.output.count("in reverse"), 1)
        length = float(self.call("save").message.split(" rows, ")[1].split(" m")[0])
        drawn = [planar(each.pose) for each in paths.last.poses]
        self.assertAlmostEqual(
            sum(math.dist(one[:2], other[:2]) for one, other in zip(drawn, drawn[1:])),
            length,
            delta=LENGTH_TOLERANCE,
        )

        # Points that are refused change nothing.
        for frame, point, message in (
            ("map", (3.0, 5.3), "refused: the point (3.000, 5.300) needs a steering angle"),
            ("odom", (9.0, 9.0), "point is in the frame 'odom'; expected 'map'"),
            ("map", (float("nan"), 9.0), "is not finite"),
        ):
            click(point, frame)
            wait_for(lambda message=message: message in process.output, message)
        self.assertIn("the nearest that the car has is", process.output)
        self.assertTrue(self.call("undo").success)
        wait_for_path(clicks[1], 2)

        first = os.path.join(self.folder, "clicked.txt")
        with open(first) as file:
            before = file.read()
        path = self.save("clicked_2.txt")
        with open(first) as file:
            self.assertEqual(file.read(), before)
        self.assertEqual(len(read(first)[1]), 3)
        self.assertEqual([row[0] for row in read(path)[1]], [4.0, -4.0])
        self.assert_at(self.drive(path), clicks[1])
        # Driving the plan has placed the car where it starts, and that does not end it.
        click(clicks[2])
        wait_for_path(clicks[2], 3)
        self.assertTrue(self.call("clear").success)
        wait_for(lambda: len(paths.last.poses) == 1, "the path to be its start")
        self.assertFalse(self.call("save").success)
        self.assertEqual(sorted(os.listdir(self.folder)), ["clicked.txt", "clicked_2.txt"])
        # Placing it elsewhere does.
        click(clicks[0])
        wait_for_path(clicks[0], 1)
        self.assertNotIn("were not saved", process.output)
        starts.publish(pose_msg(1.0, 2.5, 0.5))
        wait_for(lambda: "the clicks before were not saved" in process.output, "the warning")
        click(clicks[0])
        wait_for(lambda: len(paths.last.poses) > 1, "the path of a click")
        self.save("clicked_3.txt")
        starts.publish(pose_msg(1.0, 3.0, 0.5))
        wait_for(lambda: len(paths.last.poses) == 1, "the path to begin anew")
        wait_for(lambda: "a new plan starts at (1.0000 m, 3.0" in process.output, "that said")
        self.assertEqual(process.output.count("were not saved"), 1)

    def hand_drive(self):
        """Place the car and send the commands of DRIVE; return where it ends."""
        placed = pose_msg(-3.0, 2.0, 1.0)
        self.placements.publish(placed)
        self.poses.shows((-3.0, 2.0, 1.0), placed.header.stamp)
        begin = rospy.Time.now() + LEAD
        for seconds, speed, angle in DRIVE:
            msg = AckermannDriveStamped()
            msg.header.stamp = begin + rospy.Duration.from_sec(seconds)
            msg.drive.speed, msg.drive.steering_angle = speed, angle
            self.commands.publish(msg)
        return self.poses.pose_at_rest(begin + rospy.Duration.from_sec(DRIVE[-1][0] + 0.2))

    def test_drives(self):
        process = self.start("plan_recorder.py")
        self.placements = publisher("/initialpose", PoseWithCovarianceStamped)
        self.commands = publisher("/car/mux/ackermann_cmd_mux/input/teleop", AckermannDriveStamped)
        wait_for(lambda: self.placements.get_num_connections() >= 2, "the recorder to listen")
        wait_for_recorder("/plan_recorder")
        self.assertEqual(self.call("save").message, "nothing saved: the car has not been driven")

        end = self.hand_drive()
        expected = closed_form((-3.0, 2.0, 1.0), ROWS)
        self.assert_at(end, expected, REPLAY_TOLERANCE)
        path = self.save("recorded.txt")
        start, rows = read(path)
        self.assert_at(start, (-3.0, 2.0), REPLAY_TOLERANCE)
        self.assertEqual([row[:2] for row in rows], [row[:2] for row in ROWS])
        for row, wanted in zip(rows, ROWS):
            self.assertAlmostEqual(row[2], wanted[2], places=8)
        replayed = self.drive(path)
        self.assert_at(replayed, end, REPLAY_TOLERANCE)
        self.assertLess(abs(math.remainder(replayed[2] - end[2], math.tau)), REPLAY_TOLERANCE)

        # The replay has been recorded too, as it began with a placement; it is the same plan.
        again = self.save("recorded_2.txt")
        self.assertEqual(len(read(again)[1]), len(rows))
        for row, wanted in zip(read(again)[1], rows):
            self.assertEqual(row, wanted)
        self.assertTrue(self.call("clear").success)
        self.assertFalse(self.call("save").success)

        # What has not been saved is written at the end.
        self.hand_drive()
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(), 0, process.output)
        self.assertIn("recorded_3.txt; the plan has 4 rows, 0.850 s", process.output)
        self.assertNotIn("WARN", process.output)
        self.assertEqual(read(os.path.join(self.folder, "recorded_3.txt"))[1], rows)

    def test_where_nothing_can_be_written(self):
        """/proc is a folder in which nobody can write, not even root."""
        arguments = ("_folder:=/proc", "_init_pose_topic:=/elsewhere")
        planner = node("click_planner.py", "__name:=locked_planner", *arguments)
        recorder = node("plan_recorder.py", "__name:=locked_recorder", "_folder:=/proc")
        for process in (planner, recorder):
            self.addCleanup(process.end)
        for name in ("locked_planner", "locked_recorder"):
            rospy.wait_for_service(f"{name}/save", 30.0)
        self.placements = publisher("/initialpose", PoseWithCovarianceStamped)
        self.commands = publisher("/car/mux/ackermann_cmd_mux/input/teleop", AckermannDriveStamped)
        points = publisher("/clicked_point", PointStamped)
        wait_for(lambda: self.placements.get_num_connections() >= 2, "the recorder to listen")
        wait_for_recorder("/locked_recorder")
        self.hand_drive()
        publisher("/elsewhere", PoseWithCovarianceStamped).publish(pose_msg(-3.0, 2.0, 1.0))
        wait_for(lambda: "a new plan starts" in planner.output, "the start of the plan")
        msg = PointStamped()
        msg.point.x, msg.point.y = -3.0, 4.0
        points.publish(msg)
        wait_for(lambda: "click 1" in planner.output, "the click")
        for name, file in (("locked_planner", "clicked"), ("locked_recorder", "recorded")):
            answer = self.call("save", name)
            self.assertFalse(answer.success)
            self.assertIn(f"nothing saved: /proc/{file}.txt cannot be written (", answer.message)
        recorder.send_signal(signal.SIGINT)
        self.assertEqual(recorder.wait(), 1, recorder.output)
        self.assertIn("the drive is not saved: /proc/recorded.txt cannot be", recorder.output)

    def test_parameters(self):
        cases = (
            ("click_planner.py", "_speed:=0", "parameter ~speed is 0; expected a number from"),
            ("click_planner.py", "_max_steering_angle:=2", "parameter ~max_steering_angle is 2"),
            ("click_planner.py", "_name:=a/b", "parameter ~name is 'a/b'; expected a file's"),
            ("plan_recorder.py", "_folder:=7", "parameter ~folder is 7; expected text"),
            (
                "plan_recorder.py",
                "_folder:=/nowhere",
                "expected a folder; there is none at /nowhere",
            ),
        )
        started = [
            (node(name, f"__name:=wrong_{number}", argument), message)
            for number, (name, argument, message) in enumerate(cases)
        ]
        for process, message in started:
            with process:
                self.assertEqual(process.wait(), 1, process.output)
                self.assertIn(message, process.output)
                self.assertNotIn("Traceback", process.output)


if __name__ == "__main__":
    rospy.init_node("recording_test")
    rostest.rosrun("mushr_ros_intro", "recording", TestRecording)
