"""Check the simulated car: events at their stamps, refusals, and reports that agree."""

import math
import random
import socket
from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import rospy
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros import connections, ros_time, rospy_fixes
from mushr_ros_intro.ros.connections import registered_nodes, wait_until_connected
from mushr_ros_intro.ros.node import full_name
from mushr_ros_intro.simulator import sim_clock
from mushr_ros_intro.simulator.car_parameters import simulated_car_parameters
from mushr_ros_intro.simulator.car_sim import CarSim
from support.geometry import POSITION_TOLERANCE, closed_form, planar, yaw_of
from support.ghost import Ghost
from support.helpers import PATIENCE, Recording, RosTestCase, node, publisher, wait_for
from support.messages import at, command, placement

ROWS = [(2.0, 0.3), (1.0, -0.2), (-1.5, 0.25), (3.0, 0.0), (0.5, 1.2), (2.5, -0.1)]
"""[m/s, rad] One command every 0.1 s."""

PERIOD = 0.02
"""[s] Between two reports of the car."""


def start_world():
    rospy_fixes.write_at_once()  # otherwise rospy drops reports that follow one another at once
    return []


class TimedCar(CarSim):
    """The car in this process, at an instant that the test sets."""

    now = rospy.Time(1_700_000_000)
    received = 0
    """The number of messages."""

    def on_message(self, *arguments):
        super().on_message(*arguments)
        self.received += 1

    def report(self):
        """Report the state at this instant, as FollowedClock does."""
        with self._changed:
            self._report([self.clock.read()])


