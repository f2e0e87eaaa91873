"""Repeat a drive; check that no pose drifts, no message is lost, and no memory grows.

Environment variables: SOAK_HOURS, the duration by the clock of the cars [h]; SOAK_WALL_CLOCK=1, to
drive two cars in wall-clock time, not one in lock-step; SOAK_POSE_RATE, of the first car [Hz];
SOAK_WEB=1, to start the browser view, too. For a week of simulated time, type in scripts/shell:
    SOAK_HOURS=168 SOAK_POSE_RATE=10 taskset -c 0 python3 -m pytest -s test/system/test_soak.py
Lock-step is faster on one core and with fewer poses.
"""

import bisect
import collections
import math
import os
import signal
import sys
import time
import unittest
import xmlrpc.client

import pytest
import rosgraph
import rosnode
import rospkg
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped

from mushr_ros_intro.plan.parse import read_plan
from support.geometry import angle_between, closed_form, float32, planar
from support.helpers import node, wait_for
from support.world import launch

pytestmark = pytest.mark.full

HOURS = float(os.environ.get("SOAK_HOURS", 0.05))
IN_WALL_CLOCK_TIME = bool(os.environ.get("SOAK_WALL_CLOCK"))
POSE_RATE = float(os.environ.get("SOAK_POSE_RATE", 50.0))
WITH_WEB = bool(os.environ.get("SOAK_WEB"))

PERIOD = 100_000_000
"""[ns] Between commands."""

HOLD = 200_000_000
"""[ns] The car obeys a command for this time, so the next one may be late by this time."""

HINDSIGHT = 1_000_000_000
"""[ns] A pose is judged this long after its stamp, and after a command with a later stamp."""

ROUNDING = 1e-9
"""[m, rad] The largest rounding error."""

GROWTH = 2.0
"""[MB] The largest growth of the memory of a process after the first minute."""

SETTLED = 60.0
"""[s] The duration of the first minute."""

SHOWN = 5


def start_world():
    shared = {"laser": False, "model": False, "use_sim_time": not IN_WALL_CLOCK_TIME}
    first = {"map": "none", "real_time_factor": 0, "web": WITH_WEB}
    rate = [("/car/car_sim/pose_rate", POSE_RATE)]
    started = launch("sim.launch", rate, **first, **shared)
    if IN_WALL_CLOCK_TIME:
        started += launch("sim.launch", car_name="car2", **shared)
    return started


