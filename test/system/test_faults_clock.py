"""Check the car with a /clock that stands, jumps, or comes from an unresponsive node."""

import contextlib
import math
import os
import threading
import time

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from rosgraph_msgs.msg import Clock

from support.driven_car import DrivenCarTestCase
from support.geometry import POSITION_TOLERANCE, closed_form, float32, planar
from support.ghost import Ghost
from support.helpers import Recording, Relay, driver, node, publisher, wait_for
from support.messages import COMMAND_TIMEOUT, MUX, NAVIGATION, at, command, is_stop
from support.world import load


def wait_seconds(seconds):
    """Wait for some seconds of wall-clock time [s]."""
    end = time.monotonic() + seconds
    wait_for(lambda: time.monotonic() > end, f"{seconds:g} s to pass")


def busy_time(process):
    """Return the CPU time of a process [s]."""
    with open(f"/proc/{process.pid}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def start_world():
    load("ackermann_cmd_mux.yaml", MUX)
    rosgraph.Master("/launch").setParam("/use_sim_time", True)
    return []


class OtherClock:
    """A publisher of /clock. With it, the car publishes no clock."""

    STEP = rospy.Duration(0, 10_000_000)

    def __init__(self):
        self.begin()
        self._lock = threading.Lock()
        self._now = rospy.Time(1000)
        self._stands = False
        threading.Thread(target=self._run, daemon=True).start()

    def begin(self):
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=100, tcp_nodelay=True)

    def end(self):
        self._publisher.unregister()

    def _run(self):
        while not rospy.is_shutdown():
            with self._lock:
                if not self._stands:
                    self._now += self.STEP
                    with contextlib.suppress(rospy.ROSException):  # closed at the end
                        self._publisher.publish(Clock(clock=self._now))
            time.sleep(self.STEP.to_sec())

    def set(self, stands=False, jump=0.0):
        """Hold or release the clock, and move it by `jump` [s]."""
        with self._lock:
            self._now = at(self._now, jump)
            self._stands = stands


class TestClockFaults(DrivenCarTestCase):
    @classmethod
    def setUpClass(cls):
        cls.clock = OtherClock()
        super().setUpClass()

    def test_a_node_that_is_not_connected_with_the_clock(self):
        """The node repeats the request for the connection, which rospy sometimes omits."""
        ghost = self.ending(Ghost(publishes=["/clock"]))
        asked = ghost.calls["requestTopic"]
        wait_for(lambda: len(asked) >= 3, "requests of the test, the car and the mux")
        with node("plan_recorder.py", f"_folder:={self.folder}"):
            wait_for(lambda: len(asked) >= 5, "two requests of the node")

    def hold_stop(self, message):
        """Hold a stop until the clock of the car has jumped, because the stop has the new time.

        The clock of this process may jump later than that of the node.
        """
        if is_stop(message):
            new = message.header.stamp
            wait_for(
                lambda: abs((self.poses.last.header.stamp - new).to_sec()) < 5.0,
                "the car's clock to jump",
            )

    def test_commands_without_stamps(self):
        """Such a command expires by the wall clock, too, because the mux's clock may be late."""
        inputs = (
            "[{name: late, topic: input/late, timeout: 5.0, priority: 1}, "
            "{name: quick, topic: input/quick, timeout: 0.2, priority: 2}]"
        )
        arguments = ("__name:=patient", f"_subscribers:={inputs}", "_publisher:=output")
        with node("ackermann_cmd_mux.py", *arguments) as patient:
            output = self.ending(Recording("/patient/output", AckermannDriveStamped).connected())
            late, quick = (
                publisher(f"/patient/input/{name}", AckermannDriveStamped)
                for name in ("late", "quick")
            )

            def send(stamp, speed, sender=late):
                sender.publish(command(stamp, speed, 0.0))
                wait_for(lambda: output.last and output.last.drive.speed == speed, f"{speed} m/s")

            send(rospy.Time(0), 1.0)
            send(rospy.Time(0), 1.5, quick)  # its timeout is shorter
            self.clock.set(jump=20.0)
            before = busy_time(patient)
            wait_seconds(1.0)
            self.assertLess(busy_time(patient) - before, 0.5)
            began = time.monotonic()
            send(rospy.Time(0), 2.0)
            self.clock.set(jump=20.0)
            wait_for(lambda: output.last.drive.speed == 0.0, "the stop")
            self.assertGreaterEqual(time.monotonic(), began + 5.0)
            # Commands with stamps pass by their stamps, also right after one without.
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

    def test_the_clock_stands_and_jumps_back(self):
        """The drive stands, too, without CPU load. Then it ends with a message, and the car stops.

        It stops at once, except for late commands.
        """
        topic = "/stops_held"
        self.ending(Relay(topic, NAVIGATION, AckermannDriveStamped, self.hold_stop))
        arguments = ("__name:=driver", f"_control_topic:={topic}")
        with driver(self.plan("1,-1,0.5\n1.0,0.2,60\n"), *arguments) as process:
            wait_for(lambda: self.count(1.0) >= 3, "three commands")
            self.clock.set(stands=True)
            wait_seconds(2.0)  # until the car has received the commands that were under way
            before = list(map(busy_time, self.nodes))
            wait_seconds(0.5)
            after = list(map(busy_time, self.nodes))
            self.assertTrue(process.running)
            self.clock.set(jump=-10.0)
            self.assertEqual(process.wait(), 1)
        self.assertLess(max(map(float.__sub__, after, before)), 0.25)
        self.assertIn("the clock was set", process.output)
        now = rospy.Time.now()
        far = [m for m in self.poses.messages if abs((m.header.stamp - now).to_sec()) > 5.0]
        self.poses.clear()
        pose = self.poses.pose_at_rest(now)
        # On the circle, the heading is proportional to the driven time.
        reported, seconds_driven = (
            (angle - 0.5) * 0.33 / math.tan(float32(0.2))
            for angle in (planar(far[-1].pose)[2], pose[2])
        )
        self.assert_pose(pose, closed_form((1.0, -1.0, 0.5), [(1.0, 0.2, seconds_driven)]))
        first, *_, last = (m.header.stamp for m in self.output.messages if m.drive.speed)
        self.assertGreaterEqual(seconds_driven, reported - POSITION_TOLERANCE)
        until = (last - first).to_sec() + COMMAND_TIMEOUT
        self.assertLess(seconds_driven, until + POSITION_TOLERANCE)
        self.assert_recovered()
        for process in self.nodes:
            self.assertIn("the clock was set back", process.output)

    def test_the_clock_ends(self):
        """Then no command is due any more, so the node ends by itself."""
        with driver(self.plan("1,-1,0.5\n1.0,0.2,60\n")) as process:
            wait_for(lambda: self.count(1.0) >= 3, "three commands")
            self.clock.end()
            self.addCleanup(self.clock.begin)
            self.assertEqual(process.wait(), 1)
        self.assertIn("the node that published /clock has ended", process.output)
