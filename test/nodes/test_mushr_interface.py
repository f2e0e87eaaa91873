"""Check the topics and the services of MuSHR's simulator, without a prefix of the frames."""

import math

import rosgraph
import rospy
import tf2_ros
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped
from mushr_sim.srv import CarPose
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage
from vesc_msgs.msg import VescStateStamped

from mushr_ros_intro.geometry import Pose, compose, inverse
from mushr_ros_intro.ros.connections import registered_nodes
from support.geometry import planar
from support.helpers import PATIENCE, Recording, RosTestCase, publisher, wait_for
from support.messages import LEAD, OUTPUT, at, command
from support.world import launch

LOOKAHEAD = 0.6
"""[m]"""

FOLLOWED = 0.03
"""[m, rad] A pure pursuit with this look-ahead approaches the line by a factor e in about 0.5 m."""

BESIDE_A_WALL = (8.75, 4.0, math.pi / 2)
"""Here the body of the car would be inside the yard's wall, which begins at x = 8.8 m."""


def start_world():
    """Start the simulator as courses do, but the clock waits for the commands of the controller."""
    return launch(
        "../underlay/mushr_sim/launch/teleop.launch",
        [("/use_sim_time", True), ("/car/car_sim/real_time_factor", 0.0)],
        car="mushr_tx2",
        map="sandbox",
        use_tf_prefix=False,
        fake_localization=False,
        initial_x="NaN",
        headless=True,
        racecar_version="racecar-uw-nano",
    )


class CourseNode:
    """Controls and localizes the car as the nodes of courses do: with TF.

    It is written in their form: relative topics, frames without a prefix, the parameters below
    vesc/, stamps of the present time, and one command per pose that it gets by polling TF.
    """

    def __init__(self):
        self._tf = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._tf)
        self._vesc = rosgraph.Master("/test").getParam("/car/vesc")
        self._commands = publisher(
            "/car/mux/ackermann_cmd_mux/input/navigation", AckermannDriveStamped
        )

    def end(self):
        self._listener.unregister()

    def pose(self, target, source):
        """Return the newest transform between two frames, as soon as there is one."""
        now = rospy.Time(0)
        wait_for(lambda: self._tf.can_transform(target, source, now), f"{source} in {target}")
        msg = self._tf.lookup_transform(target, source, now).transform
        heading = 2.0 * math.atan2(msg.rotation.z, msg.rotation.w)
        return Pose(msg.translation.x, msg.translation.y, heading)

    def follow_line(self, line, length):
        """Drive along a line, in the frame of the odometry, by pure pursuit, at 1 m/s."""
        rate = rospy.Rate(50)
        while not rospy.is_shutdown():
            local = compose(inverse(line), self.pose("odom", "base_footprint"))
            if local.x >= length:
                break
            ahead = math.atan2(-local.y, LOOKAHEAD) - local.theta
            angle = math.atan(2.0 * self._vesc["chassis_length"] * math.sin(ahead) / LOOKAHEAD)
            self._commands.publish(command(rospy.Time.now(), 1.0, angle))
            rate.sleep()
        self._commands.publish(command(rospy.Time.now(), 0.0, 0.0))
        return local


