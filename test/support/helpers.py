"""Tools of the tests: record topics, wait with a deadline, start processes."""

import contextlib
import glob
import itertools
import math
import os
import random
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
from xml.etree import ElementTree

import rosgraph
import rospy

from mushr_ros_intro.ros.connections import serves, wait_until_connected
from support import fork_server
from support.geometry import ANGLE_TOLERANCE, POSITION_TOLERANCE, angle_between, planar
from support.paths import PACKAGE

PATIENCE = 60.0
"""[s] The time limit of a wait for something that takes no time on an idle machine."""

LOG_LINES = 30
"""The number of lines of each log in the message of a failure."""

_processes = weakref.WeakSet()
_monitors = itertools.count()


class LoggedAssertionError(AssertionError):
    """A failure whose message ends with the logs of the nodes."""

    def __init__(self, message):
        super().__init__(f"{message}{logs()}")


def logs():
    """Return the last lines of the output of each process."""
    outputs = {f"{process.command} {process.state}": process.output for process in _processes}
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
    """Return a free port of the loopback interface.

    It is none of those that the system gives to outgoing connections, so it stays free.
    """
    while True:
        port = random.SystemRandom().randrange(10_000, 32_000)
        with socket.socket() as unused, contextlib.suppress(OSError):
            unused.bind(("127.0.0.1", port))
            return port


