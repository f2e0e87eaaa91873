"""Check the simulated clock that the car publishes, at any real-time factor."""

import re

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock, Log
from std_srvs.srv import Trigger

from support.geometry import closed_form, planar
from support.helpers import (
    Recording,
    RosTestCase,
    driver,
    kill,
    publisher,
    wait_for,
)
from support.messages import NAVIGATION, OUTPUT, at
from support.world import LOCK_STEP, launch

POSE_PERIOD = 20_000_000
"""[ns]"""
ROWS = [(1.0, 0.2, 0.25), (-1.0, 0.1, 0.3)]


def start_world():
    return launch("sim.launch", **LOCK_STEP, map="none", laser=False, model=False, watched=False)


class AnyFactor:
    """The clock at any real-time factor."""

    def setUp(self):
        super().setUp()
        for name in ("pause", "resume", "step", "reset"):
            rospy.wait_for_service(f"/car/car_sim/{name}")
            setattr(self, name, rospy.ServiceProxy(f"/car/car_sim/{name}", Trigger))
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.commands = Recording(NAVIGATION, AckermannDriveStamped)
        self.addCleanup(self.resume)

    def plan_of(self, *rows):
        """Write a plan from the origin; return its path."""
        return self.plan("\n".join(", ".join(map(str, row)) for row in ((0.0, 0.0, 0.0), *rows)))

    def wait_for_clock(self, seconds):
        """Wait for some seconds of simulated time [s]."""
        self.poses.after(at(rospy.Time.now(), seconds))

    def stamps(self):
        return [m.header.stamp.to_nsec() for m in self.poses.messages]

    def test_every_pose_once_and_in_time(self):
        """The promise holds with a silent publisher of commands, too."""
        silent = publisher(NAVIGATION, AckermannDriveStamped)
        self.addCleanup(silent.unregister)
        clock = Recording("/clock", Clock).connected()
        for connection in clock.subscriber.impl.connections:
            connection.protocol.queue_size = None  # otherwise it is 1, as in rospy's own subscriber
        clock.clear()
        self.poses.clear()
        self.wait_for_clock(1.0)
        # Wait for some more poses: the first ones can be older than the first message on /clock.
        wait_for(lambda: len(self.stamps()) > 50, "more than 50 poses")
        stamps = self.stamps()
        steps = {later - earlier for earlier, later in zip(stamps, stamps[1:])}
        self.assertEqual(steps, {POSE_PERIOD})
        ticks = [m.clock.to_nsec() for m in clock.messages]
        steps = {later - earlier for earlier, later in zip(ticks, ticks[1:])}
        self.assertEqual(steps, {POSE_PERIOD})

    def test_pause_and_step(self):
        wait_for(lambda: self.poses.last, "a pose")
        answer = self.pause()
        self.assertTrue(answer.success)
        held = float(answer.message.split()[0])
        for _ in range(5):
            answer = self.step()
            self.assertTrue(answer.success)
        now = float(answer.message.split()[0])
        self.assertAlmostEqual(now, held + 0.1, delta=1e-6)  # a double rounds to 2.4e-7 s
        wait_for(lambda: abs(self.poses.last.header.stamp.to_sec() - now) < 1e-6, "the last step")
        stamps = [stamp for stamp in self.stamps() if stamp > (held + 0.001) * 1e9]
        self.assertEqual(len(stamps), 5)
        self.assertAlmostEqual(float(self.pause().message.split()[0]), now, delta=1e-6)
        self.resume()
        self.wait_for_clock(0.5)


class TestLockStep(AnyFactor, RosTestCase):
    """The clock in lock-step, at the factor 0."""

    def test_reset(self):
        odometry = Recording("/car/odom", Odometry).connected()
        self.drive_plan(self.plan_of(*ROWS))
        self.assert_pose(planar(self.poses.last.pose), closed_form((0.0, 0.0, 0.0), ROWS))
        answer = self.reset()
        self.assertTrue(answer.success)
        since = float(re.fullmatch("at the start pose since (.*) s", answer.message).group(1))
        then = rospy.Time.from_sec(since + 0.001)  # a double rounds to 2.4e-7 s
        reset = self.poses.after(then)
        self.assertEqual(planar(reset.pose), (0.0, 0.0, 0.0))
        after = odometry.after(then)
        self.assertEqual(planar(after.pose.pose), (0.0, 0.0, 0.0))
        stamps = self.stamps()
        self.assertEqual(stamps, sorted(stamps))

    def test_a_client_that_dies(self):
        """The car stops when the last command expires, and the clock goes on."""
        obeyed = Recording(OUTPUT, AckermannDriveStamped).connected()
        said = Recording("/rosout", Log).connected()
        path = self.plan_of((1.0, 0.2, 600.0))
        with driver(path, "__name:=killed") as process:
            wait_for(lambda: len(obeyed.messages) >= 5, "five commands")
            kill("/killed", process.pid)
            process.wait()
        self.wait_for_clock(1.0)
        warning = "no command arrived within 5 s of wall-clock time"
        wait_for(lambda: any(warning in m.msg for m in said.messages), "a warning")
        messages = [m for m in obeyed.messages if m.drive.speed]
        seconds = (messages[-1].header.stamp - messages[0].header.stamp).to_sec() + 0.2
        pose = self.poses.pose_at_rest(messages[-1].header.stamp + rospy.Duration(0.3))
        self.assert_pose(pose, closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)]))
