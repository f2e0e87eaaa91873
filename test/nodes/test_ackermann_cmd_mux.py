"""Check the mux: priorities, timeouts, the stop, the active input, a wrong configuration."""

import threading
from unittest import mock

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from rospy.impl.tcpros_base import TCPROSTransport
from std_msgs.msg import String

from mushr_ros_intro.simulator.ackermann_cmd_mux import MuxTopics
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


class TestMux(RosTestCase):
    """Instants count from the beginning of the test [ms]."""

    def setUp(self):
        super().setUp()
        self.begin = rospy.Time.now().to_nsec()
        self.output = Recording(f"{MUX}/output", AckermannDriveStamped).connected()
        # Only a new connection gets the latched message.
        self.active = self.ending(Recording(f"{MUX}/active", String).connected())
        self.inputs = {
            name: publisher(f"{MUX}/input/{name}", AckermannDriveStamped) for name in INPUTS
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

    def test_each_change_of_the_active_input_is_sent(self):
        """Although the thread that sends them runs late."""
        may_write, write = threading.Event(), TCPROSTransport.write_data
        topics = MuxTopics("/late", "output")
        active = self.ending(Recording("/late/active", String).connected())

        def write_late(transport, data):
            if transport.name == "/late/active":
                may_write.wait(PATIENCE)
            return write(transport, data)

        names = ["teleop", "idle", "teleop", "teleop", "idle", "teleop"]
        with mock.patch.object(TCPROSTransport, "write_data", write_late):
            for name in names:
                topics.announce(name)
            may_write.set()
            wait_for(lambda: len(active.messages) >= 6, "each change")
        expected = ["idle", "teleop", "idle", "teleop", "idle", "teleop"]
        self.assertEqual([m.data for m in active.messages], expected)

    def test_a_late_subscriber_gets_the_active_input(self):
        late = Recording(f"{MUX}/active", String).connected()
        wait_for(lambda: late.last, "the latched name")
        self.assertEqual(late.last.data, "idle")
