"""Check two machines on a network: the car and the master on one, path_publisher on the other.

The machines are network namespaces with a pair of virtual Ethernet devices.
"""

import os
import re
import shutil
import signal
import subprocess
import sys

import pytest
import roslib.packages

from support.geometry import POSITION_TOLERANCE, closed_form
from support.helpers import Process, wait_for
from support.paths import PACKAGE

pytestmark = pytest.mark.full

WITNESS = os.path.join(PACKAGE, "test", "support", "witness.py")
DEVICE = "eth0"
MASTER = "http://192.0.2.1:11311"
"""RFC 5737 reserves these addresses for documentation."""

START = (0.0, 0.0, 0.5)
SHORT = [(1.0, 0.1, 1.0), (2.0, -0.2, 0.5)]
LONG = [(1.0, 0.1, 60.0)]
TIMEOUT = 200_000_000
"""[ns] The car obeys a command for this time."""
ALL_ARRIVED = {"05", "06"}
"""FIN_WAIT2 and TIME_WAIT: states in /proc/net/tcp after the end of a connection has arrived."""
SHOWN = 0.5e-4
"""[m, rad] path_publisher rounds the pose in its output to four digits."""

WITH_ANOTHER_CLOCK = """
import runpy, sys, time

read_clock, offset, sys.argv = time.time, float(sys.argv[1]), sys.argv[2:]
time.time = lambda: read_clock() + offset
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def ip(*command):
    """Run iproute2's ip; return its output."""
    done = subprocess.run(["ip", *command], capture_output=True)
    if done.returncode:
        raise OSError(f"ip {' '.join(command)}: {done.stderr.decode().strip()}")
    return done.stdout.decode()


class Machine:
    """A network namespace and its processes."""

    def __init__(self, name, address):
        self.name = f"mushr-{name}-{os.getpid()}"
        self.address = address
        ip("netns", "add", self.name)

    def connect(self):
        ip("-n", self.name, "address", "add", f"{self.address}/24", "dev", DEVICE)
        for device in ("lo", DEVICE):
            ip("-n", self.name, "link", "set", device, "up")

    def start(self, *command):
        """Start a command with the environment of the README."""
        return Process(
            *("ip", "netns", "exec", self.name, "env", "-u", "ROS_HOSTNAME"),
            *("-u", "LD_PRELOAD"),  # scripts/dev/loopback.c, which a user does not have
            *(f"ROS_MASTER_URI={MASTER}", f"ROS_IP={self.address}"),
            *command,
        )

    def is_silent(self):
        """Return whether all data of this machine's connections has arrived."""
        sockets = ip("netns", "exec", self.name, "cat", "/proc/net/tcp").splitlines()[1:]
        return all(line.split()[3] in ALL_ARRIVED for line in sockets)

    def end(self):
        """Kill all processes on the machine, and remove the machine."""
        for pid in ip("netns", "pids", self.name).split():
            os.kill(int(pid), signal.SIGKILL)
        ip("netns", "delete", self.name)