class Drive:
    """A car that repeats a drive. Each message is checked on arrival."""

    def __init__(self, car, plan):
        self.car = car
        self.faults = []
        self.commands = self.passed = self.stops = self.poses = self.unsure = 0
        self.worst = 0.0
        self.lateness = 0.0
        self.over = False
        self.first = None
        self.newest = 0
        """Stamp of the newest command [ns]."""
        self._late = collections.deque(maxlen=100)
        self._unjudged = collections.deque()
        self._plan = plan
        self._laps = []  # when the first command of each lap is due [ns]
        self._read()
        mux = f"/{car}/mux/ackermann_cmd_mux"
        for topic, kind, take in (
            (f"{mux}/input/navigation", AckermannDriveStamped, self._on_command),
            (f"{mux}/output", AckermannDriveStamped, self._on_passed),
            (f"/{car}/car_pose", PoseStamped, self._on_pose),
        ):
            rospy.Subscriber(topic, kind, take, tcp_nodelay=True)

    def _read(self):
        """Store the time and the pose at the beginning of each row, and all commands."""
        self._begins, self._starts, self._told, begin = [], [tuple(self._plan.start)], [], 0
        for row in self._plan.rows:
            self._begins.append(begin)
            told = (float32(row.speed), float32(row.steering_angle))
            self._told += [(due, *told) for due in range(begin, begin + row.duration, PERIOD)]
            begin += row.duration
            driven = (row.speed, row.steering_angle, row.duration / 1e9)
            self._starts.append(closed_form(self._starts[-1], [driven]))
        self._told.append((begin, 0.0, 0.0))

    def _row_at(self, offset):
        return bisect.bisect_right(self._begins, offset) - 1

    def _expected(self, index):
        """Return the stamp, speed and steering angle of the command with this number."""
        lap, index = divmod(index, len(self._told))
        due, speed, steering_angle = self._told[index]
        return (self._laps[lap] + due, speed, steering_angle)

    def _begin_lap(self, index, stamp):
        """Store the beginning of a lap: its first command on one of the two topics."""
        lap, place = divmod(index, len(self._told))
        if lap == len(self._laps):
            if place or (lap and stamp < self._laps[-1] + self._plan.duration + PERIOD):
                self._blame(f"command {index} at {stamp} begins a lap too early")
            self._laps.append(stamp)

    def _check(self, what, index, msg):
        found = (msg.header.stamp.to_nsec(), msg.drive.speed, msg.drive.steering_angle)
        self._begin_lap(index, found[0])
        expected = self._expected(index)
        if found != expected:
            self._blame(f"{what} {index} is {found}, expected {expected}")

    def _blame(self, fault):
        if len(self.faults) < SHOWN:
            self.faults.append(f"{self.car}: {fault}")

    def _on_command(self, msg):
        if self.over:
            return
        stamp = msg.header.stamp.to_nsec()
        if self.first is None:
            self.first = stamp
        self._check("command", self.commands, msg)
        self.commands += 1
        self.newest = stamp
        self.lateness = max(self.lateness, self._note_lateness(stamp))

    def _note_lateness(self, stamp):
        """Store the time in which the car may have missed this command; return its delay [ns]."""
        late = time.time_ns() - stamp if rospy.rostime.is_wallclock() else 0
        if late > PERIOD // 2:
            self._late.append((stamp, stamp + late + HOLD))
        return late

    def _on_passed(self, msg):
        if self.over or self.first is None:
            return
        if not self.passed:  # its first command may have arrived before the first one on the input
            while self._expected(self.passed)[0] < msg.header.stamp.to_nsec():
                self.passed += 1
        is_stop = msg.drive.speed == msg.drive.steering_angle == 0.0
        if is_stop and self.passed % len(self._told) == 0:
            return  # the stop of the mux between two laps
        self._begin_lap(self.passed, msg.header.stamp.to_nsec())
        if is_stop and self._expected(self.passed)[1] and rospy.rostime.is_wallclock():
            self.stops += 1  # this machine was suspended longer than a command holds
            return
        self._note_lateness(msg.header.stamp.to_nsec())
        self._check("what the mux passed on", self.passed, msg)
        self.passed += 1

    def _on_pose(self, msg):
        stamp = msg.header.stamp.to_nsec()
        if self.over or self.first is None or stamp < self.first:
            return
        if self._unjudged and stamp - self._unjudged[-1][0] > PERIOD:  # the car was suspended
            self._late.append((self._unjudged[-1][0], stamp + HOLD))
        self._unjudged.append((stamp, planar(msg.pose)))
        # Also in lock-step, a pose may arrive here before the command that begins its lap.
        while self._unjudged and self._unjudged[0][0] <= min(stamp - HINDSIGHT, self.newest):
            self._judge(*self._unjudged.popleft())

    def _judge(self, stamp, found):
        """Compare a pose with the plan, unless a command was late."""
        lap = bisect.bisect_right(self._laps, stamp) - 1
        offset = stamp - self._laps[lap]
        if offset > self._plan.duration:  # between two laps: at the end, or placed again
            is_at_end = math.dist(found[:2], self._starts[-1][:2]) <= ROUNDING
            expected = self._starts[-1 if is_at_end else 0]
        else:
            index = min(self._row_at(offset), len(self._plan.rows) - 1)
            row, begin = self._plan.rows[index], self._begins[index]
            driven = (row.speed, row.steering_angle, (offset - begin) / 1e9)
            expected = closed_form(self._starts[index], [driven])
        if rospy.rostime.is_wallclock() and (self._is_news(offset) or self._is_missing(stamp)):
            self.unsure += 1
            return
        error = max(math.dist(found[:2], expected[:2]), angle_between(found[2], expected[2]))
        self.poses += 1
        self.worst = max(self.worst, error)
        if error > ROUNDING:
            self._blame(f"{offset / 1e9} s into the plan at {found}, expected {expected}")

    def _is_news(self, offset):
        """Return whether a command has just changed, so that the car may not have it yet."""
        if offset >= self._plan.duration - PERIOD // 10:
            return True
        index = self._row_at(offset)
        before = self._plan.rows[index - 1][:2] if index else None
        return self._plan.rows[index][:2] != before and offset - self._begins[index] < HOLD

    def _is_missing(self, stamp):
        """Return whether a command may have been missing at an instant, because it was late."""
        return any(begin <= stamp < end for begin, end in tuple(self._late))


