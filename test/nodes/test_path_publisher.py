"""Check how path_publisher and drive_monitor start, end, are interrupted, and refuse bad input."""

import contextlib
import math
import os
import re
import signal

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_srvs.srv import Trigger

from mushr_ros_intro.drive.start_pose import StartPose
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros.connections import wait_for_subscriber
from support.geometry import closed_form, planar
from support.ghost import Ghost
from support.helpers import (
    ForkedProcess,
    Recording,
    RosTestCase,
    driver,
    kill,
    monitor,
    node,
    wait_for,
)
from support.messages import COMMAND_TIMEOUT, MUX, NAVIGATION, is_stop
from support.paths import FIXTURES
from support.world import LOCK_STEP, launch

nodes = []


def start_world():
    nodes.extend(launch("sim.launch", map="none", laser=False, model=False, **LOCK_STEP))
    return nodes


class TestPathPublisher(RosTestCase):
    def setUp(self):
        super().setUp()
        self.sent, self.is_held = 0, False
        self.commands = Recording(NAVIGATION, AckermannDriveStamped)
        self.placements = Recording("/initialpose", PoseWithCovarianceStamped)
        self.poses = Recording("/car/car_pose", PoseStamped).connected()

    def control(self, service):
        """Hold, step or release the clock."""
        self.assertTrue(rospy.ServiceProxy(f"/car/car_sim/{service}", Trigger)().success)

    @contextlib.contextmanager
    def driving(self, path, car="car"):
        """Yield a node and its monitor while the clock is held, after five commands or some more.

        The clock is released at the stop of an interrupted drive. Another car shares the mux.

        Args:
            path: of the plan.
            car: the name of the car.
        """
        held = Recording(NAVIGATION, AckermannDriveStamped, self.on_command)
        self.addCleanup(self.control, "resume")
        self.addCleanup(held.end)
        name, own = f"_car_name:={car}", MUX.replace("/car/", f"/{car}/")
        shared = [f"{own}/{each}:={MUX}/{each}" for each in ("output", "active")]
        watching = monitor(path, name, *(shared if car != "car" else []))
        process = driver(path, name, f"_control_topic:={NAVIGATION}")
        with watching, process:
            wait_for(lambda: self.is_held, "five commands")
            yield process, watching

    def on_command(self, message):
        self.sent += 1
        if self.sent == 5:
            self.control("pause")
            self.is_held = True
        elif self.is_held and is_stop(message):
            # A stop that is not ahead of the clock lets it go on, so the car reports its rest.
            self.control("resume")

    def assert_rests_at(self, expected):
        last = self.commands.last.header.stamp
        self.assert_pose(self.poses.pose_at_rest(last + rospy.Duration(COMMAND_TIMEOUT)), expected)

    def test_interrupted(self):
        """After Ctrl-C the last message is a stop; the monitor prints where the car stopped.

        The node prints the parameters that its command line does not set.
        """
        rospy.set_param("/path_publisher/loop", False)  # as if from an earlier drive
        path = self.plan("0,0,0\n1.0,0.2,60\n")
        with self.driving(path) as (process, watching):
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(), 1)
            self.assertEqual(watching.wait(), 1)
        left = "of rosparam: loop: False; to delete them, type: rosparam delete /path_publisher\n"
        self.assertIn(left, process.output)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
        first, *_, last = self.commands.messages
        seconds = (last.header.stamp - first.header.stamp).to_sec()
        end = closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)])
        self.assert_rests_at(end)
        ended = r"/path_publisher ended in line 2 of 2; the car stopped at \((.*)\)"
        printed = re.search(ended, watching.output)
        pose = [float(each.split()[0]) for each in printed[1].split(", ")]
        self.assert_pose(pose, end, 1e-4)

    def test_loop(self):
        """Each lap is a drive of its own, placed after the end of the last one.

        A file in the user's directory comes before the plan of the package, also for the monitor.
        """
        rospy.set_param("/path_publisher/send_init_pose", False)  # as if from an earlier drive
        path = self.plan("1,2,0.5\n1.0,0.2,0.25\n-1.0,0.1,0.3\n", "figure_8.txt")
        command = ("roslaunch", "mushr_ros_intro", "path_publisher.launch")
        options = ("plan_file:=figure_8", "loop:=true")
        with ForkedProcess(*command, *options, PWD=self.folder) as process:
            wait_for(lambda: len(self.placements.messages) >= 4, "four laps")
            (watching,) = (each for each in nodes if "drive_monitor" in each.command)
            wait_for(lambda: watching.output.count("the car drove 0.55 m") > 1, "two results")
            process.send_signal(signal.SIGINT)
            process.wait()
        self.assertIn(f"/path_publisher: {path}, 2 rows, 0.55 s, 0.55 m", watching.output)
        self.assertNotIn("earlier run", process.output)  # roslaunch has set the parameters
        commands = [m.header.stamp.to_nsec() for m in self.commands.messages]
        lap = [0, 100, 200, 250, 350, 450, 550]  # [ms], the last one is the stop
        placements = [m.header.stamp.to_nsec() for m in self.placements.messages]
        for number, placed in enumerate(placements[:3]):
            begin, *_ = stamps = commands[number * len(lap) : (number + 1) * len(lap)]
            self.assertEqual(stamps, [begin + due * 10**6 for due in lap])
            self.assertGreaterEqual(begin, placed + 10**8)
            self.assertGreater(placements[number + 1], stamps[-1])
            self.assertEqual(self.commands.messages[(number + 1) * len(lap) - 1].drive.speed, 0.0)

    def test_the_car_dies(self):
        """The monitor warns, and ends with exit status 1."""
        path = self.plan("0,0,0\n1.0,0.2,20\n")
        car = node("car_sim.py", "__ns:=/second")
        self.addCleanup(car.end)
        with self.driving(path, "second") as (process, watching):
            kill("/second/car_sim", car.pid)
            warning = "the car no longer reports its pose on /second/car_pose"
            wait_for(lambda: warning in watching.output, "a warning")
            self.control("resume")
            self.assertEqual(process.wait(), 0)
            self.assertEqual(watching.wait(), 1)
        # On a busy machine, the monitor does not know the plan yet.
        since = r"(line 2 of 2|\d\.\d s after the first command)"
        self.assertRegex(watching.output, f"has not reported its pose since {since}, so it is not")
        self.assertNotIn("has been driven", watching.output)

    def test_tutorial_listing(self):
        """Only the bends of the path are checked, because the durations of its rows are not exact.

        Its start pose can reach the car after its commands: ROS does not order two topics.
        """
        angles = (0.09, -0.15)
        path = self.plan("0,0,0.0\n2.0,0.09\n3.0,-0.15")
        self.poses.clear()
        # Of this test, and of the mux or the car.
        with node("listing.py", f"_plan_file:={path}", "_connections:=2") as listing:
            self.assertEqual(listing.wait(), 0)
        self.assertEqual({msg.drive.speed for msg in self.commands.messages}, {2.0, 3.0})
        self.poses.pose_at_rest(rospy.Time.now() + rospy.Duration(COMMAND_TIMEOUT))
        poses = [planar(each.pose) for each in self.poses.messages]
        steps = [
            (math.dist(one[:2], two[:2]), two[2] - one[2]) for one, two in zip(poses, poses[1:])
        ]
        bends = [turn / length for length, turn in steps if 0.01 < length < 0.1]
        expected = [closed_form((0.0, 0.0, 0.0), [(1.0, angle, 1.0)])[2] for angle in angles]
        for bend, limit in zip(expected, (max(bends), min(bends))):
            self.assertAlmostEqual(bend, limit, 4)
        self.assertLess(bends.index(max(bends)), bends.index(min(bends)))

    def test_refuses_and_publishes_nothing(self):
        """Each fault is one message and exit status 1, and no command is published."""
        broken = os.path.join(FIXTURES, "broken_plans", "not_a_number.txt")
        cases = {
            f"{broken}:": [f"_plan_file:={broken}"],
            # Also if the value of an earlier run is wrong.
            "~plan is not known": ["_plan_file:=figure_9", "_plan:=figure_8"],
            "parameter ~loop is 'maybe'": ["_loop:=maybe"],
            "'send_init_pose:=false' sets no parameter": ["send_init_pose:=false"],  # not set yet
        }
        self.assert_refused(
            *(
                ("path_publisher.py", ["_plan_file:=circle", *each], said)
                for said, each in cases.items()
            )
        )
        self.assertEqual(self.commands.messages, [])

    def test_waits_and_publishes_nothing(self):
        """Each wait is reached, lasts until Ctrl-C, and repeats calls that get no answer."""
        ghost = self.ending(Ghost(publishes=["/ghost/car_pose"]))
        wrong = self.ending(Recording("/wrong_initialpose", PoseWithCovarianceStamped))
        control_topic = f"_control_topic:={NAVIGATION}"
        path = self.plan("90,0,0\n1.0,0,1\n")  # no other test places the car there
        cases = (
            (["_car_name:=ghost", control_topic], lambda: len(ghost.calls["requestTopic"]) > 1),
            (["_init_pose_topic:=/wrong_initialpose"], lambda: wrong.last),
        )
        started = [
            self.ending(driver(path, f"__name:=waiting_{number}", *arguments))
            for number, (arguments, _) in enumerate(cases)
        ]
        for arguments, is_waiting in cases:
            wait_for(is_waiting, f"the wait with {arguments}")
        for process in started:
            process.send_signal(signal.SIGINT)
        for process in started:
            self.assertEqual(process.wait(), 1, process.output)
        self.assertEqual(self.placements.messages, [])
        self.assertEqual(self.commands.messages, [])

    def test_timeouts(self):
        """In this process: in a node, an earlier wait could have the same timeout."""
        nowhere = rospy.Publisher("/nowhere", AckermannDriveStamped, queue_size=1)
        self.addCleanup(nowhere.unregister)
        with self.assertRaisesRegex(UserError, "no node subscribes to /nowhere after 0 s"):
            wait_for_subscriber(nowhere, 0.0)
        other = rospy.Publisher(
            NAVIGATION.replace("/car/", "/car9/"), AckermannDriveStamped, queue_size=1
        )
        self.addCleanup(other.unregister)
        with self.assertRaisesRegex(UserError, "mushr_ros_intro sim.launch car_name:=car9\\)"):
            wait_for_subscriber(other, 0.0)
        self.ending(Ghost(subscribes=["/told_late"], publishes=["/ghost/car_pose"]))
        told_late = rospy.Publisher("/told_late", AckermannDriveStamped, queue_size=1)
        self.addCleanup(told_late.unregister)
        with self.assertRaisesRegex(UserError, "nodes are registered: /ghost. Do they respond"):
            wait_for_subscriber(told_late, 0.0)
        for car in ("car", "ghost"):
            with self.assertRaisesRegex(UserError, r"was not at the start pose \(90.0000 m"):
                StartPose(car, Pose(90.0, 0.0, 0.0)).wait_until_reported(0, 0.0, is_last=True)
