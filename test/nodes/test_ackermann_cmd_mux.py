"""Check the mux: priorities, timeouts, the stop, the active input, a wrong configuration."""

import threading
from unittest import mock

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from rospy.impl.tcpros_base import TCPROSTransport
from std_msgs.msg import String

from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.simulator.ackermann_cmd_mux import AckermannCmdMux
from support.helpers import PATIENCE, Recording, RosTestCase, node, publisher, wait_for
from support.messages import COMMAND_TIMEOUT, MUX, command
from support.world import load

INPUTS = ("safety", "teleop", "navigation", "default")

MS = 1_000_000
"""[ns]"""

STOP = (None, 0.0)
"""The stop of the mux has no stamp."""


def start_world():
    load("ackermann_cmd_mux.yaml", MUX)
    return [node("ackermann_cmd_mux.py", "__ns:=/car/mux")]


class MuxTestCase(RosTestCase):
    """A test case with the topics of a mux. Instants count from the beginning of the test [ms]."""

    def use(self, mux, begin):
        """Connect to a mux, and wait until it is idle; the test begins at `begin` [ns]."""
        self.begin = begin
        self.output = Recording(f"{mux}/output", AckermannDriveStamped).connected()
        # Only a new connection gets the latched message.
        self.active = self.ending(Recording(f"{mux}/active", String).connected())
        self.inputs = {
            name: publisher(f"{mux}/input/{name}", AckermannDriveStamped) for name in INPUTS
        }
        wait_for(lambda: self.active.last and self.active.last.data == "idle", "an idle mux")
        self.output.clear()

    def send(self, name, stamp, speed):
        """Send a command on an input."""
        stamp = rospy.Time(0, self.begin + stamp * MS)
        self.inputs[name].publish(command(stamp, speed, 0.0))

    def sent(self):
        """Return the output of the mux as (stamp, speed); the stamp is None if it is zero."""
        stamps = [m.header.stamp.to_nsec() for m in self.output.messages]
        return [
            ((stamp - self.begin) / MS if stamp else None, m.drive.speed)
            for stamp, m in zip(stamps, self.output.messages)
        ]

    def expect(self, *commands):
        """Wait until the mux has passed these commands and no others."""
        wait_for(lambda: len(self.sent()) >= len(commands), f"{commands}, got {self.sent()}")
        self.assertEqual(self.sent(), list(commands))

    def expect_active(self, *names):
        """Wait until these inputs and no others have driven since the beginning."""
        wait_for(lambda: len(self.active.messages) > len(names), f"{names} to drive")
        self.assertEqual([m.data for m in self.active.messages], ["idle", *names])


class TimedMux(AckermannCmdMux):
    """The mux in this process, at an instant that the test sets."""

    now = 1_700_000_000_000 * MS
    """[ns]"""
    processed = 0
    """The number of commands."""

    def _on_command(self, *arguments):
        super()._on_command(*arguments)
        self.processed += 1

    def expire(self):
        """Send a stop if the last live input has expired."""
        with self._lock:
            self._expire(self._read_clock())