class TestCarSim(RosTestCase):
    """Wall-clock time is an input of these tests, but for nodes that are processes."""

    @classmethod
    def setUpClass(cls):
        patch = mock.patch.object(ros_time, "now", lambda: TimedCar.now.to_nsec())
        patch.start()
        cls.addClassCleanup(patch.stop)
        parameters = Parameters({"frame_prefix": "car/"})
        cls.car = TimedCar(parameters.read(TimedCar.PARAMETERS))

    def setUp(self):
        super().setUp()
        self.poses = Recording("car_pose", PoseStamped).connected()
        self.commands = publisher("mux/ackermann_cmd_mux/output", AckermannDriveStamped)
        self.placements = publisher("initialpose", PoseWithCovarianceStamped)

    def send(self, *messages):
        """Send commands and initial poses, and wait until the car has received each of them."""
        for message in messages:
            is_command = isinstance(message, AckermannDriveStamped)
            before = self.car.received
            (self.commands if is_command else self.placements).publish(message)
            wait_for(lambda n=before: self.car.received > n, "the car to receive a message")

    def advance(self, seconds, *recordings):
        """Advance the time [s]; return the last pose that the car reports.

        Also wait until all reports have arrived at other recordings.
        """
        for _ in range(round(seconds / PERIOD)):
            TimedCar.now = at(TimedCar.now, PERIOD)
            self.car.report()
        last = [
            each.first(lambda m: m.header.stamp == TimedCar.now, "the last report")
            for each in (self.poses, *recordings)
        ]
        return planar(last[0].pose)

    def assert_rests(self, pose):
        """Fail unless the car stands at a pose, longer than it obeys a command."""
        for seconds in (PERIOD, 0.3):
            self.assert_pose(self.advance(seconds), pose)

    def place(self, *pose):
        """Place the car at (x, y, theta)."""
        self.send(placement(TimedCar.now, *pose))
        self.assert_pose(self.advance(PERIOD), pose)

    def drive(self, order):
        """Send ROWS in some order, with stamps 0.1 s apart; drive until the last one expires."""
        begin = at(TimedCar.now, 0.1)
        self.send(*(command(at(begin, 0.1 * index), *ROWS[index]) for index in order))
        return self.advance(0.1 * len(ROWS) + 0.2)

    def start_mux(self):
        topic = "/late/mux/ackermann_cmd_mux/output"
        self.ending(Ghost(publishes=[topic]))  # as a node that was killed
        self.addCleanup(publisher(topic, AckermannDriveStamped).unregister)

    def start_map(self):
        self.ending(node("map_server.py", "__ns:=/late", "_map_file:=sandbox"))
        maps = Recording("/late/map", OccupancyGrid)
        wait_for(lambda: maps.last, "the map")

    def check_ready(self, first, second):
        """Check that a car that expects a map is ready only after both steps."""
        arguments = ("__ns:=/late", "/map:=/late/map", "_x:=3", "_profile:=mine")
        with node("car_sim.py", *arguments, "_expects_map:=true") as car:
            poses = Recording("/late/car_pose", PoseStamped).connected()
            start = wait_for(lambda: poses.messages, "the start pose")[0]
            self.assert_pose(planar(start.pose), (3.0, 0.0, 0.0))
            first()
            poses.after(rospy.Time.now() + rospy.Duration(0.5))
            self.assertNotIn("ready", car.output)
            second()
            wait_for(lambda: "ready" in car.output, "the car to be ready")
        line = "ready: the car is at (3.0000 m, 0.0000 m, 0.0000 rad). To drive a plan, type in "
        self.assertIn(line, car.output)
        self.assertIn("path_publisher.py __ns:=late _car_name:=late _plan_file:=", car.output)
        self.assertIn("car mine: ideal; ", car.output)
        self.assertIn("pose rate 50 Hz; time: wall-clock\n", car.output)

    def test_ready_with_map(self):
        self.check_ready(self.start_mux, self.start_map)

    def test_ready_with_mux(self):
        self.check_ready(self.start_map, self.start_mux)

    def test_in_order_late_twice_and_out_of_order(self):
        rows = [(speed, angle, 0.1) for speed, angle in ROWS[:-1]] + [(*ROWS[-1], 0.2)]
        expected = closed_form((0.0, 0.0, 0.0), rows)
        in_order = list(range(len(ROWS)))
        shuffled = in_order * 2
        random.Random(1).shuffle(shuffled)
        for order in (in_order, in_order[::-1], shuffled):
            self.place(0.0, 0.0, 0.0)
            self.assert_pose(self.drive(order), expected)
            self.assert_rests(expected)

    def test_drawings(self):
        """Placing the car removes the driven path; the predicted path belongs to path_publisher."""
        paths = Recording("driven_path", Path).connected()
        publishers = registered_nodes("/predicted_path", "publishers")
        self.assertNotIn(rospy.get_name(), publishers)
        self.place(3.0, 2.0, 0.0)
        end = self.drive(range(len(ROWS)))

        def drawn():
            poses = [planar(each.pose) for each in paths.last.poses]
            return poses if math.dist(poses[-1][:2], end[:2]) < 0.1 else None

        poses = wait_for(drawn, "the driven path up to the car")
        self.assertEqual(paths.last.header.frame_id, "map")
        self.assertEqual(poses[0][:2], (3.0, 2.0))
        stamps = [each.header.stamp for each in paths.last.poses]
        self.assertEqual(stamps, sorted(stamps))
        for one, other in zip(poses, poses[1:]):
            distance = math.dist(one[:2], other[:2])
            self.assertTrue(0.1 <= distance < 0.1 + 3.0 * PERIOD + POSITION_TOLERANCE)
        late = self.ending(Recording("driven_path", Path))  # the topic is latched
        wait_for(
            lambda: late.last and len(late.last.poses) == len(poses), "the path, received late"
        )
        self.place(3.0, 2.0, 0.0)
        wait_for(lambda: len(paths.last.poses) == 1, "the path to begin anew")

    def test_reports_agree(self):
        odometry = Recording("odom", Odometry).connected()
        joint_states = Recording("joint_states", JointState).connected()
        transforms = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(transforms)
        there = ("map", "car/base_footprint", rospy.Time(0))
        wait_for(
            lambda: self.advance(PERIOD) and transforms.can_transform(*there), "the transforms"
        )
        self.place(3.0, -1.0, 2.5)
        speed, angle = 1.5, 0.3
        begin = at(TimedCar.now, 0.1)
        self.send(*(command(at(begin, 0.1 * index), speed, angle) for index in range(6)))
        self.advance(1.0, odometry, joint_states)
        driving = [m for m in odometry.messages if begin < m.header.stamp < at(begin, 0.7)]
        self.assertEqual(len(driving), 34)
        for one, other in zip(driving, driving[1:]):
            self.assertEqual(one.header.frame_id, "car/odom")
            self.assertEqual(one.child_frame_id, "car/base_footprint")
            expected = closed_form(planar(one.pose.pose), [(speed, angle, PERIOD)])
            self.assert_pose(planar(other.pose.pose), expected)

        poses = {m.header.stamp: m.pose for m in self.poses.messages}
        joints = {m.header.stamp for m in joint_states.messages}
        for msg in driving:
            stamp = msg.header.stamp
            for frame, wanted in (("map", poses[stamp]), ("car/odom", msg.pose.pose)):
                found = transforms.lookup_transform(
                    frame, "car/base_footprint", stamp, rospy.Duration(PATIENCE)
                ).transform
                got = (found.translation.x, found.translation.y, yaw_of(found.rotation))
                self.assert_pose(got, planar(wanted))
            self.assertIn(stamp, joints)
        listener.unregister()

    def test_connections_are_requested_again(self):
        """The publisher and the subscriber repeat the calls that rospy sometimes omits."""
        told = rospy.Publisher("/told", Empty, queue_size=1)
        ghost = self.ending(Ghost(subscribes=["/told"]))
        self.check_requests(told, "subscribers", ghost, "publisherUpdate", 1)
        for call in ghost.calls["publisherUpdate"]:
            self.assertEqual(call, [told.resolved_name, [rospy.get_node_uri()]])

        asks = rospy.Subscriber("/asks", Empty)
        ghost = self.ending(Ghost(publishes=["/asks"]))
        wait_for(lambda: ghost.calls["requestTopic"], "the first request")
        self.check_requests(asks, "publishers", ghost, "requestTopic", 2)

    def check_requests(self, end, role, ghost, method, number):
        """Check that a wait for a ghost ends only when the ghost dies, after a number of calls."""
        with ThreadPoolExecutor() as pool:
            connected = pool.submit(wait_until_connected, end, role, PATIENCE)
            wait_for(lambda: len(ghost.calls[method]) >= number, f"calls of {method}")
            self.assertFalse(connected.done())
            ghost.die()
            self.assertTrue(connected.result())

    def test_a_publisher_that_does_not_answer(self):
        """The connection does not count, although rospy counts it; the wait ends."""
        for topic, silence in (("/begun", 0.0), ("/silent", 60.0)):
            with socket.create_server(("127.0.0.1", 0)) as server:
                port = server.getsockname()[1]
                self.ending(Ghost(publishes=[topic], port=port, silence=silence))
                begun = rospy.Subscriber(topic, Empty)
                wait_for(begun.get_num_connections, "the subscriber to connect")
                self.assertFalse(wait_until_connected(begun, "publishers", seconds=1.0))
        there = rospy.Subscriber("/car_pose", PoseStamped)
        self.assertTrue(wait_until_connected(there, "publishers"))

    def test_a_node_that_died_without_unregistering(self):
        """Its parameters count until then; publishers do not wait for one that is suspended."""
        left = rospy.Publisher("/left", Empty, queue_size=1)
        ghost = self.ending(Ghost(subscribes=["/left"], name="/left/car_sim"))
        rospy.set_param("/left/car_sim", {"wheelbase": 0.4})

        def wheelbase():
            return car_from(simulated_car_parameters("left", must_run=True)).wheelbase

        self.assertFalse(wait_until_connected(left, "subscribers", seconds=1.0))
        ghost.suspend()
        with mock.patch.object(connections, "_PING_TIMEOUT", 0.1):
            self.assertTrue(wait_until_connected(left, "subscribers"))
            self.assertEqual(wheelbase(), 0.4)
        ghost.die()
        self.assertTrue(wait_until_connected(left, "subscribers"))
        self.assertEqual(wheelbase(), 0.33)

    def test_whether_the_car_publishes_the_clock(self):
        """It does if time is simulated and no node that runs publishes /clock."""
        has_to_publish_it = sim_clock.has_to_publish_clock
        self.assertFalse(has_to_publish_it())
        self.addCleanup(rospy.delete_param, "/use_sim_time")
        rospy.set_param("/use_sim_time", True)
        self.assertTrue(has_to_publish_it())
        replaced = self.ending(Ghost(publishes=["/clock"], name=full_name("car_sim")))
        self.assertTrue(has_to_publish_it())
        replaced.die()
        ghost = self.ending(Ghost(publishes=["/clock"]))
        self.assertFalse(has_to_publish_it())
        ghost.suspend()
        with mock.patch.object(connections, "_PING_TIMEOUT", 0.1):
            self.assertFalse(has_to_publish_it())
        ghost.die()
        self.assertTrue(has_to_publish_it())
        rospy.set_param("/use_sim_time", False)
        self.assertFalse(has_to_publish_it())
