"""Check that plans end at the poses of their closed forms, and that their commands are right."""

import math
import re

import rosnode
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from support.geometry import closed_form, float32, planar
from support.helpers import Recording, RosTestCase, driver, node, wait_for
from support.paths import PLANS
from support.world import launch

PERIOD = 100_000_000
"""[ns] Between two commands of a row."""

BUSY = 1
"""[s] Both cores are busy for this part of the drives."""

NAMES = {"circle", "test_drive"}
"""They take 8 and 6 s; test_lock_step_ideal.py drives every plan, in lock-step."""


def read(name):
    """Read a plan without the package's parser."""
    with open(f"{PLANS}/{name}.txt") as file:
        lines = [line.split("#")[0].strip() for line in file]
    start, *rows = (tuple(map(float, line.split(","))) for line in lines if line)
    return start, [(*row, 1.0)[:3] for row in rows]


monitors = {}


def start_world():
    """Run a car for each plan."""
    started = []
    for name in NAMES:
        nodes = launch("sim.launch", car_name=name, laser=False, model=False)
        (monitors[name],) = (each for each in nodes if "drive_monitor" in each.command)
        started += nodes
    return started


class TestDrive(RosTestCase):
    plans = None

    @classmethod
    def drive(cls):
        """Drive all plans at the same time."""
        cls.plans = {name: read(name) for name in NAMES}
        cls.starts, cls.commands, cls.poses, cls.outputs = {}, {}, {}, {}
        for name in cls.plans:
            topic = f"/{name}/mux/ackermann_cmd_mux/input/navigation"
            cls.commands[name] = Recording(topic, AckermannDriveStamped)
            cls.starts[name] = Recording(f"/{name}/initialpose", PoseWithCovarianceStamped)
            cls.poses[name] = Recording(f"/{name}/car_pose", PoseStamped).connected()
        processes = {name: cls.start(name) for name in cls.plans}
        longest = cls.commands["circle"]
        wait_for(lambda: longest.messages, "the first command")
        with node("busy.py", "__name:=busy_1"), node("busy.py", "__name:=busy_2"):
            count = len(longest.messages) + 10 * BUSY
            wait_for(lambda: len(longest.messages) > count, "the plans to be driven")
        for name, process in processes.items():
            assert process.wait() == 0, process.output
            wait_for(lambda n=name: "difference" in monitors[n].output, "the result")
            cls.outputs[name] = monitors[name].output

    @staticmethod
    def start(name):
        """Start the publisher of a plan."""
        topic = f"_init_pose_topic:=/{name}/initialpose"
        return driver(name, f"_car_name:={name}", topic, f"__ns:={name}")

    def setUp(self):
        super().setUp()
        if self.plans is None:
            self.drive()

    def test_final_pose(self):
        for name, (start, rows) in self.plans.items():
            stop = self.commands[name].last.header.stamp
            self.assert_pose(self.poses[name].pose_at_rest(stop), closed_form(start, rows))

    def test_start_pose_comes_first(self):
        """The car is at the start pose before the first command applies."""
        for name, (start, _) in self.plans.items():
            (placement,) = self.starts[name].messages
            self.assertEqual(placement.header.frame_id, "map", name)
            first = self.commands[name].messages[0].header.stamp
            self.assertGreater(placement.header.stamp.to_nsec(), 0, name)
            self.assertLessEqual(placement.header.stamp, first, name)
            before = [m for m in self.poses[name].messages if m.header.stamp <= first]
            self.assert_pose(planar(before[-1].pose), start)

    def test_a_line_per_row_and_second(self):
        for name, (_, rows) in self.plans.items():
            seconds = sum(math.ceil(row[2]) for row in rows)
            lines = re.findall(r"line \d+ of \d+: .* s left", self.outputs[name])
            self.assertEqual(len(lines), seconds, name)
            self.assertIn("difference", self.outputs[name])

    def test_commands(self):
        """There are ten commands per second, with exact stamps, and a stop at the end."""
        for name, (_, rows) in self.plans.items():
            messages = self.commands[name].messages
            begin = messages[0].header.stamp.to_nsec()
            expected, due = [], 0
            for speed, steering_angle, seconds in rows:
                end = due + round(seconds * 1e9)
                told = float32(speed), float32(steering_angle)
                expected += [(stamp, *told) for stamp in range(due, end, PERIOD)]
                due = end
            expected.append((due, 0.0, 0.0))
            got = [
                (m.header.stamp.to_nsec() - begin, m.drive.speed, m.drive.steering_angle)
                for m in messages
            ]
            self.assertEqual(got, expected, name)
            frames = {m.header.frame_id for m in messages}
            self.assertEqual(frames, {f"{name}/base_footprint"})

    def test_cars_share_nothing(self):
        """Cars have no common node, and no common topics except /rosout, /tf, /clock and /map."""
        master = rospy.get_master()
        _, _, (publishers, subscribers, _) = master.getSystemState()
        for topic, nodes in publishers + subscribers:
            if topic.startswith(("/rosout", "/tf", "/clock", "/map")):
                continue
            cars = {name for name in self.plans for node in nodes if node.startswith(f"/{name}/")}
            self.assertLessEqual(len(cars), 1, f"{topic} is shared by {cars}")
        names = rosnode.get_node_names()
        for name in self.plans:
            self.assertIn(f"/{name}/car_sim", names)
            self.assertIn(f"/{name}/mux/ackermann_cmd_mux", names)