class RosTestCase(unittest.TestCase):
    """A test case with a temporary folder for plans; a failure includes the logs of the nodes."""

    failureException = LoggedAssertionError

    def setUp(self):
        assert rospy.core.is_initialized(), "expected a function start_world in the test module"
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)
        self.addCleanup(self.delete_parameters, rospy.get_param_names())

    @staticmethod
    def delete_parameters(known):
        """Delete all parameters but the known ones, because those of a node outlive it."""
        for name in rospy.get_param_names():
            if name not in known:
                rospy.delete_param(name)

    def plan(self, text, name="plan.txt"):
        """Write a plan file; return its path."""
        path = os.path.join(self.folder, name)
        with open(path, "w") as file:
            file.write(text)
        return path

    def ending(self, started):
        """Return `started`, and call its method `end` after the test."""
        self.addCleanup(started.end)
        return started

    def drive_plan(self, plan, *arguments, status=0):
        """Drive a plan with path_publisher and a monitor; return the output of both.

        `status` is the exit status of the monitor. path_publisher ends without an error.
        """
        with driven(plan, *arguments) as (process, watching):
            self.assertEqual(process.wait(), 0)
            self.assertEqual(watching.wait(), status)
        output = process.output + watching.output
        self.assertNotIn("Traceback", output)
        return output

    def assert_pose(self, got, expected, tolerance=POSITION_TOLERANCE):
        """Fail unless two (x, y, theta) differ by at most `tolerance` [m, rad]."""
        distance = math.dist(got[:2], expected[:2])
        error = max(distance, angle_between(got[2], expected[2]))
        self.assertLessEqual(error, tolerance, f"{got} is not {expected}")

    def assert_refused(self, *cases):
        """Start nodes at the same time, and check that each ends with one fatal message.

        A case is a node's file name, its arguments, and parts of its message.
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
    """Every message of a topic, in the order of arrival; `act` is called with each."""

    def __init__(self, topic, kind, act=lambda message: None):
        self._act = act
        self.topic = rospy.resolve_name(topic)
        self._messages = []
        self._changed = threading.Condition()
        self.subscriber = rospy.Subscriber(topic, kind, self._add, tcp_nodelay=True)

    def _add(self, message):
        with self._changed:
            self._messages.append(message)
            self._changed.notify_all()
        self._act(message)

    def clear(self):
        with self._changed:
            self._messages.clear()

    def end(self):
        self.subscriber.unregister()

    @property
    def messages(self):
        return list(self._messages)

    @property
    def last(self):
        return next(reversed(self._messages), None)

    def connected(self):
        """Wait until there is a publisher and all publishers are connected; return `self`."""
        if not wait_until_connected(self.subscriber, "publishers", PATIENCE, minimum=1):
            raise LoggedAssertionError(f"no connection with a publisher of {self.topic}")
        return self

    def first(self, is_wanted, what, patience=PATIENCE):
        """Wait for a message for which `is_wanted` is true, and return the first one.

        `is_wanted` sees each message once. Without one after `patience` [s], fail.
        """
        deadline = time.monotonic() + patience
        seen = 0
        with self._changed:
            while True:
                for message in self._messages[seen:]:
                    if is_wanted(message):
                        return message
                seen = len(self._messages)
                if not self._changed.wait(deadline - time.monotonic()):
                    raise LoggedAssertionError(f"waited {patience:g} s for {what} on {self.topic}")

    def after(self, stamp, patience=PATIENCE):
        """Wait for a message with a later stamp than `stamp`; return the first one."""
        what = f"a message after {stamp.to_sec():.3f}"
        return self.first(lambda message: message.header.stamp > stamp, what, patience)

    def shows(self, pose, since):
        """Wait until the car reports `pose` (x, y, theta) with a stamp of at least `since`."""

        def is_there(message):
            if message.header.stamp < since:
                return False
            x, y, theta = planar(message.pose)
            is_near = math.hypot(x - pose[0], y - pose[1]) < POSITION_TOLERANCE
            return is_near and angle_between(theta, pose[2]) < ANGLE_TOLERANCE

        self.first(is_there, f"the pose {pose}")

    def pose_at_rest(self, since):
        """Wait until the car reports one pose (x, y, theta) for 0.3 s after `since`; return it.

        0.3 s is longer than the car obeys a command.
        """
        begin = None

        def is_at_rest(message):
            nonlocal begin
            if message.header.stamp < since:
                return False
            if begin is None or planar(begin.pose) != planar(message.pose):
                begin = message
            return message.header.stamp >= begin.header.stamp + rospy.Duration(0.3)

        return planar(self.first(is_at_rest, "one pose for 0.3 s").pose)


def publisher(topic, kind):
    """Return a publisher of `topic` that is connected to all its subscribers, at least one."""
    made = rospy.Publisher(topic, kind, queue_size=100, tcp_nodelay=True)
    if not wait_until_connected(made, "subscribers", PATIENCE, minimum=1):
        raise LoggedAssertionError(f"no connection with the subscribers of {made.resolved_name}")
    return made


class Relay:
    """Forwards the messages of a topic to another topic, after a call of `before` with each."""

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


def wait_for_receiver(name, sender, topic):
    """Wait until a node receives a topic from another one.

    The sender may still list nodes that have ended, so the name must be new.
    """
    wait_for(lambda: serves(sender, topic, name), f"{name} to receive {topic}")


ENDING = 5.0
"""[s] A process that has not ended this long after SIGINT is killed."""

_held = []


def kill(name, pid, master_uri=None):
    """Kill a node, and occupy its port until this process ends.

    The master and the former subscribers of the node may still call this port. If a node of
    another test had it then, a call could shut it down, or could block its other connections.
    """
    uri = rosgraph.Master("/kill", master_uri).lookupNode(name)
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
    """A process, its output, and its end."""

    def __init__(self, *command, **environment):
        self.command = " ".join(map(os.path.basename, command)).split("\n")[0]
        environment = {**os.environ, **environment, "PYTHONUNBUFFERED": "1"}
        self._process = self._start(command, environment)
        self._lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        _processes.add(self)

    @staticmethod
    def _start(command, environment):
        return subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )

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

    @property
    def state(self):
        """The exit status, or the state of each thread: its letter in /proc, and its CPU time."""
        if not self.running:
            return f"(exit status {self._process.poll()})"
        threads = []
        for path in glob.glob(f"/proc/{self.pid}/task/*/stat"):
            with contextlib.suppress(OSError), open(path) as file:  # the thread has ended
                fields = file.read().rpartition(")")[2].split()
                seconds = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
                threads.append(f"{fields[0]} {seconds:.1f} s")
        return f"(threads: {', '.join(threads)})"

    def send_signal(self, number):
        """Send a signal to the process and to its child processes, unless it has ended."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)

    def wait(self, patience=PATIENCE):
        """Wait for the end of the process; return its exit status.

        The time limit begins again while output arrives: on a busy machine, grading takes longer.
        """
        seen, status = 0, None
        while status is None:
            try:
                status = self._process.wait(patience)
            except subprocess.TimeoutExpired:
                if len(self._lines) == seen:
                    self.end()
                    what = f"no end and no output of {self.command} for {patience:g} s"
                    raise LoggedAssertionError(what) from None
                seen = len(self._lines)
        self._reader.join(5.0)
        return status

    def end(self):
        """End the process with SIGINT, or kill it after `ENDING`.

        With SIGINT, a node unregisters at the master. Otherwise the master would call the node's
        address when the next node of its name starts, and could shut down a node of another test.
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


class ForkedProcess(Process):
    """A Python program of the fork server, which starts six times faster than other processes."""

    @staticmethod
    def _start(command, environment):
        program = shutil.which(command[0]) or command[0]
        return fork_server.Forked((program, *command[1:]), environment)


def node(name, *arguments, **environment):
    """Start a node of src/ or test/support/; Python itself has the environment of this process."""
    paths = (f"{PACKAGE}/{folder}/{name}" for folder in ("src", "test/support"))
    return ForkedProcess(next(filter(os.path.exists, paths)), *arguments, **environment)


def driver(plan, *arguments, **environment):
    """Start path_publisher with the path or the name of a plan."""
    return node("path_publisher.py", f"_plan_file:={plan}", *arguments, **environment)


def monitor(plan, *arguments, **environment):
    """Start a drive_monitor for one drive of a plan; return it when it sees the car."""
    name = f"monitor_{next(_monitors)}"
    common = (f"_plan_file:={plan}", f"__name:={name}")
    process = node("drive_monitor.py", *common, *arguments, **environment)
    wait_for(lambda: "watching the drives" in process.output or not process.running, name)
    return process


@contextlib.contextmanager
def driven(plan, *arguments, **environment):
    """Yield a path_publisher with a plan, and a monitor of its drive."""
    watching = monitor(plan, **environment)
    with watching, driver(plan, *arguments, **environment) as process:
        yield process, watching


@contextlib.contextmanager
def master(caller, **environment):
    """Run a master; yield its process, and a proxy with which `caller` calls it."""
    port = free_port()
    proxy = rosgraph.Master(caller, f"http://localhost:{port}")
    with ForkedProcess("rosmaster", "--core", "-p", str(port), **environment) as process:
        wait_for(proxy.is_online, "the master")
        yield process, proxy


def rostest_results(path, *arguments, **environment):
    """Run rostest; return its process, and the root of its result file.

    `path` is the pattern of the result file: FOLDER/PACKAGE/FILE.
    """
    environment["ROS_TEST_RESULTS_DIR"] = os.path.dirname(os.path.dirname(path))
    with ForkedProcess("rostest", *arguments, **environment) as process:
        process.wait(2 * PATIENCE)
    paths = glob.glob(path)
    if len(paths) != 1:
        raise LoggedAssertionError(f"the result files are {paths}")
    return process, ElementTree.parse(paths[0]).getroot()


def failures_in(result):
    """Return the failure, or None, of each test case of a result file, by the name of the case."""
    return {case.get("name"): case.findtext("failure") for case in result.iter("testcase")}