class Memory:
    """The resident memory of every node."""

    def __init__(self):
        master = rosgraph.Master(rospy.get_name())
        self._pids = {}
        for name in set(rosnode.get_node_names()) - {rospy.get_name()}:
            with xmlrpc.client.ServerProxy(master.lookupNode(name)) as api:
                self._pids[name] = api.getPid(rospy.get_name())[2]
        self.settled = dict.fromkeys(self._pids, 0.0)
        self.most = dict.fromkeys(self._pids, 0.0)

    def look(self, is_settled):
        """Store the memory of each node [MB]."""
        for name, pid in self._pids.items():
            with open(f"/proc/{pid}/status") as file:
                line = next(each for each in file if each.startswith("VmRSS:"))
            resident = int(line.split()[1]) / 1e3
            kept = self.most if is_settled else self.settled
            kept[name] = max(kept[name], resident)

    def growth(self):
        """Return the growth of each node [MB], or nothing in the first minute."""
        return {name: most - self.settled[name] for name, most in self.most.items() if most}


class TestSoak(unittest.TestCase):
    maxDiff = None

    def test_nothing_drifts_gets_lost_or_grows(self):
        duration = int(HOURS * 3600e9)
        plans = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "plans")
        drives, nodes = [], []
        cars = {"car": "figure_8"}
        if IN_WALL_CLOCK_TIME:
            cars["car2"] = "slalom"
        for car, name in cars.items():
            drives.append(Drive(car, read_plan(os.path.join(plans, f"{name}.txt"))))
            arguments = [f"_car_name:={car}", f"_plan_file:={name}", "_loop:=true"]
            if car != "car":
                arguments.append(f"__ns:=/{car}")
            nodes.append(node("path_publisher.py", *arguments))
            self.addCleanup(nodes[-1].end)
        for drive in drives:
            wait_for(lambda d=drive: d.commands, f"the first command to {drive.car}")
        began = time.monotonic()
        memory = Memory()
        while not all(d.first + duration <= rospy.get_rostime().to_nsec() for d in drives):
            memory.look(time.monotonic() > began + SETTLED)
            faults = [fault for drive in drives for fault in drive.faults]
            self.assertEqual(faults, [])
            for each in nodes:
                self.assertTrue(each.running, each.output[-2000:])
            time.sleep(0.5)
        elapsed = time.monotonic() - began
        for drive, each in zip(drives, nodes):
            end = drive.first + duration  # laps begin up to a second apart
            wait_for(lambda d=drive, t=end: d.newest >= t, "the commands of that time")
            sent = drive.commands
            wait_for(lambda d=drive, n=sent: d.passed >= n, f"the mux to pass on {sent} commands")
            drive.over = True
            each.send_signal(signal.SIGINT)
            self.assertEqual(each.wait(), 0, each.output[-2000:])
            sys.stderr.write(
                f"{drive.car}: {duration / 3.6e12:g} h in {elapsed:.0f} s; {drive.commands} "
                f"commands, {drive.passed} passed on, {drive.stops} stops between; "
                f"{drive.poses} poses, {drive.unsure} more within {HOLD / 1e9} s of a change or of "
                f"a late command; worst pose {drive.worst:.1e}, latest command "
                f"{drive.lateness / 1e6:.0f} ms\n"
            )
        growth = memory.growth()
        for name in sorted(growth):
            sys.stderr.write(f"{name}: {memory.settled[name]:.1f} MB, {growth[name]:+.2f} MB\n")
        for drive in drives:
            self.assertEqual(drive.faults, [])
            self.assertGreater(drive.poses, 0.5 * drive.commands)
        self.assertLess(max(growth.values(), default=0.0), GROWTH, growth)