class TestMushrInterface(RosTestCase):
    def setUp(self):
        super().setUp()
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        rospy.wait_for_service("/mushr_sim/reposition", PATIENCE)
        self.reposition = rospy.ServiceProxy("/mushr_sim/reposition", CarPose)

    def test_the_service_places_the_car(self):
        before = rospy.Time.now()
        self.assertTrue(self.reposition("car", 1.0, -2.0, 0.5).success)
        self.poses.shows((1.0, -2.0, 0.5), before)
        self.assertTrue(self.reposition("car", *BESIDE_A_WALL).success)

    def test_the_service_gives_a_reason(self):
        log = Recording("/rosout", Log)
        wait_for(lambda: registered_nodes("/rosout", "subscribers"), "the log")
        for arguments, reason in (
            (("bus", 0, 0, 0), "there is no car 'bus'; expected 'car'"),
            (("car", math.nan, 0, 0), "is not finite"),
            (("car", 8.9, 4, 0), "would be inside a wall"),
        ):
            self.assertFalse(self.reposition(*arguments).success)
            wait_for(lambda r=reason: any(r in each.msg for each in log.messages), reason)

    def test_topics_place_the_car(self):
        msg = PoseStamped()
        msg.header.frame_id = "map"
        msg.pose.position.x, msg.pose.orientation.z = 3.0, 1.0
        publisher("/mushr_sim/reposition", PoseStamped).publish(msg)
        self.poses.shows((3.0, 0.0, math.pi), rospy.Time())
        point = PointStamped()
        point.header.frame_id = "/map"
        point.point.x = 4.0
        publisher("/clicked_point", PointStamped).publish(point)
        self.poses.shows((4.0, 0.0, 0.0), rospy.Time())

    def test_initialpose_belongs_to_the_particle_filter(self):
        self.assertEqual(registered_nodes("/initialpose", "subscribers"), [])

    def test_frames(self):
        transforms = Recording("/tf", TFMessage).connected()

        def frames():
            msgs = [each for msg in transforms.messages for each in msg.transforms]
            return {(each.header.frame_id, each.child_frame_id) for each in msgs}

        wheel = ("front_left_wheel_steer_link", "front_left_wheel_link")
        wait_for(lambda: {("odom", "base_footprint"), wheel} <= frames(), "transforms")
        self.assertEqual([each for each in frames() if "map" in each or "/" in "".join(each)], [])

    def test_a_drive(self):
        """Speed and steering angle are those of the car, within its limits."""
        self.assertTrue(self.reposition("car", 1.0, 2.0, 0.0).success)
        odometry = Recording("/mushr_sim/car/odom", Odometry).connected()
        motor = Recording("/car/vesc/sensors/core", VescStateStamped).connected()
        from_vesc = Recording("/car/vesc/odom", Odometry).connected()
        joints = Recording("/car/joint_states", JointState).connected()
        servo = Recording("/car/vesc/sensors/servo_position_command", Float64).connected()
        commands = publisher(OUTPUT, AckermannDriveStamped)
        begin = rospy.Time.now() + LEAD
        for number in range(7):
            commands.publish(command(at(begin, 0.1 * number), 1.0, 2.66))

        def both():
            """Return an odometry message after the commands, and the pose with its stamp."""
            poses = {each.header.stamp: each for each in self.poses.messages}
            late = [m for m in odometry.messages if m.header.stamp > at(begin, 0.6)]
            return next(((m, poses[m.header.stamp]) for m in late if m.header.stamp in poses), None)

        msg, pose = wait_for(both, "a pose and an odometry message of one instant")
        self.assertEqual((msg.header.frame_id, msg.child_frame_id), ("odom", "base_link"))
        self.assertEqual(planar(msg.pose.pose), planar(pose.pose))
        self.assertGreater(msg.pose.pose.position.x, 1.1)
        self.assertAlmostEqual(msg.twist.twist.linear.x, 1.0)
        self.assertAlmostEqual(max(each.state.speed for each in motor.messages), 4614.0)
        same = wait_for(
            lambda: next(
                (m for m in from_vesc.messages if m.header.stamp == msg.header.stamp), None
            ),
            "vesc/odom at this instant",
        )
        self.assertEqual((same.header.frame_id, same.child_frame_id), ("odom", "base_link"))
        self.assertAlmostEqual(same.twist.twist.linear.x, 1.0)
        self.assert_rates_are_those_of_the_angles(joints.messages)
        limit = 0.2472  # of mushr_tx2, to the left
        self.assertAlmostEqual(min(each.data for each in servo.messages), 0.5304 - 1.2135 * limit)

    def test_a_course(self):
        """A controller, and the frame of the scan for a particle filter."""
        self.assertTrue(self.reposition("car", -3.0, -1.0, 0.3).success)
        node = CourseNode()
        self.addCleanup(node.end)
        start = node.pose("odom", "base_footprint")
        before = rospy.Time.now()
        self.poses.shows((-3.0, -1.0, 0.3), before)
        # The line is 0.3 m to the left of the car.
        end = node.follow_line(compose(start, Pose(0.0, 0.3, 0.0)), 2.5)
        self.assertLess(abs(end.y), FOLLOWED)
        self.assertLess(abs(end.theta), FOLLOWED)
        scans = Recording("/car/scan", LaserScan).connected()
        scan = scans.after(rospy.Time.now())
        self.assertEqual(scan.header.frame_id, "laser_link")

    def assert_rates_are_those_of_the_angles(self, messages):
        """Fail unless the steering turns at the published rates from message to message."""
        rates = []
        for before, after in zip(messages, messages[1:]):
            if after.header.seq != before.header.seq + 1:
                continue  # a busy subscriber loses messages
            seconds = (after.header.stamp - before.header.stamp).to_sec()
            for joint in (4, 5):
                rates.append(after.velocity[joint])
                turned = after.position[joint] - before.position[joint]
                self.assertAlmostEqual(turned, rates[-1] * seconds)
        self.assertGreater(max(rates), 1.0)  # [rad/s]; the limit of this car is 3.2

    def test_lengths(self):
        """Those of the profile, not those of the launch file."""
        master = rosgraph.Master("/test")
        self.assertEqual(master.getParam("/car/vesc/chassis_length"), 0.3)
        self.assertEqual(master.getParam("/car/vesc/wheelbase"), 0.225)
        self.assertEqual(master.getParam("/car/vesc/speed_to_erpm_gain"), 4614.0)
