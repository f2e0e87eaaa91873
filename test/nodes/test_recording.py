"""Make plans by clicking and by driving, save them, and drive them."""

import itertools
import math
import os
import re
import signal

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from std_srvs.srv import Trigger

from mushr_ros_intro.plan.parse import parse_plan
from support.geometry import POSITION_TOLERANCE, closed_form, float32, planar
from support.helpers import (
    Process,
    Recording,
    RosTestCase,
    node,
    publisher,
    wait_for,
    wait_for_receiver,
)
from support.messages import LEAD, MUX, OUTPUT, TELEOP, at, command, placement
from support.world import launch

CLICK_TOLERANCE = 1e-3
"""[m] Between a click and the car's final position: commands are rounded to float32."""

START = (-3.0, 2.0, 1.0)

DRIVE = [
    (0.0, 1.0, 0.2),
    (0.1, 1.0, 0.2),
    (0.17, 1.5, -0.3),  # expires after 0.2 s; then the car stops
    (0.55, -0.8, 0.1),
    (0.65, -0.8, 0.1),
]
"""[s, m/s, rad] Commands, with their times."""

ROWS = [(1.0, 0.2, 0.17), (1.5, -0.3, 0.2), (0.0, -0.3, 0.18), (-0.8, 0.1, 0.3)]
"""[m/s, rad, s] The rows to be recorded."""


def read(path):
    """Return the start pose of a plan file, and (speed, steering angle, seconds) of each row."""
    with open(path, "rb") as file:
        plan = parse_plan(file.read(), path)
    return plan.start, [(*row[:2], row.duration / 1e9) for row in plan.rows]


SUMMARY = "the plan has 4 rows, 0.710 m, 0.850 s"
"""The summary of ROWS."""

NUMBERS = itertools.count()
"""For the names of nodes: each name is new."""

EMPTY = (
    "nothing saved: this recording has no drive: there was no command to drive after the first "
    "pose on /car/car_pose"
)


def start_world():
    return launch("sim.launch", laser=False, model=False, watched=False)


