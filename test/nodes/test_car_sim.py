"""Check the simulated car: events at their stamps, refusals, and reports that agree."""

import itertools
import math
import random
import socket

import rospy
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty

from mushr_ros_intro.ros.connections import registered_nodes, wait_until_connected
from mushr_ros_intro.simulator import sim_clock
from support.geometry import POSITION_TOLERANCE, closed_form, planar, yaw_of
from support.ghost import Ghost
from support.helpers import CarTestCase, Recording, node, publisher, wait_for
from support.messages import LEAD, at, command, placement
from support.world import launch

ROWS = [(2.0, 0.3), (1.0, -0.2), (-1.5, 0.25), (3.0, 0.0), (0.5, 1.2), (2.5, -0.1)]
"""[m/s, rad] One command every 0.1 s."""


def start_world():
    return launch("sim.launch", x=1.0, y=-2.0, theta=0.5, map="none", laser=False, model=False)


class TestCarSim(CarTestCase):
    def rest_after(self, stamp):
        return self.poses.pose_at_rest(at(stamp, 0.2))

    def drive(self, order):
        """Send ROWS in some order, with stamps 0.1 s apart; return the final pose."""
        begin = rospy.Time.now() + LEAD
        for index in order:
            self.commands.publish(command(at(begin, 0.1 * index), *ROWS[index]))
        return self.rest_after(at(begin, 0.1 * (len(ROWS) - 1)))

    def start_mux(self):
        topic = "/late/mux/ackermann_cmd_mux/output"
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
        self.assertIn("path_publisher.launch car_name:=late\n", car.output)
        self.assertIn("car mine: wheelbase 0.33 m; limits: none; ", car.output)
        self.assertIn("; pose rate 50 Hz; time: wall-clock\n", car.output)

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
            self.place()
            self.assert_pose(self.drive(order), expected)

    def test_late_commands(self):
        self.place()
        begin = rospy.Time.now() + rospy.Duration(0.1)
        wait_for(lambda: rospy.Time.now() > at(begin, 0.4), "time to pass")
        # The car has already reported later poses, at rest. It has to compute them again.
        self.commands.publish(command(at(begin, 0.1), 2.0, 0.3))
        self.placements.publish(placement(begin, 5.0, 5.0, 1.0))
        wait_for(lambda: planar(self.poses.last.pose)[1] > 4.0, "the car to be placed")
        expected = closed_form((5.0, 5.0, 1.0), [(2.0, 0.3, 0.2)])
        self.assert_pose(self.rest_after(rospy.Time.now()), expected)

    def test_placed_while_driving(self):
        self.place()
        odometry = Recording("/car/odom", Odometry).connected()
        begin = rospy.Time.now() + LEAD
        for index in range(7):
            self.commands.publish(command(at(begin, 0.1 * index), 2.0, 0.1))
        self.placements.publish(placement(at(begin, 0.35), -3.0, 4.0, 2.0))
        # At rest from 0.35 s to the next command at 0.4 s.
        expected = closed_form((-3.0, 4.0, 2.0), [(2.0, 0.1, 0.4)])
        self.assert_pose(self.rest_after(at(begin, 0.6)), expected)
        messages = odometry.messages
        for one, other in zip(messages, messages[1:]):
            seconds = (other.header.stamp - one.header.stamp).to_sec()
            moved = math.dist(planar(one.pose.pose)[:2], planar(other.pose.pose)[:2])
            self.assertLessEqual(moved, 2.0 * seconds + POSITION_TOLERANCE, "odometry jumped")

    def test_drawings(self):
        """Placing the car removes the driven path; the predicted path belongs to path_publisher."""
        paths = Recording("/car/driven_path", Path).connected()
        publishers = registered_nodes("/car/predicted_path", "publishers")
        self.assertNotIn("/car/car_sim", publishers)
        self.place(3.0, 2.0, 0.0)
        self.drive(range(len(ROWS)))
        end = planar(self.poses.last.pose)

        def drawn():
            poses = [planar(each.pose) for each in paths.last.poses]
            return poses if math.dist(poses[-1][:2], end[:2]) < 0.1 else None

        poses = wait_for(drawn, "the driven path up to the car")
        self.assertEqual(paths.last.header.frame_id, "map")
        self.assertEqual(poses[0][:2], (3.0, 2.0))
        stamps = [each.header.stamp for each in paths.last.poses]
        self.assertEqual(stamps, sorted(stamps))
        # The report before is less than 0.1 m away. A busy machine skips reports.
        reports = [each.header.stamp for each in self.poses.messages]
        for one, other, stamp in zip(poses, poses[1:], stamps[1:]):
            since = stamp - max(each for each in reports if each < stamp)
            distance = math.dist(one[:2], other[:2])
            self.assertTrue(0.1 <= distance < 0.1 + 3.0 * since.to_sec() + POSITION_TOLERANCE)
        late = Recording("/car/driven_path", Path)  # the topic is latched
        wait_for(
            lambda: late.last and len(late.last.poses) == len(poses), "the path, received late"
        )
        self.place(3.0, 2.0, 0.0)
        wait_for(lambda: len(paths.last.poses) == 1, "the path to begin anew")

    def test_a_command_ends_at_its_timeout_or_at_an_initial_pose(self):
        self.place()
        begin = rospy.Time.now() + LEAD
        self.commands.publish(command(begin, 2.0, 0.4))
        expected = closed_form((0.0, 0.0, 0.0), [(2.0, 0.4, 0.2)])
        self.assert_pose(self.rest_after(begin), expected)
        begin = rospy.Time.now() + LEAD
        self.commands.publish(command(begin, 2.0, 0.0))
        self.placements.publish(placement(at(begin, 0.05), 7.0, 8.0, 0.0))
        self.assert_pose(self.rest_after(begin), (7.0, 8.0, 0.0))

    def test_stamps_that_mean_now(self):
        log = Recording("/rosout", Log).connected()
        for stamp in (rospy.Time(0), rospy.Time.now() + rospy.Duration(10.0)):
            self.place()
            self.commands.publish(command(stamp, 2.0, 0.0))
            wait_for(lambda: planar(self.poses.last.pose)[0] > 0.3, "the car to drive on")
            self.assert_pose(self.rest_after(rospy.Time.now()), (0.4, 0.0, 0.0))
        wait_for(lambda: any("two machines" in m.msg for m in log.messages), "a warning")

    def test_refuses_what_is_not_finite(self):
        log = Recording("/rosout", Log).connected()
        nan, infinity = float("nan"), float("inf")
        zero = placement(rospy.Time.now(), 9.0, 9.0, 0.0)
        zero.pose.pose.orientation.w = 0.0
        bad_placements = {
            "finite": placement(rospy.Time.now(), nan, 0.0, 0.0),
            "length": zero,
            "frame": placement(rospy.Time.now(), 9.0, 9.0, 0.0, frame="odom"),
            "far": placement(rospy.Time.now(), 1e30, 0.0, 0.0),
        }
        self.place(1.0, 2.0, 3.0)
        for word, msg in bad_placements.items():

            def warned(word=word, msg=msg):
                self.placements.publish(msg)  # again, because there is only one warning per second
                return any(word in m.msg for m in log.messages)

            wait_for(warned, f"a warning with the word {word}")
        self.assert_pose(self.poses.pose_at_rest(rospy.Time.now()), (1.0, 2.0, 3.0))
        for speed, angle in ((nan, 0.0), (1.0, infinity), (-infinity, nan)):
            self.commands.publish(command(rospy.Time.now(), speed, angle))
        self.assert_pose(self.rest_after(rospy.Time.now()), (1.0, 2.0, 3.0))

    def test_reports_agree(self):
        odometry = Recording("/car/odom", Odometry).connected()
        joints = Recording("/car/joint_states", JointState).connected()
        transforms = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(transforms)
        there = ("map", "car/base_footprint", rospy.Time(0))
        wait_for(lambda: transforms.can_transform(*there), "the transforms")
        self.place(3.0, -1.0, 2.5)
        speed, angle = 1.5, 0.3
        begin = rospy.Time.now() + LEAD
        for index in range(6):
            self.commands.publish(command(at(begin, 0.1 * index), speed, angle))
        self.rest_after(at(begin, 0.5))
        yaw_rate = speed * math.tan(angle) / 0.33

        driving = [m for m in odometry.messages if begin < m.header.stamp < at(begin, 0.7)]
        # If the first command is late, the car stands until then.
        driving = list(itertools.dropwhile(lambda m: not m.twist.twist.linear.x, driving))
        self.assertGreater(len(driving), 10)
        for one, other in zip(driving, driving[1:]):
            self.assertEqual(one.header.frame_id, "car/odom")
            self.assertEqual(one.child_frame_id, "car/base_footprint")
            self.assertAlmostEqual(one.twist.twist.linear.x, speed, delta=1e-6)
            self.assertAlmostEqual(one.twist.twist.angular.z, yaw_rate, delta=1e-6)
            self.assertEqual(one.twist.twist.linear.y, 0.0)
            seconds = (other.header.stamp - one.header.stamp).to_sec()
            expected = closed_form(planar(one.pose.pose), [(speed, angle, seconds)])
            self.assert_pose(planar(other.pose.pose), expected)

        # On a busy machine the car can skip reports.
        poses = {m.header.stamp: m.pose for m in self.poses.messages}
        joints = {m.header.stamp: m for m in joints.messages}
        complete = [m for m in driving if m.header.stamp in poses and m.header.stamp in joints]
        self.assertGreater(len(complete), 10)
        for msg in complete:
            stamp = msg.header.stamp
            pose = poses[stamp]
            for frame, wanted in (("map", pose), ("car/odom", msg.pose.pose)):
                found = transforms.lookup_transform(frame, "car/base_footprint", stamp).transform
                got = (found.translation.x, found.translation.y, yaw_of(found.rotation))
                self.assert_pose(got, planar(wanted))
            joint = joints[stamp]
            angles = dict(zip(joint.name, joint.position))
            # Ackermann: the cotangents of the front wheels' angles differ by track / wheelbase.
            left, right = angles["front_left_wheel_steer"], angles["front_right_wheel_steer"]
            self.assertAlmostEqual(1 / math.tan(right) - 1 / math.tan(left), 0.25 / 0.33, places=6)

        # The mean of the back wheels rolls as far as the middle of the rear axle drives.
        def rolled(msg):
            angles = dict(zip(msg.name, msg.position))
            return sum(angles[f"back_{side}_wheel_throttle"] for side in ("left", "right")) / 2

        first, last = (joints[msg.header.stamp] for msg in (complete[0], complete[-1]))
        seconds = (last.header.stamp - first.header.stamp).to_sec()
        turned = rolled(last) - rolled(first)
        self.assertAlmostEqual(turned * 0.0488, speed * seconds, places=6)
        listener.unregister()

    def test_connections_are_requested_again(self):
        """The publisher and the subscriber repeat the calls that rospy sometimes omits."""
        told = rospy.Publisher("/told", Empty, queue_size=1)
        ghost = self.ending(Ghost(subscribes=["/told"]))
        self.assertFalse(wait_until_connected(told, "subscribers", seconds=1.5))
        calls = wait_for(lambda: ghost.calls["publisherUpdate"], "a call of the subscriber")
        self.assertEqual(calls, [[told.resolved_name, [rospy.get_node_uri()]]] * len(calls))

        asks = rospy.Subscriber("/asks", Empty)
        ghost = self.ending(Ghost(publishes=["/asks"]))
        wait_for(lambda: len(ghost.calls["requestTopic"]) == 1, "the first request")
        self.assertFalse(wait_until_connected(asks, "publishers", seconds=1.5))
        wait_for(lambda: len(ghost.calls["requestTopic"]) >= 2, "another request")

    def test_a_publisher_that_does_not_answer(self):
        """The connection does not count, although rospy counts it; the wait ends."""
        for topic, silence in (("/begun", 0.0), ("/silent", 60.0)):
            with socket.create_server(("127.0.0.1", 0)) as server:
                port = server.getsockname()[1]
                self.ending(Ghost(publishes=[topic], port=port, silence=silence))
                begun = rospy.Subscriber(topic, Empty)
                wait_for(begun.get_num_connections, "the subscriber to connect")
                self.assertFalse(wait_until_connected(begun, "publishers", seconds=1.0))
        there = rospy.Subscriber("/car/car_pose", PoseStamped)
        self.assertTrue(wait_until_connected(there, "publishers"))

    def test_a_node_that_died_without_unregistering(self):
        """The master still lists it, but publishers do not wait for it."""
        left = rospy.Publisher("/left", Empty, queue_size=1)
        ghost = self.ending(Ghost(subscribes=["/left"]))
        self.assertFalse(wait_until_connected(left, "subscribers", seconds=1.0))
        ghost.die()
        self.assertTrue(wait_until_connected(left, "subscribers"))

    def test_whether_the_car_publishes_the_clock(self):
        """It does if time is simulated and no live node publishes /clock."""
        has_to_publish_it = sim_clock.has_to_publish_clock
        self.assertFalse(has_to_publish_it())
        self.addCleanup(rospy.delete_param, "/use_sim_time")
        rospy.set_param("/use_sim_time", True)
        self.assertTrue(has_to_publish_it())
        ghost = self.ending(Ghost(publishes=["/clock"]))
        self.assertFalse(has_to_publish_it())
        ghost.die()
        self.assertTrue(has_to_publish_it())
        rospy.set_param("/use_sim_time", False)
        self.assertFalse(has_to_publish_it())

    def test_bad_parameters(self):
        message = "parameter ~track is 'wide'; expected"
        self.assert_refused(("car_sim.py", ["_track:=wide"], message))
