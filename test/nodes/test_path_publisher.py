"""Check how path_publisher starts, ends, is interrupted, and refuses bad input."""

import contextlib
import math
import os
import re
import shlex
import signal

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_srvs.srv import Trigger

from mushr_ros_intro.drive.car_pose import CarPose
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros.connections import wait_for_subscriber
from support.geometry import closed_form, planar
from support.ghost import Ghost
from support.helpers import (
    ForkedProcess,
    Recording,
    Relay,
    RosTestCase,
    driver,
    kill,
    node,
    publisher,
    wait_for,
)
from support.messages import COMMAND_TIMEOUT, NAVIGATION, OUTPUT, at, command, is_stop
from support.paths import FIXTURES
from support.world import LOCK_STEP, launch, load

RELAYED = "/relayed/input/navigation"


def start_world():
    return launch("sim.launch", map="none", laser=False, model=False, **LOCK_STEP)


class TestPathPublisher(RosTestCase):
    relays, sent = [], []

    def setUp(self):
        super().setUp()
        self.commands = Recording(NAVIGATION, AckermannDriveStamped)
        self.placements = Recording("/initialpose", PoseWithCovarianceStamped)
        self.poses = Recording("/car/car_pose", PoseStamped).connected()

    def control(self, service):
        """Hold, step or release the clock."""
        self.assertTrue(rospy.ServiceProxy(f"/car/car_sim/{service}", Trigger)().success)

    @contextlib.contextmanager
    def driving(self, path, *arguments):
        """Yield a node, after five commands. It drives on when the clock is released."""
        # The relay stays: rospy of Debian 11 may not connect a publisher that comes a second time.
        if not self.relays:
            self.relays.append(Relay(RELAYED, NAVIGATION, AckermannDriveStamped, self.on_command))
        self.sent.clear()
        self.addCleanup(self.control, "resume")
        with driver(path, f"_control_topic:={RELAYED}", *arguments) as process:
            wait_for(lambda: len(self.commands.messages) >= 5, "five commands")
            yield process

    def on_command(self, message):
        """Hold the clock at the fifth command. Release it at the stop of an interrupted drive."""
        self.sent.append(message)
        if len(self.sent) == 5:
            self.control("pause")
        elif len(self.sent) == 6 and is_stop(message):
            # A stop that is not ahead of the clock lets it go on, so the car reports its rest.
            self.control("resume")
            stamp = message.header.stamp
            self.poses.first(lambda pose: pose.header.stamp >= stamp, "the pose before the stop")

    def assert_rests_at(self, expected):
        last = self.commands.last.header.stamp
        self.assert_pose(self.poses.pose_at_rest(last + rospy.Duration(COMMAND_TIMEOUT)), expected)

    def test_interrupted(self):
        """After Ctrl-C the last message is a stop; the node prints where the car stopped."""
        path = self.plan("0,0,0\n1.0,0.2,60\n")
        with self.driving(path) as process:
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(), 1)
        wait_for(lambda: self.commands.last.drive.speed == 0.0, "the stop")
        first, *_, last = self.commands.messages
        seconds = (last.header.stamp - first.header.stamp).to_sec()
        end = closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)])
        self.assert_rests_at(end)
        stopped = r"stopped in line 2 of 2 at \((.*) m, (.*) m, (.*) rad\)"
        if printed := re.search(stopped, process.output):
            self.assert_pose(tuple(map(float, printed.groups())), end, 1e-4)
        else:  # the car has not reported its rest for 1 s, see test_drive_monitor.py
            self.assertIn("the drive ended in line 2 of 2; the last reported", process.output)

    def test_loop(self):
        """Each lap is a drive of its own, placed after the end of the last one."""
        path = self.plan("1,2,0.5\n1.0,0.2,0.25\n-1.0,0.1,0.3\n")
        options = (f"plan_file:={path}", "loop:=true")
        with ForkedProcess(
            "roslaunch", "mushr_ros_intro", "path_publisher.launch", *options
        ) as process:
            wait_for(lambda: len(self.placements.messages) >= 4, "four laps")
            line = r"lap (?!1,)\d+, line 3 of 3: -1 m/s, 0.1 rad; 0.30 s left"  # not in each lap
            wait_for(lambda: re.search(line, process.output), "the line of the third row")
            process.send_signal(signal.SIGINT)
            process.wait()
        self.assertIn("plan.txt: 2 rows, 0.55 s, 0.55 m", process.output)
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

    def test_another_node_drives_the_car(self):
        """The message contains the name of the other publisher, even if it has ended."""
        path = self.plan("0,0,0\n1.0,0.2,4\n")
        with self.driving(path) as process:
            other = publisher(RELAYED, AckermannDriveStamped)
            passed = self.ending(Recording(OUTPUT, AckermannDriveStamped).connected())
            name = rospy.get_name()
            wait_for(lambda: f"{name} also publishes on" in process.output, "a warning")
            # Half a period after those of the node, which does not replace them immediately.
            begin = self.commands.last.header.stamp
            for number in range(10):
                other.publish(command(at(begin, 0.1 * number + 0.05), -1.0, 0.0))
            wait_for(lambda: passed.last and passed.last.drive.speed == -1.0, "its commands")
            other.unregister()
            self.control("resume")
            self.assertEqual(process.wait(), 1)
        self.assertIn(f"{name} also published on {RELAYED}", process.output)
        self.assertIn("after the plan, the car was at (", process.output)
        self.assertNotIn("has been driven", process.output)

    def test_parameters_of_an_earlier_run(self):
        """The node prints those that its command line does not set."""
        rospy.set_param("/path_publisher/loop", False)
        output = self.drive_plan(self.plan("0,0,0\n1.0,0.2,0.1\n"))
        left = "of rosparam: loop: False; to delete them, type: rosparam delete /path_publisher\n"
        self.assertIn(left, output)

    def test_wrong_parameters_do_not_end_the_node_that_drives(self):
        path = self.plan("0,0,0\n1.0,0.2,60\n")
        master = rosgraph.Master("/test")
        with self.driving(path):
            address = master.lookupNode("/path_publisher")
            wrong = (f"_plan_file:={path}", "_loop:=maybe"), ("_plan_file:=figure_9",)
            for arguments in wrong:
                with node("path_publisher.py", *arguments) as second:
                    self.assertEqual(second.wait(), 1)
            self.assertEqual(master.lookupNode("/path_publisher"), address)

    def test_the_car_dies(self):
        """The node warns, and ends with exit status 1."""
        path = self.plan("0,0,0\n1.0,0.2,2\n")
        car = node("car_sim.py", "__ns:=/second")
        self.addCleanup(car.end)
        with self.driving(path, "_loop:=false", "_car_name:=second") as process:
            kill("/second/car_sim", car.pid)
            warning = "the car no longer reports its pose on /second/car_pose"
            wait_for(lambda: warning in process.output, "a warning")
            self.control("resume")
            self.assertEqual(process.wait(), 1)
        self.assertIn("/second/car_pose since line 2 of 2, so it is not known", process.output)
        self.assertNotIn("has been driven", process.output)

    def test_the_car_is_restarted(self):
        """The node warns twice and drives on; the new car ends at another pose."""
        arguments = ("__ns:=/third", f"mux/ackermann_cmd_mux/output:={OUTPUT}")
        car = self.ending(node("car_sim.py", *arguments))
        path = self.plan("0,0,0\n1.0,0.2,4\n")
        with self.driving(path, "_car_name:=third", "_car:=ideal") as process:
            kill("/third/car_sim", car.pid)
            lost = "the car no longer reports its pose on /third/car_pose"
            wait_for(lambda: lost in process.output, "a warning")
            # The reports of another car replace a start; test_faults_nodes restarts the car.
            reported = []
            relay = Relay("/car/car_pose", "/third/car_pose", PoseStamped, reported.append)
            self.ending(relay)
            wait_for(lambda: self.control("step") or reported, "a report")
            wait_for(lambda: "the car has been restarted" in process.output, "another warning")
            self.control("resume")
            self.assertEqual(process.wait(), 1)
        self.assertEqual(self.commands.last.drive.speed, 0.0)
        self.assertEqual(len(self.commands.messages), 41)
        self.assertIn("the car did not report its pose, or it was restarted", process.output)

    def test_the_parameters_of_a_car_that_has_ended(self):
        """They do not count: the plan is not checked against their limits."""
        rospy.set_param("/ended/car_sim/speed_limit", 0.01)
        self.addCleanup(rospy.delete_param, "/ended")
        path = self.plan("0,0,0\n0.02,0,0.1\n")
        arguments = ("_car_name:=ended", "_send_init_pose:=false", f"_control_topic:={NAVIGATION}")
        self.assertNotIn("at most", self.drive_plan(path, *arguments))

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

    def test_the_name_of_a_file_in_the_users_directory(self):
        """It comes before the plan of the package; the first line of the node shows its path."""
        rospy.set_param("/path_publisher/send_init_pose", False)  # as if from an earlier drive
        # The car is slow, so a late message does not change the printed digits.
        path = self.plan("3,4,1\n0.02,0.1,1\n", "figure_8.txt")
        launch = ("roslaunch", "mushr_ros_intro", "path_publisher.launch", "plan_file:=figure_8")
        with ForkedProcess(*launch, PWD=self.folder) as process:
            self.assertEqual(process.wait(), 0)
        first = next(line for line in process.output.splitlines() if "[INFO]" in line)
        self.assertIn(f"plan {path}: 1 row, 1 s, 0.02 m", first)
        self.assertIn("the car drove 0.02 m", process.output)
        self.assert_rests_at(closed_form((3.0, 4.0, 1.0), [(0.02, 0.1, 1.0)]))

    def test_refuses_and_publishes_nothing(self):
        """Each fault is one message and exit status 1, and no command is published."""
        broken = os.path.join(FIXTURES, "broken_plans", "not_a_number.txt")
        cases = {
            f"{broken}:": [f"_plan_file:={broken}"],
            "circle, closed_figure_8, figure_8": ["_plan_file:=figure_9"],
            # Also if the value of an earlier run is wrong.
            "~plan is not known": ["_plan_file:=figure_9", "_plan:=figure_8"],
            "parameter ~loop is 'maybe'": ["_loop:=maybe"],
            "'plan_file:=circle' sets no parameter; expected _plan_file:=circle": [
                "plan_file:=circle"
            ],
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
        ghost = self.ending(Ghost(subscribes=["/told_late"], publishes=["/ghost/car_pose"]))
        wrong = self.ending(Recording("/wrong_initialpose", PoseWithCovarianceStamped))
        control_topic = f"_control_topic:={NAVIGATION}"
        path = self.plan("90,0,0\n1.0,0,1\n")  # no other test places the car there
        cases = (
            (["_control_topic:=/told_late"], lambda _: len(ghost.calls["publisherUpdate"]) > 1),
            (["_car_name:=ghost", control_topic], lambda _: len(ghost.calls["requestTopic"]) > 1),
            (
                ["_init_pose_topic:=/nowhere"],
                lambda output: "waiting for a subscriber of /nowhere" in output,
            ),
            (["_init_pose_topic:=/wrong_initialpose"], lambda _: wrong.last),
        )
        started = [
            self.ending(driver(path, f"__name:=waiting_{number}", *arguments))
            for number, (arguments, _) in enumerate(cases)
        ]
        for process, (arguments, is_waiting) in zip(started, cases):
            wait_for(lambda p=process, w=is_waiting: w(p.output), f"the wait with {arguments}")
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
                CarPose(car).wait_until_at(Pose(90.0, 0.0, 0.0), 0, 0.0)

    def test_the_car_starts_after_the_mux(self):
        """On a busy machine, click_planner, which subscribes to the start pose, can be first."""
        load("ackermann_cmd_mux.yaml", "/late/mux/ackermann_cmd_mux")
        self.ending(node("ackermann_cmd_mux.py", "__ns:=/late/mux"))
        self.ending(Recording("/late/initialpose", PoseWithCovarianceStamped))
        path = self.plan("1,-1,0.5\n1.0,0.2,0.3\n")
        names = ("_car_name:=late", "__name:=early")
        with driver(path, *names) as plan:
            wait_for(
                lambda: "waiting for a publisher of /late/car_pose" in plan.output, "the message"
            )
            self.ending(node("car_sim.py", "__ns:=/late"))
            self.assertEqual(plan.wait(), 0, plan.output)
        self.assertIn("the car drove 0.30 m", plan.output)

    def test_the_car_of_mushrs_branch_noetic(self):
        """It is placed on another topic; the message contains the command that places it."""
        reposition = Recording("/mushr_sim/reposition", PoseStamped)
        self.addCleanup(reposition.subscriber.unregister)
        with self.assertRaises(UserError) as raised:
            CarPose("car").wait_until_at(Pose(5.0, 6.0, 0.5), 0, 0.0)
        command = re.search("Type: (.*) and then start", str(raised.exception))[1]
        with ForkedProcess(*shlex.split(command)) as place:
            self.assertEqual(place.wait(), 0)
        wait_for(lambda: reposition.last, "the pose")
        self.assert_pose(planar(reposition.last.pose), (5.0, 6.0, 0.5))
