"""Check the car with other publishers, odd messages and a subscriber that never reads."""

import math
import signal
import socket
import time
import xmlrpc.client

import rosgraph.network
import rospy
from nav_msgs.msg import Odometry
from std_msgs.msg import String

from support.driven_car import LEAD, DrivenCarTestCase
from support.geometry import closed_form
from support.helpers import Recording, driver, wait_for
from support.messages import COMMAND_TIMEOUT, MUX, at, command, placement
from support.world import load

MAX_BEHIND = 50
"""The largest number of commands that the mux still has to pass; rospy drops none of them."""


def driven(messages, until):
    """Return the rows (speed, angle, seconds) that a car drives with these commands."""
    stamps = sorted({msg.header.stamp: msg.drive for msg in messages}.items())
    stamps = [(stamp, drive) for stamp, drive in stamps if stamp < until]
    ends = [stamp for stamp, _ in stamps[1:]] + [until]
    return [
        (drive.speed, drive.steering_angle, min((end - stamp).to_sec(), COMMAND_TIMEOUT))
        for (stamp, drive), end in zip(stamps, ends)
    ]


def start_world():
    load("ackermann_cmd_mux.yaml", MUX)
    return []


class DeafSubscriber:
    """A subscriber that never reads, like a suspended process."""

    def __init__(self, topic, kind):
        name = "/deaf" + topic.replace("/", "_")
        master = rosgraph.Master(name)
        publishers, _, _ = master.getSystemState()
        (sender,) = dict(publishers)[topic]
        self._node = xmlrpc.client.ServerProxy(master.lookupNode(sender))
        _, _, (_, host, port) = self._node.requestTopic(name, topic, [["TCPROS"]])
        self._topic, self._sent, self._since = topic, [], 0.0
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, 536)
        self._socket.connect((host, port))
        fields = {"callerid": name, "topic": topic, "type": kind._type, "md5sum": kind._md5sum}
        rosgraph.network.write_ros_handshake_header(self._socket, fields)

    def is_stuck(self):
        """Return whether the publisher has sent nothing for half a second."""
        _, _, (publications, _, _) = self._node.getBusStats("/deaf")
        sent = [each[2] for each in publications if each[0] == self._topic]
        if sent != self._sent:
            self._sent, self._since = sent, time.monotonic()
        return time.monotonic() > self._since + 0.5

    def close(self):
        self._socket.close()


