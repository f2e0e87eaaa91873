"""Check the topics and warnings of the simulated car at walls."""

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Log

from support.geometry import POSITION_TOLERANCE, closed_form, planar
from support.helpers import Recording, RosTestCase, node, publisher, wait_for
from support.messages import LEAD, OUTPUT, at, command, placement
from support.world import launch

STOP = 49.4 - 0.38
"""[m] The x coordinate of a car that drives along x and stops at the sandbox's wall."""


def start_world():
    return launch("sim.launch", laser=False, model=False, watched=False)


class TestWalls(RosTestCase):
    def setUp(self):
        super().setUp()
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.commands = publisher(OUTPUT, AckermannDriveStamped)
        self.placements = publisher("/initialpose", PoseWithCovarianceStamped)
        self.collisions = Recording("/car/car_sim/collision", PoseArray).connected()
        self.addCleanup(self.collisions.end)  # so the next test gets the latched message, too
        self.log = Recording("/rosout", Log).connected()
        wait_for(lambda: self.collisions.last, "the latched collision")
        self.wait_for_walls()
        self.log.clear()

    def wait_for_walls(self):
        """Wait until the car has the map and refuses a pose in a wall."""

        def is_refused():
            self.placements.publish(placement(rospy.Time.now(), 49.9, 0.0, 0.0))
            return self.warnings("rejected")

        wait_for(is_refused, "the car to have the map")

    def warnings(self, word):
        return [m.msg for m in self.log.messages if m.level == Log.WARN and word in m.msg]

    def place(self, x, y, theta):
        """Place the car, and wait until it reports that pose."""
        stamp = rospy.Time.now()
        self.placements.publish(placement(stamp, x, y, theta))
        self.poses.shows((x, y, theta), stamp)
        wait_for(lambda: not self.collisions.last.poses, "no contact")

    def drive(self, speed, steering_angle, count):
        """Send `count` commands 0.1 s apart; return the first stamp and the final pose."""
        begin = rospy.Time.now() + LEAD
        for index in range(count):
            self.commands.publish(command(at(begin, 0.1 * index), speed, steering_angle))
        return begin, self.poses.pose_at_rest(at(begin, 0.1 * (count + 1)))

    def test_into_a_wall_and_away(self):
        self.place(48.5, 1.0, 0.0)
        self.collisions.clear()
        self.log.clear()
        begin, pose = self.drive(2.0, 0.0, 6)
        self.assert_pose(pose, (STOP, 1.0, 0.0))
        hit = at(begin, (STOP - 48.5) / 2.0)
        (msg,) = self.collisions.messages
        self.assertLess(abs((msg.header.stamp - hit).to_sec()), POSITION_TOLERANCE)
        self.assertEqual(msg.header.frame_id, "map")
        self.assert_pose(planar(msg.poses[0]), (STOP, 1.0, 0.0))
        warning = wait_for(lambda: self.warnings("hit a wall"), "the warning")
        self.assertIn("(49.0200 m, 1.0000 m, 0.0000 rad)", warning[0])

        # A late subscriber receives the contact, too.
        late = Recording("/car/car_sim/collision", PoseArray).connected()
        self.assertTrue(wait_for(lambda: late.last, "the latched contact").poses)

        # Another command towards the wall changes nothing; in reverse the car drives away.
        self.assert_pose(self.drive(1.0, 0.0, 2)[1], (STOP, 1.0, 0.0))
        self.assertEqual(len(self.collisions.messages), 1)
        _, pose = self.drive(-1.0, 0.3, 3)
        self.assert_pose(pose, closed_form((STOP, 1.0, 0.0), [(-1.0, 0.3, 0.4)]))
        wait_for(lambda: not self.collisions.last.poses, "the end of the contact")
        self.assertEqual(len(self.collisions.messages), 2)
        self.assertEqual(len(self.warnings("hit a wall")), 1)

    def test_another_map(self):
        """A map server that is started by hand replaces the one of sim.launch."""
        for name, wall in (("rooms", (2.0, 1.8)), ("sandbox", (49.9, 0.0))):

            def is_refused(wall=wall):
                self.placements.publish(placement(rospy.Time.now(), *wall, 0.0))
                return self.warnings(f"rejected the initial pose ({wall[0]:.4f} m")

            self.log.clear()
            with node("map_server.py", f"_map_file:={name}"):
                wait_for(is_refused, f"the car to have the map {name}")

    def test_off_the_map(self):
        self.log.clear()
        self.place(60.0, -70.0, 0.0)
        self.assert_pose(self.drive(2.0, 0.0, 2)[1], (60.6, -70.0, 0.0))
        self.assertEqual(len(wait_for(lambda: self.warnings("left the map"), "the warning")), 1)
        self.place(0.0, 0.0, 0.0)