class TestTimes(MuxTestCase):
    """Wall-clock time is an input of these tests. The timeouts are 200 ms."""

    def setUp(self):
        super().setUp()
        name = f"/{self._testMethodName}"
        load("ackermann_cmd_mux.yaml", name)
        self.mux = TimedMux(name)
        patch = mock.patch.object(ros_time, "now", lambda: self.mux.now)
        patch.start()
        self.addCleanup(patch.stop)
        self.use(name, TimedMux.now)

    def advance(self, until):
        """Advance the clock."""
        self.mux.now = self.begin + until * MS
        self.mux.expire()

    def send(self, name, stamp, speed, arrival=None):
        """Send a command that arrives at its stamp or at another instant."""
        self.advance(stamp if arrival is None else arrival)
        before = self.mux.processed
        super().send(name, stamp, speed)
        wait_for(lambda: self.mux.processed > before, "the mux to process the command")

    def test_each_change_of_the_active_input_is_sent(self):
        """Although the thread that sends them runs late."""
        may_write, write = threading.Event(), TCPROSTransport.write_data

        def write_late(transport, data):
            if transport.name == self.active.topic:
                may_write.wait(PATIENCE)
            return write(transport, data)

        with mock.patch.object(TCPROSTransport, "write_data", write_late):
            for number in range(3):
                self.send("teleop", 300 * number, 1.0)
            may_write.set()
            self.expect_active("teleop", "idle", "teleop", "idle", "teleop")

    def test_priorities_and_timeouts(self):
        self.send("navigation", 0, 1.0)
        self.send("default", 10, 1.5)
        self.send("teleop", 50, 2.0)
        self.expect_active("navigation", "teleop")
        self.send("navigation", 100, 3.0)  # teleop is live
        self.send("navigation", 249, 4.0)  # and still is
        self.send("navigation", 275, 4.5, arrival=249)  # and is when this arrives
        self.send("navigation", 250, 5.0)  # and no longer is
        expected = [(0, 1.0), (50, 2.0), (250, 5.0)]
        self.expect(*expected)
        self.send("default", 300, 6.0)
        self.send("default", 474, 6.5)
        self.send("default", 475, 7.0)
        self.send("safety", 500, 0.0)
        self.advance(699)
        expected += [(475, 7.0), (500, 0.0)]
        self.expect(*expected)
        self.expect_active("navigation", "teleop", "navigation", "default", "safety")
        self.advance(700)
        self.expect(*expected, STOP)

    def test_a_sender_whose_clock_is_late(self):
        """Its input is live while its commands arrive, also after a sender with a good clock."""
        self.send("teleop", 0, 1.0)
        self.advance(1000)
        self.expect((0, 1.0), STOP)
        arrivals = range(1000, 2600, 199)
        for arrival in arrivals:
            self.send("teleop", arrival - 600, 1.0, arrival)
            self.send("navigation", arrival, 2.0)
        self.advance(arrivals[-1] + 200)
        late = [(arrival - 600, 1.0) for arrival in arrivals]
        self.expect((0, 1.0), STOP, *late, STOP)
        self.expect_active("teleop", "idle", "teleop", "idle")

    def test_a_sender_whose_clock_is_early(self):
        """It takes over at once, without a stop, and holds the car longer."""
        self.send("navigation", 0, 1.0)
        self.send("teleop", 600, 2.0, arrival=10)
        self.expect_active("navigation", "teleop")
        self.send("navigation", 799, 3.0)
        self.advance(998)
        self.expect((0, 1.0), (600, 2.0))
        self.advance(999)
        self.expect((0, 1.0), (600, 2.0), STOP)
        self.expect_active("navigation", "teleop", "idle")


class TestMux(MuxTestCase):
    def setUp(self):
        super().setUp()
        self.use(MUX, rospy.Time.now().to_nsec())

    def tearDown(self):
        # The message on "active" can arrive before the stop.
        if self.output.messages:
            wait_for(lambda: self.output.last.drive.speed == 0.0, "the stop")

    def test_one_stop_when_the_last_live_input_times_out(self):
        self.send("teleop", 0, 2.0)
        self.expect((0, 2.0), STOP)
        expiry = self.output.messages[0].header.stamp + rospy.Duration.from_sec(COMMAND_TIMEOUT)
        self.assertGreaterEqual(rospy.Time.now(), expiry)
        self.expect_active("teleop", "idle")
        stop = self.output.last
        self.assertEqual(stop.drive.steering_angle, 0.0)
        self.assertEqual(stop.header.frame_id, "car/base_footprint")
        # There is no second stop.
        later = rospy.Time.now() + rospy.Duration(3 * COMMAND_TIMEOUT)
        wait_for(lambda: rospy.Time.now() > later, "time to pass")
        self.expect((0, 2.0), STOP)

    def test_messages_are_forwarded_as_they_are(self):
        msg = AckermannDriveStamped()  # the stamp is zero, as in the tutorial's listing
        msg.drive.speed, msg.drive.steering_angle, msg.drive.acceleration = 1.5, -0.25, 0.5
        self.inputs["navigation"].publish(msg)
        wait_for(lambda: self.output.last, "a command")
        got = self.output.messages[0]
        self.assertEqual(got.header.stamp, rospy.Time(0))
        self.assertEqual(got.drive, msg.drive)

    def test_commands_that_are_not_finite_do_not_pass(self):
        self.send("safety", 0, float("nan"))
        self.send("safety", 50, float("inf"))
        self.send("navigation", 100, 1.0)
        self.expect((100, 1.0), STOP)

    def test_a_late_subscriber_gets_the_active_input(self):
        late = Recording(f"{MUX}/active", String).connected()
        wait_for(lambda: late.last, "the latched name")
        self.assertEqual(late.last.data, "idle")

    def test_a_bad_configuration(self):
        entry = {"name": "a", "topic": "input/a", "timeout": 0.2, "priority": 1}
        rospy.set_param("/refused_0", {"subscribers": [entry]})
        message = "/refused_0: parameter ~publisher is not set; expected a topic"
        self.assert_refused(("ackermann_cmd_mux.py", [], message))
