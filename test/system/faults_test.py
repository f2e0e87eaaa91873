#!/usr/bin/python3
"""Break things on purpose while the car drives, and see what becomes of it.

After each fault every node still lives, the car stands where nobody drives it, and a new plan ends
where it should.
"""

import contextlib
import math
import os
import re
import resource
import signal
import socket
import struct
import threading
import time
import xmlrpc.client

import rosgraph
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from mushr_ros_intro.ros.connections import wait_until_connected
from support.helpers import (
    ANGLE_TOLERANCE,
    POSITION_TOLERANCE,
    Ghost,
    Process,
    Recording,
    Relay,
    RosTestCase,
    at,
    closed_form,
    command,
    float32,
    free_port,
    is_stop,
    kill,
    node,
    placement,
    planar,
    publisher,
    wait_for,
)

MUX = "/car/mux/ackermann_cmd_mux"
TIMEOUT = 0.2
"""[s] How long a command is good for, at the mux and at the car."""
LEAD = 0.4
"""[s] How far ahead of the clock the tests stamp their first message."""
MEMORY = 10_000_000
"""[bytes] How much more a node may hold: the few messages that wait, and a growing heap."""
ROWS = [(2.0, 0.3, 0.1), (-1.0, -0.2, 0.1), (1.5, 0.1, TIMEOUT)]
"""[m/s, rad, s]"""


def start(name, **environment):
    """Start the car, or its mux."""
    if name == "car_sim.py":
        return node(name, "__ns:=/car", "initialpose:=/initialpose", **environment)
    return node(name, "__ns:=/car/mux", **environment)


def driven(messages, until):
    """Return the rows that a car has driven at an instant that has obeyed all these commands."""
    stamps = sorted({msg.header.stamp: msg.drive for msg in messages}.items())
    stamps = [(stamp, drive) for stamp, drive in stamps if stamp < until]
    ends = [stamp for stamp, _ in stamps[1:]] + [until]
    return [
        (drive.speed, drive.steering_angle, min((end - stamp).to_sec(), TIMEOUT))
        for (stamp, drive), end in zip(stamps, ends)
    ]


