"""Check the topics and the services of MuSHR's simulator, without a prefix of the frames."""

import math

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped
from mushr_sim.srv import CarPose
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from tf2_msgs.msg import TFMessage
from vesc_msgs.msg import VescStateStamped

from mushr_ros_intro.ros.connections import registered_nodes
from support.geometry import planar
from support.helpers import PATIENCE, Recording, RosTestCase, publisher, wait_for
from support.messages import LEAD, OUTPUT, at, command
from support.world import launch

BESIDE_A_WALL = (8.75, 4.0, math.pi / 2)
"""Here the body of the car would be inside the yard's wall, which begins at x = 8.8 m."""


def start_world():
    return launch(
        "sim.launch",
        car="mushr_tx2",
        map="sandbox",
        laser=False,
        model=False,
        parameters=[("/car/car_sim/frame_prefix", "")],
        publish_map_to_odom=False,
        init_pose_topic="/mushr_sim/car/initialpose",
        collision="point",
        mushr_interface=True,
    )


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
        msg = wait_for(lambda: transforms.last, "transforms")
        frames = [(each.header.frame_id, each.child_frame_id) for each in msg.transforms]
        self.assertEqual(frames, [("odom", "base_footprint")])

    def test_a_drive(self):
        """Speed and steering angle are those of the car, within its limits."""
        self.assertTrue(self.reposition("car", 1.0, 2.0, 0.0).success)
        odometry = Recording("/mushr_sim/car/odom", Odometry).connected()
        motor = Recording("/car/vesc/sensors/core", VescStateStamped).connected()
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
        self.assert_rates_are_those_of_the_angles(joints.messages)
        limit = 0.2472  # of mushr_tx2, to the left
        self.assertAlmostEqual(min(each.data for each in servo.messages), 0.5304 - 1.2135 * limit)

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
