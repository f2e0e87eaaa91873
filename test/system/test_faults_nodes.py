"""Check the car after nodes have died or were suspended, and without a master."""

import contextlib
import os
import re
import signal
import xmlrpc.client

import rosgraph
import rosgraph.xmlrpc
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros.connections import connected_nodes
from support.driven_car import DrivenCarTestCase, start_car
from support.geometry import POSITION_TOLERANCE, planar
from support.helpers import (
    PATIENCE,
    Process,
    Recording,
    driven,
    driver,
    kill,
    master,
    wait_for,
)
from support.messages import MUX, NAVIGATION, at, command, is_stop

COMPARISON = re.compile(r"the car drove (\S+) m .* difference (\S+) m")


def pid_of(name):
    """Return the process id of a node, or None if the node does not answer."""
    with contextlib.suppress(OSError, rosgraph.MasterError):
        api = xmlrpc.client.ServerProxy(rosgraph.Master("/faults").lookupNode(name))
        return api.getPid("/faults")[2]


def start_world():
    """Run the car with roslaunch, which restarts nodes."""
    arguments = ("respawn:=true", "map:=none", "laser:=false", "model:=false")
    return [Process("roslaunch", "mushr_ros_intro", "sim.launch", *arguments)]


class TestNodeFaults(DrivenCarTestCase):
    starts_car = False  # the launch file starts it

    def wait_until_it_drives(self):
        """Wait until the car reports new, different poses."""
        self.poses.clear()
        wait_for(lambda: len({planar(m.pose) for m in self.poses.messages}) > 5, "the car to drive")

    def test_respawn(self):
        """After roslaunch has restarted the car, the drive goes on; without the mux, it ends.

        Another node that receives the commands does not hide the end of the mux.
        """
        self.ending(Recording(NAVIGATION, AckermannDriveStamped))
        path = self.plan("1,-1,0.5\n1.0,0.2,60\n")
        sender = self.commands
        old = connected_nodes(sender)
        with driven(path) as (plan, watching):
            for name in ("/car/car_sim", MUX):
                self.wait_until_it_drives()
                killed = pid_of(name)
                kill(name, killed)
                if name == MUX:
                    self.assertEqual(plan.wait(), 1)
                else:
                    restarted = "the car has been restarted"
                    wait_for(lambda text=restarted: text in watching.output, "a warning")
                wait_for(lambda n=name, k=killed: pid_of(n) not in (None, k), f"a new {name}")
            self.assertNotIn("Traceback", plan.output)
            self.assertEqual(plan.output.count("FATAL"), 1)
            self.assertIn(f": {MUX} is no longer connected to {NAVIGATION}", plan.output)

        def new_nodes():
            return [name for link, name in connected_nodes(sender).items() if link not in old]

        wait_for(lambda: MUX in new_nodes(), "the new mux to be connected")
        self.assert_recovered()

    def test_no_input_drives_between_two_laps(self):
        """Then the commands were not late."""
        mux = rospy.Publisher("/laps", String, queue_size=10, latch=True)
        self.addCleanup(mux.unregister)
        mux.publish(String("Default"))

        def report(msg):
            mux.publish(String("Navigation" if msg.drive.speed else "Default"))

        sent = self.ending(Recording(NAVIGATION, AckermannDriveStamped, report))
        arguments = ("_loop:=true", "_send_init_pose:=false", "_active_topic:=/laps")
        with driver(self.plan("0,0,0\n0.5,0.1,0.5\n"), *arguments) as process:
            wait_for(lambda: len([m for m in sent.messages if is_stop(m)]) >= 4, "four laps")
            self.assertTrue(process.running, process.output)

    def test_the_mux_is_replaced_between_two_commands(self):
        """It is noticed although a node is connected whenever a command is published."""
        topic = "/replaced/input/navigation"
        sender = CommandPublisher(topic)
        mux = rospy.Subscriber(topic, AckermannDriveStamped)
        sender.wait_for_subscriber(PATIENCE)
        sender.publish(command(rospy.Time.now(), 1.0, 0.0))
        mux.unregister()
        mux = Recording(topic, AckermannDriveStamped).connected()
        self.addCleanup(mux.end)
        with self.assertRaisesRegex(UserError, f"{rospy.get_name()} is no longer connected"):
            for _ in range(3):
                sender.publish(command(rospy.Time.now(), 1.0, 0.0))
        sender.stop()
        wait_for(lambda: mux.last and mux.last.drive.speed == 0.0, "the stop")

    def test_car_and_mux_stand_still_at_the_end(self):
        """Late messages are applied at their stamps, and the monitor waits for the result."""
        path = self.plan("1,-1,0.5\n0.5,0.2,1\n")
        pids = [pid_of(name) for name in (MUX, "/car/car_sim")]
        with driven(path) as (plan, watching):
            wait_for(lambda: self.count(0.5) >= 8, "eight commands")
            for pid in pids:
                os.kill(pid, signal.SIGSTOP)
            resume = at(self.output.messages[0].header.stamp, 1.3)
            wait_for(lambda: rospy.Time.now() > resume, "the end of the plan")
            for pid in pids:
                os.kill(pid, signal.SIGCONT)
            self.assertEqual(plan.wait(), 0)
            self.assertEqual(watching.wait(), 0)
        length, difference = map(float, COMPARISON.search(watching.output).groups())
        # Until the stop arrives, the car may report that it drives on, until its last command
        # expires. Then it reports the right pose again. The sum of the distances is too large.
        self.assertEqual(length, 0.5)
        self.assertLess(difference, POSITION_TOLERANCE)
        self.assert_recovered()

    def test_the_sender_stands_still(self):
        """The stop of the mux does not cancel commands that were due before it, but arrive later.

        The rows are not multiples of the command period, so no command is due together with the
        stop, and no command would replace it for this reason.
        """
        path = self.plan("1,-1,0.5\n" + "1.0,0.1,0.25\n1.0,-0.1,0.25\n" * 4)
        self.output.clear()
        with driven(path) as (plan, watching):
            wait_for(lambda: self.count(1.0) >= 5, "five commands")
            plan.send_signal(signal.SIGSTOP)
            wait_for(lambda: self.output.last.drive.speed == 0.0, "the stop of the mux")
            plan.send_signal(signal.SIGCONT)
            self.assertEqual(plan.wait(), 0, plan.output)
            self.assertEqual(watching.wait(), 0)
        _, difference = map(float, COMPARISON.search(watching.output).groups())
        self.assertLess(difference, POSITION_TOLERANCE)

    def test_the_master_dies(self):
        """The plan is driven to its end, and Ctrl-C works, in a home that cannot be written."""
        with self.other_master(1.5) as (core, plan, watching):
            core.send_signal(signal.SIGKILL)
            self.assertEqual(plan.wait(), 0)
            self.assertEqual(watching.wait(), 0)
        length, difference = map(float, COMPARISON.search(watching.output).groups())
        self.assertEqual(length, 0.03)
        self.assertLess(difference, POSITION_TOLERANCE)

    def test_the_master_does_not_answer(self):
        """The drive ends, and Ctrl-C works, as on a cut network."""
        with self.other_master(60.0) as (core, plan, watching):
            core.send_signal(signal.SIGSTOP)
            for each in (plan, watching):
                self.assertEqual(each.wait(), 1)
                self.assertNotIn("Traceback", each.output)
        self.assertIn("the network to the master is cut. The drive ends", plan.output)

    @contextlib.contextmanager
    def other_master(self, seconds):
        """Drive a plan of `seconds` with another master; check that all nodes end on Ctrl-C."""
        environment = {"ROS_LOG_DIR": "/proc/nowhere"}
        with master("/faults", **environment) as (core, proxy):
            environment["ROS_MASTER_URI"] = proxy.master_uri
            proxy.setParam(MUX, rospy.get_param(MUX))
            nodes = list(map(self.ending, start_car(**environment)))
            # The car is slow, so a late message does not change the printed digits.
            path = self.plan(f"1,-1,0.5\n0.02,0.2,{seconds}\n")
            with driven(path, **environment) as (plan, watching):
                wait_for(lambda: "line 2 of 2" in watching.output, "the plan to be driven")
                yield core, plan, watching
            for each in nodes:
                each.send_signal(signal.SIGINT)
            for each in nodes:
                self.assertEqual(each.wait(), 0)
                self.assertNotIn("Traceback", each.output)
            core.send_signal(signal.SIGCONT)  # a stopped process cannot end