def memory_of(process):
    """Return what a process has in memory [bytes]."""
    with open(f"/proc/{process.pid}/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def busy_time(process):
    """Return for how long a process has computed [s]."""
    with open(f"/proc/{process.pid}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


class DeafSubscriber:
    """A subscriber that never reads what it gets, as one that has been stopped."""

    def __init__(self, topic, kind):
        name = "/deaf" + topic.replace("/", "_")
        master = rosgraph.Master(name)
        publishers, _, _ = master.getSystemState()
        (who,) = dict(publishers)[topic]
        self._node = xmlrpc.client.ServerProxy(master.lookupNode(who))
        _, _, (_, host, port) = self._node.requestTopic(name, topic, [["TCPROS"]])
        self._topic, self._sent, self._since = topic, [], 0.0
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, 536)
        self._socket.connect((host, port))
        fields = {"callerid": name, "topic": topic, "type": kind._type, "md5sum": kind._md5sum}
        lines = [f"{key}={value}".encode() for key, value in fields.items()]
        header = b"".join(struct.pack("<I", len(line)) + line for line in lines)
        self._socket.sendall(struct.pack("<I", len(header)) + header)

    def is_stuck(self):
        """Say whether nothing more has been sent to it for half a second."""
        _, _, (publications, _, _) = self._node.getBusStats("/deaf")
        sent = [each[2] for each in publications if each[0] == self._topic]
        if sent != self._sent:
            self._sent, self._since = sent, time.monotonic()
        return time.monotonic() > self._since + 0.5

    def close(self):
        self._socket.close()


class Faults(RosTestCase):
    """What follows every fault."""

    @classmethod
    def setUpClass(cls):
        cls.car, cls.mux = start("car_sim.py"), start("ackermann_cmd_mux.py")
        cls.poses = Recording("/car/car_pose", PoseStamped).connected()
        cls.output = Recording(f"{MUX}/output", AckermannDriveStamped).connected()
        cls.active = Recording(f"{MUX}/active", String).connected()
        cls.placements = publisher("/initialpose", PoseWithCovarianceStamped)
        cls.inputs = {
            name: publisher(f"{MUX}/input/{name}", AckermannDriveStamped)
            for name in ("teleop", "navigation")
        }

    @classmethod
    def tearDownClass(cls):
        cls.car.end()
        cls.mux.end()

    def setUp(self):
        super().setUp()
        for recording in (self.poses, self.output):
            recording.clear()

    def place(self, *pose):
        """Put the car somewhere, and wait until it says that it is there."""
        self.placements.publish(placement(rospy.Time.now(), *pose))
        wait_for(lambda: self.poses.last and self.is_at(pose), f"the car to be at {pose}")

    def is_at(self, pose):
        got = planar(self.poses.last.pose)
        return math.hypot(got[0] - pose[0], got[1] - pose[1]) < POSITION_TOLERANCE

    def assert_all_is_well(self):
        """Nobody drives the car and it stands, and a new plan ends where it should."""
        self.assertTrue(self.car.running and self.mux.running)
        for each in (self.placements, self.inputs["navigation"]):
            self.assertTrue(wait_until_connected(each, "subscribers"))
        self.poses.pose_at_rest(rospy.Time.now())
        self.place(1.0, 2.0, 0.5)
        stamp = at(rospy.Time.now(), LEAD)
        for speed, angle, _ in ROWS:
            self.inputs["navigation"].publish(command(stamp, speed, angle))
            stamp = at(stamp, 0.1)
        pose = self.poses.pose_at_rest(at(stamp, TIMEOUT))
        self.assert_pose(pose, closed_form((1.0, 2.0, 0.5), ROWS))
        for msg in self.poses.messages:
            self.assertTrue(all(map(math.isfinite, planar(msg.pose))))

    def count(self, speed):
        """Return how many commands of a speed have come out of the mux."""
        return sum(msg.drive.speed == speed for msg in self.output.messages)

    def wait_until_it_drives(self, poses=None):
        """Wait until a car, by default the one of all these tests, moves, from now on."""
        poses = poses or self.poses
        poses.clear()

        def moves():
            return len({planar(msg.pose) for msg in poses.messages}) > 5

        wait_for(moves, "the car to drive")


class TestFaults(Faults):
    """Faults in wall-clock time."""

    def test_in_mid_plan(self):
        """Others drive the car, and the car and the mux die and come back: the plan goes on."""
        path = self.plan("1,-1,0.5\n1.0,0.2,60\n")
        with node("path_publisher.py", f"_plan_file:={path}") as plan:
            wait_for(lambda: len(self.output.messages) >= 5, "five commands")
            # Another publisher on the same input.
            begin = at(rospy.Time.now(), LEAD)
            for number in range(10):
                stamp = at(begin, 0.03 * number)
                self.inputs["navigation"].publish(command(stamp, -0.5, 0.1))
            wait_for(lambda: self.count(-0.5) == 10, "the other's commands to come out")
            # Teleop takes over and lets go.
            begin = at(begin, 0.3)
            for number in range(3):
                self.inputs["teleop"].publish(command(at(begin, 0.1 * number), 0.5, -0.3))
            wait_for(lambda: self.active.last.data == "teleop", "teleop to drive")
            wait_for(lambda: self.active.last.data == "navigation", "the plan to drive again")
            # All the time the car has obeyed what came out of the mux, at its stamps.
            pose = self.poses.after(at(rospy.Time.now(), TIMEOUT))
            self.output.after(pose.header.stamp)
            rows = driven(self.output.messages, pose.header.stamp)
            self.assertLessEqual({1.0, -0.5, 0.5}, {row[0] for row in rows})
            self.assert_pose(planar(pose.pose), closed_form((1.0, -1.0, 0.5), rows))
            # The car dies.
            kill("/car/car_sim", self.car.pid)
            self.car.wait()
            self.__class__.car = start("car_sim.py")
            self.wait_until_it_drives()
            # The mux dies.
            kill("/car/mux/ackermann_cmd_mux", self.mux.pid)
            self.mux.wait()
            self.poses.pose_at_rest(rospy.Time.now())
            self.__class__.mux = start("ackermann_cmd_mux.py")
            self.wait_until_it_drives()
            plan.send_signal(signal.SIGINT)
            self.assertEqual(plan.wait(), 0, plan.output)
            self.assertNotIn("Traceback", plan.output)
        self.assert_all_is_well()

    def test_respawn(self):
        """roslaunch starts a car and a mux that have died again, and the plan goes on."""
        path = self.plan("1,-1,0.5\n1.0,0.2,60\n")
        arguments = ("car_name:=again", "respawn:=true", "laser:=false", "model:=false")
        with Process("roslaunch", "mushr_ros_intro", "sim.launch", *arguments) as launch:
            poses = Recording("/again/car_pose", PoseStamped).connected()
            arguments = ("_car_name:=again", "_init_pose_topic:=/again/initialpose")
            with node("path_publisher.py", f"_plan_file:={path}", *arguments) as plan:
                for name in ("car_sim", "mux/ackermann_cmd_mux"):
                    self.wait_until_it_drives(poses)
                    started = rf"process\[again/{name}-\d+\]: started with pid \[(\d+)\]"
                    kill(f"/again/{name}", int(re.findall(started, launch.output)[-1]))
                    wait_for(
                        lambda: len(re.findall(started, launch.output)) == 2,  # noqa: B023
                        f"{name} to be started again",
                    )
                self.wait_until_it_drives(poses)
                plan.send_signal(signal.SIGINT)
                self.assertEqual(plan.wait(), 0, plan.output)
            pose = poses.pose_at_rest(rospy.Time.now())
            self.assertTrue(all(map(math.isfinite, pose)))
            launch.send_signal(signal.SIGINT)
            self.assertEqual(launch.wait(), 0, launch.output)
        poses.subscriber.unregister()

    def test_a_node_stands_still_at_the_end(self):
        """What comes late by half a second is put in its place, and the node waits for that."""
        path = self.plan("1,-1,0.5\n0.5,0.2,1\n")
        for stopped in (None, self.mux, self.car):
            self.output.clear()
            with node("path_publisher.py", f"_plan_file:={path}") as plan:
                wait_for(lambda: self.count(0.5) >= 8, "eight commands")
                (stopped or plan).send_signal(signal.SIGSTOP)
                resume = at(self.output.messages[0].header.stamp, 1.3)
                wait_for(lambda resume=resume: rospy.Time.now() > resume, "the end of the plan")
                (stopped or plan).send_signal(signal.SIGCONT)
                self.assertEqual(plan.wait(), 0, plan.output)
            said = re.search(r"the car drove (\S+) m .* difference (\S+) m", plan.output)
            self.assertTrue(said, plan.output)
            driven, difference = map(float, said.groups())
            # By its poses: until the stop is there they may show it on its way for as long as a
            # command holds, and then back.
            self.assertGreaterEqual(driven, 0.5, plan.output)
            self.assertLessEqual(driven, 0.5 + 2.0 * 0.5 * TIMEOUT, plan.output)
            self.assertLess(difference, POSITION_TOLERANCE)
        self.assert_all_is_well()

    def test_a_thousand_commands_a_second(self):
        self.place(0.0, 0.0, 0.0)
        begin = at(rospy.Time.now(), LEAD)
        self.inputs["navigation"].publish(command(begin, 1.0, 0.2))
        wait_for(lambda: self.output.last, "the first command")
        for number in range(1, 901):
            stamp = at(begin, 0.001 * number)
            wait_for(lambda stamp=stamp: rospy.Time.now() > at(stamp, -LEAD), "its time")
            self.inputs["navigation"].publish(command(stamp, 1.0, 0.2))
        pose = self.poses.pose_at_rest(at(stamp, TIMEOUT))
        # Where a busy machine lets a queue overflow, the car stood for some of the way.
        seconds = pose[2] * 0.33 / math.tan(0.2)
        self.assert_pose(pose, closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)]))
        self.assertTrue(0.5 < seconds < 0.9 + TIMEOUT + ANGLE_TOLERANCE, seconds)
        self.assert_all_is_well()

    def test_a_start_pose_every_10_ms(self):
        """While it is driven: it gets nowhere, and ends where the last one and commands say."""
        begin = at(rospy.Time.now(), LEAD)
        for number in range(30):
            stamp = at(begin, 0.01 * number)
            self.placements.publish(placement(stamp, 0.1 * number, 3.0, 0.0))
            self.inputs["navigation"].publish(command(stamp, 1.0, 0.0))
        pose = self.poses.pose_at_rest(at(stamp, TIMEOUT))
        self.assert_pose(pose, (2.9 + TIMEOUT, 3.0, 0.0))
        self.assert_all_is_well()

    def test_messages_of_a_wrong_type(self):
        """They do not arrive; who publishes says so, and everybody lives on."""
        active = Recording(f"{MUX}/active", String).connected()
        sender = rospy.Publisher(f"{MUX}/input/safety", String, queue_size=1)
        receiver = Recording("/car/joint_states", String)
        wait_for(lambda: "topic types do not match" in self.car.output, "a word on the type")
        self.assertIn("/car/joint_states", self.car.output)
        sender.publish(String(data="stop"))
        self.assert_all_is_well()
        self.assertEqual(receiver.messages, [])
        self.assertNotIn("safety", [msg.data for msg in active.messages])
        self.assertIn("navigation", [msg.data for msg in active.messages])
        active.subscriber.unregister()
        sender.unregister()
        receiver.subscriber.unregister()

    def test_a_publisher_whose_clock_is_far_off(self):
        """The car obeys each command on arrival, and logs why.

        If it obeyed a stamp 10 s off, it would stand.
        """
        for offset in (10.0, -10.0, 1000.0, -1000.0):
            self.placements.publish(placement(at(rospy.Time.now(), offset), 1.0, -1.0, 0.5))
            wait_for(lambda: self.poses.last and self.is_at((1.0, -1.0)), "the car to be placed")
            begin = rospy.Time.now()
            for number in range(5):
                due = at(begin, 0.1 * number)
                wait_for(lambda due=due: rospy.Time.now() >= due, "the next command to be due")
                self.inputs["navigation"].publish(command(at(due, offset), 1.0, 0.0))
            x, y, _ = self.poses.pose_at_rest(rospy.Time.now())
            # 0.6 m, and what a busy machine adds to or takes from each command's distance.
            self.assertTrue(0.1 < math.hypot(x - 1.0, y + 1.0) < 1.5, (x, y))
        self.assertIn("synchronise the clocks", self.car.output)
        self.assert_all_is_well()

    def test_the_master_dies(self):
        """The plan is driven to its end, and Ctrl-C works; all that in a read-only home."""
        with self.other_master() as (core, plan, _):
            core.send_signal(signal.SIGKILL)
            self.assertEqual(plan.wait(), 0, plan.output)
        said = re.search(r"the car drove 0.03 m .* difference (\S+) m", plan.output)
        self.assertTrue(said, plan.output)
        self.assertLess(float(said.group(1)), POSITION_TOLERANCE)

    def test_the_master_is_silent(self):
        """As where the way to it is cut: the plan is given up, no node starts, and Ctrl-C works."""
        with self.other_master() as (core, plan, here):
            core.send_signal(signal.SIGSTOP)
            with node("car_sim.py", "__name:=late", **here) as late:
                for each in (plan, late):
                    self.assertEqual(each.wait(), 1, each.output)
                    self.assertNotIn("Traceback", each.output)
        self.assertIn("the network to the master is cut. The drive ends", plan.output)
        self.assertIn("car_sim: no master answers", late.output)

    @contextlib.contextmanager
    def other_master(self):
        """Drive a plan with a master that may be harmed; then see all end that was started."""
        port = free_port()
        uri = f"http://localhost:{port}"
        here = {"ROS_MASTER_URI": uri, "ROS_LOG_DIR": "/proc/nowhere"}
        with Process("rosmaster", "--core", "-p", str(port), **here) as core:
            master = rosgraph.Master("/faults", uri)
            wait_for(master.is_online, "the other master")
            master.setParam(MUX, rospy.get_param(MUX))
            nodes = [start(name, **here) for name in ("car_sim.py", "ackermann_cmd_mux.py")]
            for each in nodes:
                self.addCleanup(each.end)
            path = self.plan("1,-1,0.5\n0.02,0.2,1.5\n")  # slow: what is late shows in no digit
            with node("path_publisher.py", f"_plan_file:={path}", **here) as plan:
                wait_for(lambda: "row 1 of 1" in plan.output, "the plan to be driven")
                yield core, plan, here
            for each in nodes:
                each.send_signal(signal.SIGINT)
            for each in nodes:
                self.assertEqual(each.wait(), 0, each.output)
                self.assertNotIn("Traceback", each.output)
            core.send_signal(signal.SIGCONT)  # or it would not end

    def test_z_a_subscriber_that_never_reads(self):
        """The last of these tests: the car is not held up by it, nor at its end."""
        before = memory_of(self.car)
        deaf = DeafSubscriber("/car/odom", Odometry)
        self.addCleanup(deaf.close)
        wait_for(deaf.is_stuck, "nothing more to be sent to it")
        self.assert_all_is_well()
        self.assertLess(memory_of(self.car) - before, MEMORY)
        for process in (self.car, self.mux):
            process.send_signal(signal.SIGINT)
        for process in (self.car, self.mux):
            self.assertEqual(process.wait(), 0, process.output)
            self.assertNotIn("Traceback", process.output)


