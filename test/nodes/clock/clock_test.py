#!/usr/bin/python3
"""Check the clock that the car keeps, at whatever factor it runs."""

import math
import os
import re
import shutil
import signal
import tempfile
import time
import unittest

import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock, Log
from std_srvs.srv import Trigger

from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.sim.stamps import from_seconds
from support.helpers import (
    ANGLE_TOLERANCE,
    POSITION_TOLERANCE,
    Process,
    Recording,
    angle_between,
    closed_form,
    kill,
    node,
    planar,
    publisher,
    wait_for,
    wait_for_recorder,
)

COMMANDS = "/car/mux/ackermann_cmd_mux/input/navigation"
OUTPUT = "/car/mux/ackermann_cmd_mux/output"
POSE_PERIOD = 20_000_000
"""[ns]"""
PATIENCE = 60.0
"""[s] For simulated time to pass; the clock's own patience is 5 s."""
ROWS = [(1.0, 0.2, 0.25), (-1.0, 0.1, 0.3)]


class TestClock(unittest.TestCase):
    def setUp(self):
        self.factor = rospy.get_param("/car/car_sim/real_time_factor")
        for name in ("pause", "resume", "step", "reset"):
            rospy.wait_for_service(f"/car/car_sim/{name}", PATIENCE)
            setattr(self, name, rospy.ServiceProxy(f"/car/car_sim/{name}", Trigger))
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.commands = Recording(COMMANDS, AckermannDriveStamped)
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)
        self.addCleanup(self.resume)

    def plan(self, *rows):
        path = os.path.join(self.folder, "plan.txt")
        with open(path, "w") as file:
            file.write("\n".join(", ".join(map(str, row)) for row in ((0.0, 0.0, 0.0), *rows)))
        return path

    def runs_on(self, seconds, what):
        """Wait until `seconds` of simulated time have passed; return how long that took."""
        begin, wall = rospy.Time.now(), time.monotonic()
        end = begin + rospy.Duration.from_sec(seconds)
        self.poses.after(end, PATIENCE)
        elapsed = time.monotonic() - wall
        print(f"factor {self.factor:g}, {what}: {seconds:g} s took {elapsed:.2f} s")
        return elapsed

    def waits(self):
        """Wait until the clock has stood for half a second."""
        seen = []

        def stands():
            last = self.poses.last.header.stamp
            if not seen or seen[-1][0] != last:
                seen.append((last, time.monotonic()))
            return time.monotonic() > seen[-1][1] + 0.5

        wait_for(stands, "the clock to wait for the client")

    def assert_at(self, got, expected):
        if self.factor > 1.0:
            return  # a message that is late by 0.1 s on a busy machine is 1 s late on this clock
        self.assertLess(math.hypot(got[0] - expected[0], got[1] - expected[1]), POSITION_TOLERANCE)
        self.assertLess(angle_between(got[2], expected[2]), ANGLE_TOLERANCE)

    def stamps(self):
        return [m.header.stamp.to_nsec() for m in self.poses.messages]

    def test_every_pose_once_and_in_time(self):
        """Also while somebody is connected who never sends anything."""
        silent = publisher(COMMANDS, AckermannDriveStamped)
        self.addCleanup(silent.unregister)
        clock = Recording("/clock", Clock).connected()
        for connection in clock.subscriber.impl.connections:
            connection.protocol.queue_size = None  # rospy's own, which was there first, is one
        self.poses.clear()
        self.runs_on(1.0, "nothing drives")
        # Poses that came before /clock did are not among those of that second.
        wait_for(lambda: len(self.stamps()) > 50, "more than 50 poses", PATIENCE)
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
        self.assertAlmostEqual(now, held + 0.1, delta=1e-6)  # a double holds it to 2.4e-7 s
        wait_for(lambda: abs(self.poses.last.header.stamp.to_sec() - now) < 1e-6, "the last step")
        stamps = [stamp for stamp in self.stamps() if stamp > (held + 0.001) * 1e9]
        self.assertEqual(len(stamps), 5)
        self.assertAlmostEqual(float(self.pause().message.split()[0]), now, delta=1e-6)
        self.resume()
        self.runs_on(0.5, "resumed")

    def test_reset(self):
        odometry = Recording("/car/odom", Odometry).connected()
        with node("path_publisher.py", f"_plan_file:={self.plan(*ROWS)}") as driver:
            self.assertEqual(driver.wait(PATIENCE), 0, driver.output)
        self.assert_at(planar(self.poses.last.pose), closed_form((0.0, 0.0, 0.0), ROWS))
        answer = self.reset()
        self.assertTrue(answer.success)
        since = float(re.fullmatch("at the start pose since (.*) s", answer.message).group(1))
        then = rospy.Time.from_sec(since + 0.001)  # a double holds it to 2.4e-7 s
        reset = self.poses.after(then, PATIENCE)
        self.assertEqual(planar(reset.pose), (0.0, 0.0, 0.0))
        after = odometry.after(then, PATIENCE)
        self.assertEqual(planar(after.pose.pose), (0.0, 0.0, 0.0))
        stamps = self.stamps()
        self.assertEqual(stamps, sorted(stamps))

    def test_a_client_that_dies(self):
        """The car stops when the last command runs out, and the clock goes on."""
        obeyed = Recording(OUTPUT, AckermannDriveStamped).connected()
        said = Recording("/rosout", Log).connected()
        path = self.plan((1.0, 0.2, 600.0))
        with node("path_publisher.py", f"_plan_file:={path}", "__name:=killed") as driver:
            wait_for(lambda: len(obeyed.messages) >= 5, "five commands", PATIENCE)
            kill("/killed", driver.pid)
            driver.wait()
        self.runs_on(1.0, "after the client died")
        warning = "no command arrived within 5 s of wall-clock time"
        wait_for(lambda: any(warning in m.msg for m in said.messages), "a warning")
        messages = [m for m in obeyed.messages if m.drive.speed]
        seconds = (messages[-1].header.stamp - messages[0].header.stamp).to_sec() + 0.2
        pose = self.poses.pose_at_rest(messages[-1].header.stamp + rospy.Duration(0.3), PATIENCE)
        self.assert_at(pose, closed_form((0.0, 0.0, 0.0), [(1.0, 0.2, seconds)]))

    def test_a_client_that_stands_still(self):
        """The clock goes on without it, and it gives its plan up when it comes back."""
        path = self.plan((1.0, 0.2, 600.0))
        with node("path_publisher.py", f"_plan_file:={path}") as driver:
            wait_for(lambda: len(self.commands.messages) >= 5, "five commands", PATIENCE)
            driver.send_signal(signal.SIGSTOP)
            self.waits()  # all that was under way is here
            self.runs_on(2.0, "while the client stood still")
            driver.send_signal(signal.SIGCONT)
            self.assertEqual(driver.wait(PATIENCE), 1, driver.output)
            self.assertIn("was suspended", driver.output)
        self.runs_on(0.5, "after its stop")

    def test_a_recorder_that_stands_still(self):
        """What counts is when the car got a command, not when the recorder did."""
        rows = ((1.0, 0.2, 3.5), (-1.0, 0.1, 4.25), (0.5, 0.0, 3.0))
        expected = [(*row[:2], from_seconds(row[2])) for row in rows]
        obeyed = Recording(OUTPUT, AckermannDriveStamped).connected()
        path = self.plan(*rows)
        with node("plan_recorder.py", f"_folder:={self.folder}") as recorder:
            rospy.wait_for_service("/plan_recorder/save", PATIENCE)
            save = rospy.ServiceProxy("/plan_recorder/save", Trigger)
            wait_for_recorder("/plan_recorder")
            with node("path_publisher.py", f"_plan_file:={path}") as driver:
                wait_for(lambda: obeyed.messages, "a command", PATIENCE)
                recorder.send_signal(signal.SIGSTOP)
                self.assertEqual(driver.wait(PATIENCE), 0, driver.output)
            recorder.send_signal(signal.SIGCONT)

            def recorded():
                answer = save()
                if not answer.success:
                    return None
                saved = answer.message.split("saved ")[-1].split(";")[0]
                with open(saved, "rb") as file:
                    return [row[:3] for row in parse_plan(file.read(), saved).rows]

            wait_for(lambda: recorded() == expected, "the plan to be recorded as it was")