class TestRecording(RosTestCase):
    def setUp(self):
        super().setUp()
        self.poses = Recording("/car/car_pose", PoseStamped).connected()

    def start(self, name, folder=None, *arguments):
        """Start a node that writes into a folder, and wait for it."""
        self.name = f"/{name[:-3]}_{next(NUMBERS)}"
        arguments = (f"__name:={self.name[1:]}", *arguments)
        process = self.ending(node(name, f"_folder:={folder or self.folder}", *arguments))
        self.initial_poses = publisher("/initialpose", PoseWithCovarianceStamped)
        rospy.wait_for_service(f"{self.name}/save", 30.0)
        wait_for_receiver(self.name, rospy.get_name(), "/initialpose")
        return process

    def start_planner(self, folder=None):
        planner = self.start("click_planner.py", folder, "_speed:=4.0")
        self.points = publisher("/clicked_point", PointStamped)
        return planner

    def start_recorder(self, folder=None):
        recorder = self.start("plan_recorder.py", folder)
        self.commands = publisher(TELEOP, AckermannDriveStamped)
        wait_for_receiver(self.name, MUX, OUTPUT)
        wait_for_receiver(self.name, "/car/car_sim", "/car/car_pose")
        return recorder

    def interrupt(self, recorder, status, last):
        """Send SIGINT to a recorder; check its exit status and the end of its output."""
        recorder.send_signal(signal.SIGINT)
        self.assertEqual(recorder.wait(), status)
        self.assertTrue(recorder.output.endswith(f"{last}\n"))

    def call(self, service):
        """Call a service of the node; return whether it succeeds, and its message."""
        answer = rospy.ServiceProxy(f"{self.name}/{service}", Trigger)()
        return answer.success, answer.message

    def test_a_drive_is_recorded_into_a_bag_and_compared(self):
        path = os.path.join(self.folder, "drive.bag")
        plan = self.plan("0, 0, 0\n1.0, 0.1, 0.5\n1.0, -0.1, 0.5")
        topics = ("/car/mux/ackermann_cmd_mux/output", "/car/car_pose")
        recorder = self.ending(Process("rosbag", "record", "-O", path, *topics))
        wait_for(lambda: os.path.exists(f"{path}.active"), "the recording")
        self.drive_plan(plan)
        recorder.send_signal(signal.SIGINT)
        recorder.wait()
        output = node("compare_drive.py", path)
        self.assertEqual(output.wait(), 0, output.output)
        # A pose that was reported before a late command arrived is not corrected.
        final = re.search(r"final error +(\S+) m", output.output)
        self.assertLess(float(final[1]), 0.05, output.output)

    def save(self, name):
        """Save the plan; check that the file has this name, and return its path."""
        path = os.path.join(os.path.realpath(self.folder), name)
        is_saved, message = self.call("save")
        self.assertTrue(is_saved, message)
        self.assertIn(f"saved {path}; the plan has ", message)
        return path

    def drive(self, path):
        """Drive a plan file; return the pose at which the car stops."""
        self.drive_plan(path)
        return self.poses.pose_at_rest(rospy.Time.now())

    def click(self, x, y, frame="map"):
        msg = PointStamped()
        msg.header.frame_id, msg.point.x, msg.point.y = frame, x, y
        self.points.publish(msg)

    def hand_drive(self, start):
        """Place the car and send the commands of DRIVE; return the pose at which it stops."""
        placed = placement(rospy.Time.now(), *start)
        self.initial_poses.publish(placed)
        self.poses.shows(start, placed.header.stamp)
        begin = rospy.Time.now() + LEAD
        for seconds, speed, angle in DRIVE:
            self.commands.publish(command(at(begin, seconds), speed, angle))
        return self.poses.pose_at_rest(at(begin, DRIVE[-1][0] + 0.2))

    def test_a_start_pose_in_a_wall(self):
        """The car rejects it, so the plan begins at the car."""
        self.start_planner()
        paths = Recording(f"{self.name}/path", Path).connected()

        def begins_at(x, y, rows):
            poses = paths.last.poses if paths.last else []
            is_there = poses and math.dist(planar(poses[0].pose)[:2], (x, y)) < CLICK_TOLERANCE
            return is_there and (len(poses) > 1) == (rows > 0)

        for x in (3.0, 49.6):
            placed = placement(rospy.Time.now(), x, 1.0, 0.0)
            self.initial_poses.publish(placed)
            wait_for(lambda x=x: begins_at(x, 1.0, 0), f"a plan that begins at {x}")
        self.poses.shows((3.0, 1.0, 0.0), placed.header.stamp + rospy.Duration(1.0))
        self.click(4.0, 1.0)
        wait_for(lambda: begins_at(3.0, 1.0, 1), "a plan that begins at the car")

    def test_clicks(self):
        planner = self.start_planner()
        paths = Recording(f"{self.name}/path", Path).connected()

        def wait_for_path(end, rows):
            def is_there():
                poses = paths.last and paths.last.poses
                return poses and math.dist(planar(poses[-1].pose)[:2], end) < CLICK_TOLERANCE

            wait_for(is_there, f"a path that ends in {end}")
            self.assertEqual(paths.last.header.frame_id, "map")
            self.assertEqual(len(paths.last.poses) == 1, rows == 0)
            wait_for(lambda: rows == 0 or f"has {rows} row" in planner.output, f"{rows} rows")

        def place(x, y, theta):
            placed = placement(rospy.Time.now(), x, y, theta)
            self.initial_poses.publish(placed)
            wait_for_path((x, y), 0)
            # The planner, too, has to get a report of this pose.
            self.poses.shows((x, y, theta), placed.header.stamp + rospy.Duration(0.5))

        wait_for(lambda: paths.last is not None and not paths.last.poses, "an empty path")
        place(1.0, 2.0, 0.5)
        self.assertEqual(self.call("undo"), (False, "there is no click to undo"))
        self.assertEqual(self.call("save"), (False, "nothing saved: there is no click yet"))

        clicks = [(3.0, 3.5), (1.5, 3.0), (3.0, 5.5)]  # the second one is behind the car
        for count, point in enumerate(clicks, 1):
            self.click(*point)
            wait_for_path(point, count)
        self.assertIn("click 2: ", planner.output)
        self.assertEqual(planner.output.count("in reverse"), 1)
        first = self.save("clicked.txt")
        content = read(first)
        self.assertEqual(len(content[1]), 3)

        # Refused points change nothing.
        for x, y, frame, message in (
            (3.0, 5.3, "map", "refused: the point (3.000, 5.300) needs a steering angle"),
            (9.0, 9.0, "odom", "point is in the frame 'odom'; expected 'map'"),
            (math.nan, 9.0, "map", "is not finite"),
        ):
            self.click(x, y, frame)
            wait_for(lambda message=message: message in planner.output, message)
        self.assertTrue(self.call("undo")[0])
        wait_for_path(clicks[1], 2)

        path = self.save("clicked_2.txt")
        self.assertEqual(read(first), content)
        self.assertEqual([row[0] for row in read(path)[1]], [4.0, -4.0])
        end = self.drive(path)
        self.assertLess(math.dist(end[:2], clicks[1]), CLICK_TOLERANCE)
        # This drive published the start pose of the plan. Only another pose starts a new plan.
        self.click(*clicks[2])
        wait_for_path(clicks[2], 3)
        self.assertTrue(self.call("clear")[0])
        wait_for_path((1.0, 2.0), 0)
        ahead = [(end[0] + d * math.cos(end[2]), end[1] + d * math.sin(end[2])) for d in (1, 2)]
        self.click(*ahead[0])
        wait_for_path(ahead[0], 1)
        start, _ = read(self.save("clicked_3.txt"))
        self.assert_pose(start, end)  # of the car, not the start pose of the plan before
        self.click(*ahead[1])
        wait_for_path(ahead[1], 2)
        self.assertNotIn("not saved", planner.output)
        place(1.0, 2.5, 0.5)
        wait_for(lambda: "the clicks before it were not saved" in planner.output, "a warning")
        self.click(*clicks[0])
        wait_for_path(clicks[0], 1)
        self.save("clicked_4.txt")
        place(1.0, 2.75, 0.5)
        place(1.0, 3.0, 0.5)
        self.click(*clicks[2])
        wait_for(lambda: "a new plan starts at (1.0000 m, 3.0" in planner.output, "a message")
        self.assertNotIn("a new plan starts at (1.0000 m, 2.75", planner.output)
        self.assertEqual(planner.output.count("not saved"), 1)

    def test_drives(self):
        recorder = self.start_recorder()
        self.assertEqual(self.call("save"), (False, EMPTY))

        end = self.hand_drive(START)
        self.assert_pose(end, closed_form(START, ROWS))
        path = self.save("recorded.txt")
        start, rows = read(path)
        self.assert_pose(start, START)
        self.assertEqual([row[:2] for row in rows], [tuple(map(float32, row[:2])) for row in ROWS])
        for row, wanted in zip(rows, ROWS):
            self.assertAlmostEqual(row[2], wanted[2], delta=POSITION_TOLERANCE)
        # The drive of this plan is recorded, too. Its recording is the same plan.
        self.assert_pose(self.drive(path), end)
        self.assertEqual(read(self.save("recorded_2.txt"))[1], rows)
        self.assertTrue(self.call("clear")[0])
        self.assertEqual(self.call("save"), (False, EMPTY))
        self.assertNotIn("WARN", recorder.output)

        # An initial pose discards an unsaved drive; a shutdown saves it.
        self.hand_drive((1.0, 1.0, 0.0))
        self.hand_drive((0.0, 0.0, 0.0))
        self.assertEqual(recorder.output.count("the drive was not saved"), 1)
        self.interrupt(recorder, 0, f"saved {path[:-4]}_3.txt; {SUMMARY}")
        self.assertEqual(read(os.path.join(self.folder, "recorded_3.txt"))[1], rows)
        self.assertEqual(recorder.output.count("WARN"), 1)

    def test_ctrl_c_without_a_new_drive(self):
        recorder = self.start_recorder()
        self.interrupt(recorder, 0, EMPTY)
        recorder = self.start_recorder()
        self.hand_drive(START)
        path = self.save("recorded.txt")
        self.interrupt(recorder, 0, f"nothing new to save; saved before: {path}; {SUMMARY}")
        self.assertEqual(os.listdir(self.folder), ["recorded.txt"])

    def test_a_folder_that_cannot_be_written(self):
        """Not even root can write to /proc."""
        recorder = self.start_recorder("/proc")
        self.hand_drive(START)
        self.assertIn("nothing saved: /proc/recorded.txt cannot be written (", self.call("save")[1])
        recorder.send_signal(signal.SIGINT)
        self.assertEqual(recorder.wait(), 1, recorder.output)
        self.assertIn("nothing saved: /proc/recorded.txt cannot be", recorder.output)
