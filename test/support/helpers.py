"""Tools of the tests: record topics, wait with a deadline, start processes."""

import contextlib
import glob
import importlib.util
import math
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
import unittest
import weakref
from urllib.parse import urlsplit

import rosgraph
import roslib.packages
import rospkg
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from mushr_ros_intro.ros.connections import reannounce, receivers
from support.geometry import ANGLE_TOLERANCE, POSITION_TOLERANCE, angle_between, planar
from support.messages import placement

PATIENCE = 60.0
"""[s] The time limit of a wait for what an idle machine does at once."""

LOG_LINES = 30
"""How many lines of each log a failure shows."""

_processes = weakref.WeakSet()


class LoggedAssertionError(AssertionError):
    """A failure whose message ends with the logs of the nodes."""

    def __init__(self, message):
        super().__init__(f"{message}{logs()}")


def logs():
    """Return the last lines of what each process of the test has written.

    Includes the nodes that the launch file of a rostest has started.
    """
    outputs = {process.command: process.output for process in _processes}
    if rospy.core.is_initialized():
        folder = os.path.join(rospkg.get_log_dir(), rospy.get_param("/run_id", ""))
        for path in glob.glob(f"{folder}/*-[0-9]*.log"):
            with open(path, errors="replace") as file:
                outputs[os.path.basename(path)] = file.read()
    tails = {name: "\n".join(text.splitlines()[-LOG_LINES:]) for name, text in outputs.items()}
    return "".join(f"\n--- {name}:\n{tail}" for name, tail in sorted(tails.items()))


def wait_for(condition, what, patience=PATIENCE):
    """Return the first true value of `condition`; fail after `patience` [s] without one."""
    deadline = time.monotonic() + patience
    while True:
        value = condition()
        if value:
            return value
        if rospy.is_shutdown():
            raise LoggedAssertionError(f"shut down while waiting for {what}")
        if time.monotonic() > deadline:
            raise LoggedAssertionError(f"waited {patience:g} s for {what}")
        time.sleep(0.01)