class TestFactors(unittest.TestCase):
    """The clock at other factors, all at the same time; those runs have two tests to do."""

    runs = {}
    folder = None

    @classmethod
    def begin(cls):
        if rospy.get_param("/car/car_sim/real_time_factor") != 0:
            return
        cls.folder = tempfile.mkdtemp()
        cls.runs = {
            factor: Process(
                "rostest",
                "mushr_ros_intro",
                "clock.test",
                f"real_time_factor:={factor}",
                ROS_TEST_RESULTS_DIR=os.path.join(cls.folder, str(factor)),
            )
            for factor in (0.5, 1.0, 10.0)
        }

    @classmethod
    def tearDownClass(cls):
        for run in cls.runs.values():
            run.end()
        if cls.folder:
            shutil.rmtree(cls.folder)

    def test_other_factors(self):
        for factor, run in self.runs.items():
            status = run.wait(150.0)
            self.assertEqual(status, 0, f"factor {factor:g}: {run.output}")


class AllTests(unittest.TestSuite):
    def __init__(self):
        loader = unittest.TestLoader()
        if rospy.get_param("/car/car_sim/real_time_factor") != 0:
            names = ("test_every_pose_once_and_in_time", "test_pause_and_step")
            super().__init__(map(TestClock, names))
        else:
            super().__init__(map(loader.loadTestsFromTestCase, (TestClock, TestFactors)))


if __name__ == "__main__":
    rospy.init_node("clock_test")
    TestFactors.begin()
    rostest.rosrun("mushr_ros_intro", "clock", "__main__.AllTests")