class Network:
    """The two machines, with a car on one of them."""

    def __init__(self, car, laptop, folder):
        self.car, self.laptop, self._folder = car, laptop, folder
        arguments = ("map:=none", "laser:=false", "model:=false")
        self.simulation = car.start("roslaunch", "mushr_ros_intro", "sim.launch", *arguments)
        wait_for(lambda: "input default" in self.simulation.output, "the mux to be ready")
        self._witness = car.start(sys.executable, WITNESS)
        wait_for(lambda: self.printed("pose"), "the car's first pose")

    def printed(self, what):
        """Return the output of the witness: [(stamp [ns], [number, ...]), ...]."""
        lines = [line.split() for line in self._witness.output.split("\n")[:-1]]
        found = [line[1:] for line in lines if line[0] == what]
        return [(int(stamp), list(map(float.fromhex, numbers))) for stamp, *numbers in found]

    def publisher(self, rows, *interpreter):
        """Start path_publisher on the laptop."""
        plan = self._folder / "plan.txt"
        plan.write_text("\n".join(", ".join(map(str, row)) for row in [START, *rows]))
        node = roslib.packages.find_node("mushr_ros_intro", "path_publisher.py")[0]
        return self.laptop.start(*interpreter, node, f"_plan_file:={plan}")

    def drive(self, *interpreter):
        """Drive a short plan; check the final pose."""
        before = len(self.simulation.output)
        publisher = self.publisher(SHORT, *interpreter)
        assert publisher.wait() == 0, publisher.output
        pattern = r"stopped at \((\S+) m, (\S+) m, (\S+) rad\); difference (\S+) m"
        said = wait_for(lambda: re.search(pattern, self.simulation.output[before:]), "the result")
        *pose, difference = map(float, said.groups())
        assert pose == pytest.approx(closed_form(START, SHORT), abs=POSITION_TOLERANCE + SHOWN)
        assert difference < POSITION_TOLERANCE


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """Return the two machines with a car on one; skip if this machine does not allow namespaces."""
    if os.geteuid() != 0:
        pytest.skip("network namespaces are for root")
    if not shutil.which("ip"):
        pytest.skip("there is no ip, of the package iproute2")
    machines = []
    try:
        try:
            for name, address in (("car", "192.0.2.1"), ("laptop", "192.0.2.2")):
                machines.append(Machine(name, address))
            car, laptop = machines
            peer = ("type", "veth", "peer", "name", DEVICE, "netns", laptop.name)
            ip("link", "add", DEVICE, "netns", car.name, *peer)
            car.connect()
            laptop.connect()
        except OSError as error:
            pytest.skip(f"network namespaces are refused: {error}")
        yield Network(car, laptop, tmp_path_factory.mktemp("network"))
    finally:
        for machine in machines:
            machine.end()


@pytest.mark.parametrize("offset", [0.3, -0.3])  # [s] longer than the timeout of a command
def test_clocks_that_differ(network, offset):
    network.drive(sys.executable, "-c", WITH_ANOTHER_CLOCK, str(offset))


def test_a_slow_and_lossy_network(network):
    netem = ("netns", "exec", network.laptop.name, "tc", "qdisc")
    where = ("dev", DEVICE, "root")
    try:
        ip(*netem, "add", *where, "netem", "delay", "50ms", "loss", "5%")
    except OSError as error:
        pytest.skip(f"the kernel has no netem: {error}")
    try:
        network.drive()
    finally:
        ip(*netem, "delete", *where)


def test_a_cut_in_mid_plan(network):
    before = len(network.printed("command"))
    publisher = network.publisher(LONG)
    wait_for(lambda: len(network.printed("command")) > before + 5, "the plan to be under way")
    assert not network.laptop.is_silent()
    ip("-n", network.car.name, "link", "set", DEVICE, "down")

    # The car stops when its last command expires.
    wait_for(lambda: network.printed("command")[-1][1] == [0.0, 0.0], "the mux to stop the car")
    moves = [stamp for stamp, command in network.printed("command")[before:] if any(command)]
    begin, stop = moves[0], moves[-1] + TIMEOUT
    wait_for(lambda: network.printed("pose")[-1][0] > stop, "a pose of the car at rest")
    rows = [(LONG[0][0], LONG[0][1], (stop - begin) / 1e9)]
    expected = closed_form(START, rows)
    assert network.printed("pose")[-1][1] == pytest.approx(expected, abs=POSITION_TOLERANCE)

    # The publisher gives up while the network is cut.
    cut = "the network to the master is cut"
    wait_for(lambda: cut in publisher.output, "the publisher to give up")
    assert network.printed("pose")[-1][1] == pytest.approx(expected, abs=POSITION_TOLERANCE)

    ip("-n", network.car.name, "link", "set", DEVICE, "up")
    assert publisher.wait() == 1, publisher.output
    # TCP sends the lost data again after some seconds.
    wait_for(network.laptop.is_silent, "the data under way to arrive")
    network.drive()