def free_port():
    """Return a port of the loopback interface that nobody listens on."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return unused.getsockname()[1]


class RosTestCase(unittest.TestCase):
    """A test case with a temporary folder for plans, and with a check of poses.

    The message of a failure includes the logs of the nodes.
    """

    failureException = LoggedAssertionError

    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)

    def plan(self, text, name="plan.txt"):
        """Write a plan file; return its path."""
        path = os.path.join(self.folder, name)
        with open(path, "w") as file:
            file.write(text)
        return path

    def assert_pose(self, got, expected, tolerance=POSITION_TOLERANCE):
        """Fail unless two (x, y, theta) differ by at most `tolerance` [m, rad]."""
        distance = math.hypot(got[0] - expected[0], got[1] - expected[1])
        self.assertLessEqual(distance, tolerance, f"{got} is not {expected}")
        turn = angle_between(got[2], expected[2])
        self.assertLessEqual(turn, tolerance, f"{got} is not {expected}")

    def assert_refused(self, *cases):
        """Start nodes at once, by name, arguments and the messages that each must end with.

        Each must log one fatal message, and end with status 1.
        """
        started = [
            (node(name, f"__name:=refused_{number}", *arguments), messages)
            for number, (name, arguments, *messages) in enumerate(cases)
        ]
        for process, messages in started:
            with process:
                self.assertEqual(process.wait(), 1, process.output)
                self.assertEqual(process.output.count("[FATAL]"), 1, process.output)
                self.assertNotIn("Traceback", process.output)
                for message in messages:
                    self.assertIn(message, process.output)


class Recording:
    """Every message of a topic, in the order of arrival."""

    def __init__(self, topic, kind):
        self.topic = rospy.resolve_name(topic)
        self._lock = threading.Lock()
        self._messages = []
        self.subscriber = rospy.Subscriber(topic, kind, self._take, tcp_nodelay=True)

    def _take(self, message):
        with self._lock:
            self._messages.append(message)

    @property
    def messages(self):
        with self._lock:
            return list(self._messages)

    @property
    def last(self):
        with self._lock:
            return self._messages[-1] if self._messages else None

    def clear(self):
        with self._lock:
            self._messages.clear()

    def connected(self):
        """Wait until somebody publishes the topic, of whom rospy may have to be told again."""
        reminded = time.monotonic()

        def is_connected():
            nonlocal reminded
            if time.monotonic() > reminded + 2.0:
                reminded = time.monotonic()
                reannounce(self.subscriber, "publishers")
            return self.subscriber.get_num_connections()

        wait_for(is_connected, f"a publisher of {self.topic}")
        return self

    def after(self, stamp, patience=PATIENCE):
        """Return the first message that is stamped after `stamp` (a rospy.Time)."""

        def find():
            return next((m for m in self.messages if m.header.stamp > stamp), None)

        return wait_for(find, f"a message on {self.topic} after {stamp.to_sec():.3f}", patience)

    def shows(self, pose, since, patience=PATIENCE):
        """Wait until the car reports from `since` on that it is at `pose` (x, y, theta)."""

        def is_there():
            if not self.last or self.last.header.stamp < since:
                return False
            x, y, theta = planar(self.last.pose)
            is_near = math.hypot(x - pose[0], y - pose[1]) < POSITION_TOLERANCE
            return is_near and angle_between(theta, pose[2]) < ANGLE_TOLERANCE

        wait_for(is_there, f"the car of {self.topic} to be at {pose}", patience)

    def pose_at_rest(self, since, patience=PATIENCE):
        """Return the pose (x, y, theta) of a car that reports the same one for 0.3 s after `since`.

        0.3 s is longer than a command is good for.
        """

        def find():
            messages = [m for m in self.messages if m.header.stamp >= since]
            if not messages:
                return None
            tail = messages[-1].header.stamp - rospy.Duration(0.3)
            if tail < since:
                return None
            poses = {planar(m.pose) for m in messages if m.header.stamp >= tail}
            return poses if len(poses) == 1 else None

        return wait_for(find, f"the car of {self.topic} to stand still", patience).pop()


def publisher(topic, kind, **options):
    """Return a publisher of `topic` that somebody listens to."""
    made = rospy.Publisher(topic, kind, queue_size=100, tcp_nodelay=True, **options)
    wait_for(made.get_num_connections, f"a subscriber of {made.resolved_name}")
    return made


class CarTestCase(RosTestCase):
    """A test case with the poses of the car, and with publishers of what it obeys."""

    def setUp(self):
        super().setUp()
        self.poses = Recording("/car/car_pose", PoseStamped).connected()
        self.commands = publisher("/car/mux/ackermann_cmd_mux/output", AckermannDriveStamped)
        self.placements = publisher("/initialpose", PoseWithCovarianceStamped)

    def place(self, x=0.0, y=0.0, theta=0.0):
        """Place the car, and wait until it reports the pose."""
        stamp = rospy.Time.now()
        self.placements.publish(placement(stamp, x, y, theta))
        self.poses.shows((x, y, theta), stamp)


class Relay:
    """Passes the messages of a topic on to another; `before` is called with each message first."""

    def __init__(self, topic, to, kind, before):
        self._before = before
        self._publisher = publisher(to, kind)
        self._subscriber = rospy.Subscriber(topic, kind, self._pass_on, tcp_nodelay=True)

    def _pass_on(self, message):
        self._before(message)
        self._publisher.publish(message)

    def end(self):
        self._subscriber.unregister()
        self._publisher.unregister()


def wait_for_recorder(name):
    """Wait until what a plan_recorder needs to hear reaches it."""
    master = rosgraph.Master(rospy.get_name())
    topics = {
        "/car/mux/ackermann_cmd_mux": "/car/mux/ackermann_cmd_mux/output",
        "/car/car_sim": "/car/car_pose",
    }

    def hears(sender):
        uri = master.lookupNode(sender)
        return name in receivers(uri, PATIENCE, rospy.get_name(), topics[sender])

    wait_for(lambda: all(map(hears, topics)), f"{name} to listen")


ENDING = 5.0
"""How long a process may take to end when it is told to [s], before it is killed."""


_held = []


def kill(name, pid):
    """Kill a node, and keep its port from others until this process ends.

    When the next node of its name comes, the master has who listens there shut down; and who
    subscribes to what it published asks there for it, which another's port for messages takes for
    one that is slow to introduce itself, and accepts nobody else meanwhile. Either may be a node
    of another test by then.
    """
    uri = rosgraph.Master("/kill").lookupNode(name)
    os.kill(pid, signal.SIGKILL)
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)

    def is_held():
        with contextlib.suppress(OSError):
            held.bind(("127.0.0.1", urlsplit(uri).port))
            return True

    wait_for(is_held, f"{name} to be dead")
    _held.append(held)


class Process:
    """A command that a test starts, watches and ends."""

    def __init__(self, *command, **environment):
        self.command = " ".join(map(os.path.basename, command)).split("\n")[0]
        self._process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **environment, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
        )
        self._lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        _processes.add(self)

    def _read(self):
        for line in self._process.stdout:
            self._lines.append(line.decode(errors="replace"))

    @property
    def output(self):
        return "".join(self._lines)

    @property
    def pid(self):
        return self._process.pid

    @property
    def running(self):
        return self._process.poll() is None

    def send_signal(self, number):
        """Send a signal to the process and to all that it has started."""
        os.killpg(self._process.pid, number)

    def wait(self, patience=PATIENCE):
        """Return the exit status."""
        try:
            status = self._process.wait(patience)
        except subprocess.TimeoutExpired:
            self.end()
            raise LoggedAssertionError(f"no end of {self.command} after {patience:g} s") from None
        self._reader.join(5.0)
        return status

    def end(self):
        """End the process, as a rule so that a node signs off at the master.

        Otherwise the next one of its name makes the master call where this one listened: there
        may be a node of another test by then, and be told to shut down.
        """
        if self.running:
            self.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDING)
        if self.running:
            self.send_signal(signal.SIGKILL)
            self._process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()


def module(name):
    """Return a node of this package as a module, for what needs no process of its own."""
    path = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "src", name)
    spec = importlib.util.spec_from_file_location(os.path.splitext(name)[0], path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@contextlib.contextmanager
def private_parameters(parameters):
    """Let the node that this process is have `parameters` for a while."""
    try:
        for name, value in parameters.items():
            rospy.set_param(f"~{name}", value)
        yield
    finally:
        for name in parameters:
            rospy.delete_param(f"~{name}")


def node(name, *arguments, **environment):
    """Start a node of this package as rosrun does, without rosrun's second of searching."""
    path = roslib.packages.find_node("mushr_ros_intro", name)[0]
    return Process(path, *arguments, **environment)