class TestMessageFaults(DrivenCarTestCase):
    def test_other_publishers(self):
        """The car obeys what the mux passes, and the plan goes on after teleop."""
        path = self.plan("1,-1,0.5\n1.0,0.2,60\n")
        with driver(path) as plan:
            wait_for(lambda: len(self.output.messages) >= 5, "five commands")
            # Another publisher on the same input.
            begin = at(rospy.Time.now(), LEAD)
            for number in range(10):
                stamp = at(begin, 0.03 * number)
                self.inputs["navigation"].publish(command(stamp, -0.5, 0.1))
            wait_for(lambda: self.count(-0.5) == 10, "the mux to pass the other commands")
            # Teleop takes over for 0.4 s.
            begin = at(begin, 0.3)
            for number in range(3):
                self.inputs["teleop"].publish(command(at(begin, 0.1 * number), 0.5, -0.3))
            self.output.first(lambda msg: msg.drive.speed == 0.5, "teleop to drive")
            expires = at(begin, 0.2 + COMMAND_TIMEOUT)
            self.output.first(
                lambda msg: msg.drive.speed == 1.0 and msg.header.stamp >= expires,
                "the plan to drive again",
            )
            plan.send_signal(signal.SIGINT)
            self.assertEqual(plan.wait(), 1)
            self.assertNotIn("Traceback", plan.output)
        # The car has obeyed every command that the mux passed, at its stamp. While it drives, a
        # report may come before a late command.
        pose = self.poses.pose_at_rest(rospy.Time.now())
        rows = driven(self.output.messages, rospy.Time.now())
        self.assertLessEqual({1.0, -0.5, 0.5}, {row[0] for row in rows})
        self.assert_pose(pose, closed_form((1.0, -1.0, 0.5), rows))
        self.assert_recovered()

    def test_stops_with_an_old_stamp(self):
        """MuSHR sends them on `default`. One that arrives before a plan does not cancel it.

        Nor does the stop of the mux when the input `default` expires.
        """
        warnings = self.car.output.count("the stamp of a message")
        for stops, seconds in ((1, 0.0), (2, 0.1)):
            self.place(1.0, 2.0, 0.5)
            self.output.clear()
            begin = rospy.Time.now()
            self.inputs["default"].publish(command(at(begin, -30.0), 0.0, 0.0))
            wait_for(lambda n=stops: len(self.output.messages) >= n, "the mux to pass the stop")
            self.poses.after(rospy.Time.now())
            begin = at(begin, seconds)
            self.inputs["navigation"].publish(command(begin, 2.0, 0.3))
            pose = self.poses.pose_at_rest(at(begin, COMMAND_TIMEOUT))
            self.assert_pose(pose, closed_form((1.0, 2.0, 0.5), [(2.0, 0.3, COMMAND_TIMEOUT)]))
        self.assertEqual(self.car.output.count("the stamp of a message"), warnings)
        self.assert_recovered()

    def test_a_thousand_commands_a_second(self):
        """On a busy machine there are pauses, because the car ignores stamps older than 1 s."""
        self.place(0.0, 0.0, 0.0)
        stamp, sent = at(rospy.Time.now(), LEAD), []
        for number in range(900):
            wait_for(lambda: len(sent) - len(self.output.messages) < MAX_BEHIND, "the mux")
            wait_for(lambda stamp=stamp: rospy.Time.now() > at(stamp, -LEAD), "its time")
            if stamp < rospy.Time.now():
                stamp = at(rospy.Time.now(), LEAD)
            sent.append(command(stamp, 1.0 + number % 2, 0.2))
            self.inputs["navigation"].publish(sent[-1])
            stamp = at(stamp, 0.001)
        end = at(sent[-1].header.stamp, COMMAND_TIMEOUT)
        rows = driven(sent, end)
        self.assert_pose(self.poses.pose_at_rest(end), closed_form((0.0, 0.0, 0.0), rows))
        self.assert_recovered()

    def test_an_initial_pose_every_10_ms(self):
        """The last initial pose and the commands after it determine where the car stops."""
        begin = at(rospy.Time.now(), LEAD)
        for number in range(30):
            stamp = at(begin, 0.01 * number)
            self.placements.publish(placement(stamp, 0.1 * number, 3.0, 0.0))
            self.inputs["navigation"].publish(command(stamp, 1.0, 0.0))
        pose = self.poses.pose_at_rest(at(stamp, COMMAND_TIMEOUT))
        self.assert_pose(pose, (2.9 + COMMAND_TIMEOUT, 3.0, 0.0))
        self.assert_recovered()

    def test_messages_of_a_wrong_type(self):
        """They do not arrive, the nodes log an error, and the car still drives."""
        self.active.clear()
        sender = rospy.Publisher(f"{MUX}/input/safety", String, queue_size=1)
        receiver = Recording("/car/joint_states", String)
        wait_for(
            lambda: "topic types do not match" in self.car.output, "the report of the wrong type"
        )
        self.assertIn("/car/joint_states", self.car.output)
        sender.publish(String(data="stop"))
        self.assert_recovered()
        self.assertEqual(receiver.messages, [])
        self.assertNotIn("safety", [msg.data for msg in self.active.messages])
        self.assertIn("navigation", [msg.data for msg in self.active.messages])
        sender.unregister()
        receiver.subscriber.unregister()

    def test_a_publisher_whose_clock_is_far_off(self):
        """The car applies each command on arrival, and logs a warning."""
        for offset in (10.0, -10.0, 1000.0, -1000.0):
            self.place(1.0, -1.0, 0.5, offset=offset)
            begin = rospy.Time.now()
            for number in range(5):
                due = at(begin, 0.1 * number)
                wait_for(lambda due=due: rospy.Time.now() >= due, "the next command to be due")
                self.inputs["navigation"].publish(command(at(due, offset), 1.0, 0.0))
            x, y, _ = self.poses.pose_at_rest(rospy.Time.now())
            # 0.6 m; on a busy machine, each command lasts longer or shorter.
            self.assertTrue(0.1 < math.hypot(x - 1.0, y + 1.0) < 1.5, (x, y))
        self.assertIn("the clocks of two machines differ", self.car.output)
        self.assert_recovered()


class TestDeafSubscriber(DrivenCarTestCase):
    def test_a_subscriber_that_never_reads(self):
        """It delays neither the car nor the end of the car."""
        deaf = DeafSubscriber("/car/odom", Odometry)
        self.addCleanup(deaf.close)
        wait_for(deaf.is_stuck, "its publisher to send no more")
        self.assert_recovered()
        for process in self.nodes:
            process.send_signal(signal.SIGINT)
        for process in self.nodes:
            self.assertEqual(process.wait(), 0)
            self.assertNotIn("Traceback", process.output)
