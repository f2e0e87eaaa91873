"""Check what the monitor of sim.launch says about the drives of any node."""

import os
import re

import pytest
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_msgs.msg import String
from std_srvs.srv import Trigger

from support.geometry import closed_form
from support.helpers import (
    Recording,
    RosTestCase,
    driver,
    failures_in,
    node,
    publisher,
    rostest_results,
    wait_for,
)
from support.messages import NAVIGATION, OUTPUT, TELEOP, command, placement
from support.paths import CHECKOUT
from support.world import LOCK_STEP, launch

ACCUSED = ("The commands for the car differ", "ended in line")
"""What the monitor says if the cause is the node of the drive."""

nodes = []


def start_world():
    nodes.extend(launch("sim.launch", laser=False, model=False, **LOCK_STEP))
    return nodes


class TestDriveMonitor(RosTestCase):
    def setUp(self):
        super().setUp()
        (self.watching,) = (each for each in nodes if "drive_monitor" in each.command)
        wait_for(lambda: "watching the drives" in self.watching.output, "the monitor")
        self.begin = len(self.watching.output)
        self.output = self.ending(Recording(OUTPUT, AckermannDriveStamped).connected())
        self.is_held = False

    @property
    def said(self):
        """What the monitor has said in this test."""
        return self.watching.output[self.begin :]

    def says(self, *parts):
        """Wait until the monitor has said everything; return what it has said until then."""
        wait_for(lambda: all(part in self.said for part in parts), f"{parts} in {self.said}")
        return self.said

    def control(self, service):
        """Hold the clock, or release it."""
        self.assertTrue(rospy.ServiceProxy(f"/car/car_sim/{service}", Trigger)().success)

    def hold(self, count=5):
        """Hold the clock when `count` commands have reached the car."""

        def on_command(_):
            nonlocal count
            count -= 1
            if not count:
                self.control("pause")
                self.is_held = True

        self.ending(Recording(OUTPUT, AckermannDriveStamped, on_command).connected())
        self.addCleanup(self.control, "resume")

    def drive(self, plan, *arguments):
        """Drive a plan with the tutorial's listing, whose rows are up to 0.1 s longer."""
        with node("listing.py", f"_plan_file:={plan}", "_connections:=1", *arguments) as listing:
            self.assertEqual(listing.wait(), 0)

    def test_the_tutorials_listing(self):
        """Its rows do not last one second; its last command lasts until the mux stops the car.

        Its first command comes right after its start pose, before the car has reported it.
        """
        path = self.plan("1,2,0.5\n0.2,0.1\n2.0,-0.1\n")
        self.drive(path)
        said = self.says(f"the plan of /listing: {path}, 2 rows, 2 s, 2.20 m", "[ERROR]")
        # On a busy machine, the last row can have so few commands that it is not complete, and the
        # start pose, which is on another topic, can come much later than the first command.
        is_late = "was placed at the start pose" in said
        self.assertEqual("not at the start pose" in said, is_late)
        wrong = r"differ from the plan: .* of line \d lasted|ended in line 3 of 3"
        self.assertRegex(said, r"\d\.\d\d s later" if is_late else wrong)

    def test_other_names_one_after_another_and_a_changed_plan(self):
        """Each drive is judged with the plan that its node has at that time.

        The verdict is published, too; it is empty during a drive.
        """
        verdicts = self.ending(Recording("/car/drive_monitor/verdict", String).connected())
        path = self.plan("1,2,0.5\n1.0,0.2,0.5\n")
        drives = [
            ("/ann", path, "1,2,0.5\n1.0,0.2,0.5\n", "0.50 m"),
            ("/lab/bob", self.plan("0,0,0\n", "other.txt"), "3,2,1\n-1.0,0.1,0.1\n", "0.10 m"),
            ("/ann", path, "1,2,0.5\n2.0,0.2,0.6\n", "1.20 m"),
        ]
        for name, file, text, length in drives:
            self.begin = len(self.watching.output)
            with open(file, "w") as plan:
                plan.write(text)
            space, _, base = name.rpartition("/")
            names = (f"__name:={base}", f"__ns:={space or '/'}")
            with driver(file, *names) as process:
                self.assertEqual(process.wait(), 0)
            said = self.says(f"the plan of {name}: {file}, 1 row", f"the car drove {length}")
            self.assertIn("the plan has been driven", said)
            wait_for(lambda n=length: n in verdicts.last.data, "the verdict")
            during, after = (msg.data for msg in verdicts.messages[-2:])
            self.assertEqual(during, "")
            for line in after.split("\n"):
                self.assertIn(line, said)

    def test_a_plan_that_cannot_be_read(self):
        """The listing drives it all the same; there is no judgement."""
        path = self.plan("1,2,0.5\n0.5,0.1\n0.5,9.0\n")
        self.drive(path)
        said = self.says(f"{path}:3", "the drive of /listing has ended; the car stopped at")
        self.assertIn("It is not judged: the plan of /listing cannot be driven", said)

    def test_a_start_pose_that_does_not_come(self):
        """The listing waits for no report of the car."""
        path = self.plan("7,8,0.5\n0.1,0.1\n0.1,-0.1\n0.1,0.1\n")
        self.ending(Recording("/nowhere", PoseWithCovarianceStamped))
        self.drive(path, "_init_pose_topic:=/nowhere")
        fault = "the car was not at the start pose (7.0000 m, 8.0000 m, 0.5000 rad) when the first"
        said = self.says(fault)
        self.assertNotIn("later", said)

    def test_a_node_without_a_plan(self):
        """It gets the pose where the car stopped, and no judgement."""
        sender = publisher(TELEOP, AckermannDriveStamped)
        self.addCleanup(sender.unregister)
        poses = self.ending(Recording("/car/car_pose", PoseStamped).connected())
        start = poses.pose_at_rest(rospy.Time.now())
        sender.publish(command(rospy.Time.now(), 1.0, 0.0))
        end = "({:.4f} m, {:.4f} m, {:.4f} rad)".format(*closed_form(start, [(1.0, 0.0, 0.2)]))
        said = self.says(f"the drive of {rospy.get_name()} has ended; the car stopped at {end}")
        self.assertIn("no parameter ~plan_file", said)
        self.assertNotIn("ERROR", said)

    def test_what_others_do_is_not_the_fault_of_the_node(self):
        """Another node drives the car, on the same input and on another one; then it places it."""
        path = self.plan("1,2,0.5\n0.2,0.2,30\n")  # it is held long before its end
        senders = [publisher(each, AckermannDriveStamped) for each in (NAVIGATION, TELEOP)]
        for each in senders:
            self.addCleanup(each.unregister)
        placements = publisher("/initialpose", PoseWithCovarianceStamped)
        self.addCleanup(placements.unregister)
        poses = self.ending(Recording("/car/car_pose", PoseStamped).connected())

        def drive_too():
            for speed, sender in zip((-3.0, -4.0), senders):
                sender.publish(command(rospy.Time.now(), speed, 0.0))
                self.output.first(lambda msg, v=speed: msg.drive.speed == v, "the other command")

        def place():
            placements.publish(placement(rospy.Time.now(), 9.0, 9.0, 1.0))

            def is_placed():
                self.control("step")  # the car reports its pose when the clock advances
                return poses.last.pose.position.x > 8.0

            wait_for(is_placed, "the other pose")

        others = (rospy.get_name(), "the input teleop of the mux")
        warnings = [f"{each} also publishes commands" for each in others]
        interferences = (
            (drive_too, *warnings, f"{', '.join(others)} also published commands"),
            (place, "the car was placed at another pose: it was at (9."),
        )
        for interfere, *causes in interferences:
            self.begin = len(self.watching.output)
            self.is_held = False
            self.hold()
            with driver(path) as process:
                wait_for(lambda: self.is_held, "five commands")
                self.says("line 2 of 2")  # the monitor has found the plan
                interfere()
                self.control("resume")
                self.assertEqual(process.wait(), 0)
            said = self.says("after the plan, the car was at (", *causes)
            for each in ACCUSED:
                self.assertNotIn(each, said)

    def test_a_monitor_that_starts_during_a_drive(self):
        """It does not judge this drive, but the next one."""
        path = self.plan("1,2,0.5\n0.2,0.2,3\n")
        self.hold()
        with driver(path) as process:
            wait_for(lambda: self.is_held, "five commands")
            late = self.ending(node("drive_monitor.py", "__name:=late"))
            wait_for(lambda: "watching the drives" in late.output, "the second monitor")
            self.control("resume")
            self.assertEqual(process.wait(), 0)
        why_not = "its first command came before this monitor was connected"
        wait_for(lambda: f"It is not judged: {why_not}" in late.output, "the end")
        self.assertNotIn("should have ended", late.output)
        with driver(self.plan("1,2,0.5\n1.0,0.2,0.3\n")) as process:
            self.assertEqual(process.wait(), 0)
        wait_for(lambda: "the plan has been driven" in late.output, "the result")


@pytest.mark.full
@pytest.mark.parametrize("monitored", ["straight_line", "circle"])
def test_the_rostest_of_the_page(tmp_path, monitored):
    """The .test file of docs/nodes.md passes; it fails if the node drives another plan."""
    with open(f"{CHECKOUT}/docs/nodes.md", encoding="utf-8") as page:
        (text,) = re.findall(r"^ {4}<launch>\n(?:.*\n)*? {4}</launch>\n", page.read(), re.MULTILINE)
    before, _, after = text.replace("figure_8", "straight_line", 1).partition("figure_8")
    (tmp_path / "drive.test").write_text(f"{before}{monitored}{after}")
    (tmp_path / "package.xml").write_text("<package><name>course</name></package>")
    results = str(tmp_path / "results" / "course" / "rosunit-drive.xml")
    packages = os.pathsep.join((str(tmp_path), os.environ["ROS_PACKAGE_PATH"]))
    test = str(tmp_path / "drive.test")
    process, result = rostest_results(results, test, ROS_PACKAGE_PATH=packages)
    failures = failures_in(result)
    if monitored == "straight_line":
        assert failures == {"drive": None}, process.output
    else:
        assert "The commands for the car differ from the plan" in failures["drive"]