class OtherClock:
    """Somebody else than the car who publishes /clock."""

    STEP = rospy.Duration(0, 10_000_000)

    def __init__(self):
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=100, tcp_nodelay=True)
        self._lock = threading.Lock()
        self._now = rospy.Time(1000)
        self._stands = False
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self):
        while not rospy.is_shutdown():
            with self._lock:
                if not self._stands:
                    self._now += self.STEP
                    with contextlib.suppress(rospy.ROSException):  # closed at the end
                        self._publisher.publish(Clock(clock=self._now))
            time.sleep(self.STEP.to_sec())

    def set(self, stands=False, jump=0.0):
        """Hold the clock or let it go, and let it jump by some seconds."""
        with self._lock:
            self._now = at(self._now, jump)
            self._stands = stands


class TestOtherClock(Faults):
    """What /clock may do if another node than the car publishes it."""

    drives = 0

    @classmethod
    def setUpClass(cls):
        cls.clock = OtherClock()
        super().setUpClass()

    def test_a_node_that_is_not_connected_with_the_clock(self):
        """It has its subscription looked after, which now and then rospy does not."""
        ghost = Ghost(publishes=["/clock"])
        self.addCleanup(ghost.end)
        asked = ghost.calls["requestTopic"]
        wait_for(lambda: len(asked) >= 3, "the test, the car and the mux to ask")
        with node("plan_recorder.py", f"_folder:={self.folder}"):
            wait_for(lambda: len(asked) >= 5, "the node to ask, and to ask again")

    @contextlib.contextmanager
    def driving(self, text, *arguments):
        """Drive a plan; yield the node once it is under way, and wait for its end."""
        self.__class__.drives += 1  # a name of its own: parameters stay with the master
        name = f"__name:=driver_{self.drives}"
        with node(
            "path_publisher.py", f"_plan_file:={self.plan(text)}", name, *arguments
        ) as driver:
            wait_for(lambda: self.count(1.0) >= 3, "three commands")
            yield driver
            driver.wait()

    def hold_stop(self, message):
        """Hold a stop, which has the new time, until the car has noticed the jump too."""
        if is_stop(message):
            now = rospy.Time.now()
            wait_for(
                lambda: abs((self.poses.last.header.stamp - now).to_sec()) < 5.0,
                "the car to notice",
            )

    def test_commands_without_stamps(self):
        """One is good for its timeout by the wall clock too: the mux's clock may have been late."""
        inputs = (
            "[{name: late, topic: input/late, timeout: 5.0, priority: 1}, "
            "{name: quick, topic: input/quick, timeout: 0.2, priority: 2}]"
        )
        arguments = ("__name:=patient", f"_subscribers:={inputs}", "_publisher:=output")
        with node("ackermann_cmd_mux.py", *arguments) as patient:
            output = Recording("/patient/output", AckermannDriveStamped).connected()
            self.addCleanup(output.subscriber.unregister)
            late, quick = (
                publisher(f"/patient/input/{name}", AckermannDriveStamped)
                for name in ("late", "quick")
            )

            def send(stamp, speed, sender=late):
                sender.publish(command(stamp, speed, 0.0))
                wait_for(lambda: output.last and output.last.drive.speed == speed, f"{speed} m/s")

            send(rospy.Time(0), 1.0)
            send(rospy.Time(0), 1.5, quick)  # is over sooner, and shortens nothing
            self.clock.set(jump=20.0)  # all that it did not see before
            began, before = time.monotonic(), busy_time(patient)
            wait_for(lambda: time.monotonic() > began + 1.0, "a second to pass")
            self.assertLess(busy_time(patient) - before, 0.5)
            began = time.monotonic()
            send(rospy.Time(0), 2.0)
            self.clock.set(jump=20.0)
            wait_for(lambda: output.last.drive.speed == 0.0, "the stop")
            self.assertGreaterEqual(time.monotonic(), began + 5.0)
            # What has a stamp comes out as its stamps say, also right behind what has none.
            send(rospy.Time(0), 3.0)
            first, second = (at(rospy.Time.now(), seconds) for seconds in (10.0, 20.0))
            send(first, 4.0)
            send(second, 5.0)
            none = rospy.Time(0)
            self.assertEqual(
                [(msg.header.stamp, msg.drive.speed) for msg in output.messages],
                [(none, 1.0), (none, 1.5), (none, 2.0), (none, 0.0), (none, 3.0)]
                + [(first, 4.0), (at(first, 5.0), 0.0), (second, 5.0)],
            )

    def test_it_stands(self):
        """The plan stands too, nobody is kept busy by it, and then all goes on."""
        with self.driving("1,-1,0.5\n1.0,0.2,1.5\n") as driver:
            self.clock.set(stands=True)
            self.addCleanup(self.clock.set)
            began = time.monotonic()
            before = [busy_time(process) for process in (self.car, self.mux)]
            wait_for(lambda: time.monotonic() > began + 0.5, "half a second to pass")
            after = [busy_time(process) for process in (self.car, self.mux)]
            self.assertTrue(driver.running, driver.output)
            self.clock.set()
        self.assertEqual(driver.wait(), 0, driver.output)
        self.assertLess(max(map(float.__sub__, after, before)), 0.25)
        pose = self.poses.pose_at_rest(self.output.last.header.stamp)
        self.assert_pose(pose, closed_form((1.0, -1.0, 0.5), [(1.0, 0.2, 1.5)]))
        self.assert_all_is_well()

    def test_it_jumps(self):
        """The plan is given up, which is said, and the car stands when its last command is over."""
        for seconds in (10.0, -10.0):
            self.setUp()
            topic = f"/stops_held/{'ahead' if seconds > 0.0 else 'back'}"
            navigation = f"{MUX}/input/navigation"
            relay = Relay(topic, navigation, AckermannDriveStamped, self.hold_stop)
            self.addCleanup(relay.end)
            with self.driving("1,-1,0.5\n1.0,0.2,60\n", f"_control_topic:={topic}") as driver:
                self.clock.set(stands=True)
                held = time.monotonic()  # until each command on its way is at the car
                wait_for(lambda held=held: time.monotonic() > held + 2.0, "two seconds to pass")
                self.clock.set(jump=seconds)
            self.assertEqual(driver.wait(), 1, driver.output)
            self.assertIn("the clock was set", driver.output)
            now = rospy.Time.now()
            far = [m for m in self.poses.messages if abs((m.header.stamp - now).to_sec()) > 5.0]
            self.poses.clear()
            pose = self.poses.pose_at_rest(now)
            # It has not left its circle, on which its heading says how far it has come.
            reported, seconds_driven = (
                (angle - 0.5) * 0.33 / math.tan(float32(0.2))
                for angle in (planar(far[-1].pose)[2], pose[2])
            )
            self.assert_pose(pose, closed_form((1.0, -1.0, 0.5), [(1.0, 0.2, seconds_driven)]))
            rows = [msg for msg in self.output.messages if msg.drive.speed]
            until = (rows[-1].header.stamp - rows[0].header.stamp).to_sec() + TIMEOUT
            self.assertGreaterEqual(seconds_driven, reported - POSITION_TOLERANCE)
            if seconds < 0.0:  # it stands at once, but for what was sent before and came after
                self.assertLess(seconds_driven, until + POSITION_TOLERANCE)
            else:
                self.assertAlmostEqual(seconds_driven, until, delta=POSITION_TOLERANCE)
            self.assert_all_is_well()
        for process in (self.car, self.mux):
            self.assertIn("the clock was set back", process.output)


if __name__ == "__main__":
    rospy.init_node("faults_test")
    is_simulated = rospy.get_param("/use_sim_time", False)
    tests = TestOtherClock if is_simulated else TestFaults
    rostest.rosrun("mushr_ros_intro", "faults", tests)
