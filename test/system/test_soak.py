"""Repeat a drive in lock-step; check that no lap differs, no message is lost, and no memory grows.

The environment variable SOAK_HOURS is the duration by the clock of the car [h]. For a week, type in
scripts/shell: SOAK_HOURS=168 python3 -m pytest -s test/system/test_soak.py
"""

import os
import signal
import sys
import time
import xmlrpc.client

import pytest
import rosgraph
import rosnode
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped
from test_lock_step import in_bits, is_pause

from support.helpers import RosTestCase, driver, wait_for
from support.messages import OUTPUT
from support.world import LOCK_STEP, launch

pytestmark = pytest.mark.full

HOURS = float(os.environ.get("SOAK_HOURS", 0.05))

GROWTH = 2.0
"""[MB] The largest growth of the memory of a process after the first minute."""

SETTLED = 60.0
"""[s] The duration of the first minute."""


def start_world():
    return launch("sim.launch", map="none", laser=False, model=False, **LOCK_STEP)


class Laps:
    """The messages of a drive that is repeated."""

    def __init__(self):
        self._commands, self._poses = [], []
        for topic, kind, messages in (
            (OUTPUT, AckermannDriveStamped, self._commands),
            ("/car/car_pose", PoseStamped, self._poses),
        ):
            rospy.Subscriber(topic, kind, messages.append, tcp_nodelay=True)

    def take(self):
        """Return the commands and the poses of the next lap that has ended, None without one."""
        commands, poses = self._commands, self._poses
        pairs = enumerate(zip(commands, commands[1:]), 1)
        end = next((index for index, pair in pairs if is_pause(*pair)), None)
        if end is None or poses[-1].header.stamp < commands[end].header.stamp:
            return None
        begin, last = commands[0].header.stamp, commands[end - 1].header.stamp
        lap = [
            [in_bits(m, begin) for m in messages if begin <= m.header.stamp <= last]
            for messages in (commands[:end], poses)
        ]
        del commands[:end], poses[: sum(m.header.stamp <= last for m in poses)]
        return lap


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


class TestSoak(RosTestCase):
    maxDiff = None

    def test_nothing_drifts_gets_lost_or_grows(self):
        laps, count = Laps(), 0
        with driver("figure_8", "_loop:=true") as process:
            first = wait_for(laps.take, "the first lap")
            begin, began = rospy.get_time(), time.monotonic()
            memory = Memory()
            while rospy.get_time() < begin + HOURS * 3600.0:
                memory.look(time.monotonic() > began + SETTLED)
                lap = wait_for(laps.take, "the next lap")
                self.assertEqual(lap, first)
                count += 1
            process.send_signal(signal.SIGINT)
            self.assertEqual(process.wait(), 0)
        self.assertGreater(len(first[1]), 1000)
        growth = memory.growth()
        sys.stderr.write(f"{count} laps in {time.monotonic() - began:.0f} s; growth {growth} MB\n")
        self.assertLess(max(growth.values(), default=0.0), GROWTH, growth)
