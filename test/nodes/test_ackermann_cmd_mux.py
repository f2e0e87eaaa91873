"""Check the mux: priorities, timeouts, the stop, the active input, a wrong configuration."""

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from support.helpers import Recording, RosTestCase, node, publisher, wait_for
from support.messages import COMMAND_TIMEOUT, LEAD, MUX, at, command
from support.world import launch

INPUTS = ("safety", "teleop", "navigation", "default")

STOP = (None, 0.0)
"""The stop of the mux has no stamp."""


def start_world():
    return launch("sim.launch", map="none", laser=False, model=False)


class TestMux(RosTestCase):
    def setUp(self):
        super().setUp()
        self.use(MUX)

    def use(self, mux):
        """Connect to a mux, and wait until it is idle."""
        self.output = Recording(f"{mux}/output", AckermannDriveStamped).connected()
        # Only a new connection gets the latched message.
        self.active = self.ending(Recording(f"{mux}/active", String).connected())
        self.inputs = {
            name: publisher(f"{mux}/input/{name}", AckermannDriveStamped) for name in INPUTS
        }
        wait_for(lambda: self.active.last and self.active.last.data == "idle", "an idle mux")
        self.output.clear()
        self.begin = rospy.Time.now() + LEAD

    def tearDown(self):
        # The message on "active" can arrive before the stop.
        if self.output.messages:
            wait_for(lambda: self.output.last.drive.speed == 0.0, "the stop")

    def send(self, name, seconds, speed):
        """Send a command on an input, with a stamp `seconds` after the beginning of the test."""
        self.inputs[name].publish(command(at(self.begin, seconds), speed, 0.0))

    def wait_until(self, seconds):
        """Wait until `seconds` after the beginning of the test."""
        until = at(self.begin, seconds)
        wait_for(lambda: rospy.Time.now() >= until, "time to pass")

    def stamps(self):
        return {m.header.stamp for m in self.output.messages}

    def sent(self):
        """Return the output of the mux as (seconds, speed); seconds is None without a stamp."""
        return [
            (round((stamp - self.begin).to_sec(), 9) if stamp else None, m.drive.speed)
            for m in self.output.messages
            for stamp in [m.header.stamp]
        ]

    def expect(self, *commands):
        """Wait until the mux has passed these commands and no others."""
        wait_for(lambda: len(self.sent()) >= len(commands), f"{commands}, got {self.sent()}")
        self.assertEqual(self.sent(), list(commands))

    def test_priorities_and_timeouts(self):
        """The timeouts are 1 s, so that the commands arrive in time on a busy machine."""
        entries = ", ".join(
            f"{{name: {name}, topic: input/{name}, timeout: 1.0, priority: {-number}}}"
            for number, name in enumerate(INPUTS)
        )
        settings = ("__name:=patient", f"_subscribers:=[{entries}]", "_publisher:=output")
        with node("ackermann_cmd_mux.py", *settings):
            self.use("/patient")
            self.send("navigation", 0.0, 1.0)
            self.expect((0.0, 1.0))
            self.send("teleop", 0.25, 2.0)
            self.expect((0.0, 1.0), (0.25, 2.0))
            self.active.first(lambda msg: msg.data == "teleop", "teleop to drive")
            self.send("navigation", 0.5, 3.0)  # teleop is live
            self.wait_until(0.6)
            self.send("navigation", 1.24, 4.0)  # and still is
            self.send("navigation", 1.375, 4.5)  # and is when this arrives
            self.wait_until(1.25)
            self.send("navigation", 1.25, 5.0)  # and no longer is
            expected = [(0.0, 1.0), (0.25, 2.0), (1.25, 5.0)]
            self.expect(*expected)
            self.send("default", 1.5, 6.0)
            self.wait_until(1.6)
            self.send("default", 2.25, 6.5)
            self.wait_until(2.375)
            self.send("default", 2.375, 7.0)
            expected.append((2.375, 7.0))
            self.expect(*expected)
            self.send("safety", 2.5, 0.0)
            expected.append((2.5, 0.0))
            self.expect(*expected)
            self.active.first(lambda msg: msg.data == "safety", "safety to drive")
            self.expect(*expected, STOP)

    def test_one_stop_when_the_last_live_input_times_out(self):
        self.send("teleop", 0.0, 2.0)
        self.expect((0.0, 2.0), STOP)
        self.assertGreaterEqual(rospy.Time.now(), at(self.begin, COMMAND_TIMEOUT))
        wait_for(lambda: self.active.last.data == "idle", "an idle mux")
        stop = self.output.last
        self.assertEqual(stop.drive.steering_angle, 0.0)
        self.assertEqual(stop.header.frame_id, "car/base_footprint")
        # There is no second stop.
        later = rospy.Time.now() + rospy.Duration(3 * COMMAND_TIMEOUT)
        wait_for(lambda: rospy.Time.now() > later, "time to pass")
        self.expect((0.0, 2.0), STOP)

    def test_a_sender_whose_clock_is_late(self):
        """Its input is live while its commands arrive, also after a sender with a good clock."""
        self.send("teleop", 0.0, 1.0)
        later = at(self.begin, 1.0)
        wait_for(lambda: rospy.Time.now() > later, "time to pass")
        self.expect((0.0, 1.0), STOP)
        self.active.clear()
        self.output.clear()
        for _ in range(8):
            late = command(at(rospy.Time.now(), -0.6), 1.0, 0.0)
            self.inputs["teleop"].publish(late)
            wait_for(lambda s=late.header.stamp: s in self.stamps(), "the command to pass")
            self.inputs["navigation"].publish(command(rospy.Time.now(), 2.0, 0.0))
        wait_for(lambda: self.active.last.data == "idle", "an idle mux")
        self.assertEqual([m.data for m in self.active.messages], ["teleop", "idle"])
        self.assertEqual({m.drive.speed for m in self.output.messages[:-1]}, {1.0})

    def test_a_sender_whose_clock_is_early(self):
        """It takes over at once, without a stop, and holds the car longer."""
        self.send("navigation", -0.3, 1.0)
        self.expect((-0.3, 1.0))
        self.send("teleop", 0.3, 2.0)
        self.wait_until(0.2)
        self.send("navigation", 0.2, 3.0)
        self.expect((-0.3, 1.0), (0.3, 2.0), STOP)
        wait_for(lambda: self.active.last.data == "idle", "the mux to be idle")
        self.assertEqual(
            [m.data for m in self.active.messages[1:]], ["navigation", "teleop", "idle"]
        )

    def test_messages_are_forwarded_as_they_are(self):
        msg = AckermannDriveStamped()  # the stamp is zero, as in the tutorial's listing
        msg.drive.speed, msg.drive.steering_angle, msg.drive.acceleration = 1.5, -0.25, 0.5
        self.inputs["navigation"].publish(msg)
        wait_for(lambda: self.output.last, "a command")
        got = self.output.messages[0]
        self.assertEqual(got.header.stamp, rospy.Time(0))
        self.assertEqual(got.drive, msg.drive)

    def test_commands_that_are_not_finite_do_not_pass(self):
        self.send("safety", 0.0, float("nan"))
        self.send("safety", 0.05, float("inf"))
        self.send("navigation", 0.1, 1.0)
        self.expect((0.1, 1.0), STOP)

    def test_a_late_subscriber_gets_the_active_input(self):
        late = Recording(f"{MUX}/active", String).connected()
        wait_for(lambda: late.last, "the latched name")
        self.assertEqual(late.last.data, "idle")

    def test_a_bad_configuration(self):
        entry = {"name": "a", "topic": "input/a", "timeout": 0.2, "priority": 1}
        rospy.set_param("/refused_0", {"subscribers": [entry]})
        message = "/refused_0: parameter ~publisher is not set; expected a topic"
        self.assert_refused(("ackermann_cmd_mux.py", [], message))
