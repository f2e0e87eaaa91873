"""Check how a program waits in simulated time; `test_styles` runs whole programs."""

import os
import queue
import random
import select
import selectors
import subprocess
import sys
import threading
import time
from functools import partial

import numpy
import pytest
import rospy

from mushr_ros_intro.replay import simulated_time
from mushr_ros_intro.replay.simulated_time import MAX_READS, POLL_PERIOD, START, Sleepers
from support.helpers import PATIENCE, wait_for

MS = 1_000_000


class Ros:
    """The time of ROS, and the threads that sleep in it."""

    def __init__(self, sleepers):
        self.now, self.sleepers, self.woken = START, sleepers, []

    def start(self, name, function, *arguments):
        """Call a function in a thread, and wait until it sleeps; return the thread.

        `woken` gets the name and the result.
        """
        before = len(self.sleepers._queue)
        run = lambda: self.woken.append((name, function(*arguments)))  # noqa: E731
        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        wait_for(lambda: len(self.sleepers._queue) > before, "the thread")
        return thread

    def tell(self, milliseconds):
        """Tell the time, and wait until the thread that is woken has ended, if any is due."""
        self.now = START + milliseconds * MS
        with self.sleepers._lock:
            count = len(self.woken) + any(due <= self.now for due, *_ in self.sleepers._queue[:1])
        self.sleepers.on_time(self.now)
        self.sleepers.on_processed()
        wait_for(lambda: len(self.woken) == count, "the thread")

    @property
    def due(self):
        """When the next thread is due, as the world reads it [ms]; 0 if none sleeps.

        Not later than now, if a thread was woken, and none has begun to sleep since then.
        """
        with self.sleepers._lock:  # the thread that begins to sleep has written it
            size = os.fstat(self.sleepers.file).st_size
            due = int.from_bytes(os.pread(self.sleepers.file, 8, size - 8), "little")
        return due and (due - START) // MS


@pytest.fixture
def ros(monkeypatch):
    sleepers = Sleepers()
    sleepers.file = os.memfd_create("due")
    ros = Ros(sleepers)
    # The servers of earlier tests look for requests in their own threads.
    others = {*threading.enumerate()} - {threading.current_thread()}
    monkeypatch.setattr(simulated_time, "sleepers", sleepers)
    monkeypatch.setattr(simulated_time, "read", lambda: ros.now)
    monkeypatch.setattr(
        simulated_time, "is_initialized", lambda: threading.current_thread() not in others
    )
    yield ros
    os.close(sleepers.file)


def test_each_message_wakes_one_thread(ros):
    """In the order of the due times."""
    for name, due in (("third", 30), ("first", 10), ("second", 20)):
        ros.start(name, ros.sleepers.sleep, due * MS)
    ros.tell(9)
    assert (ros.woken, ros.due) == ([], 10)
    ros.tell(25)
    assert (ros.woken, ros.due) == ([("first", False)], 10)
    ros.tell(25)
    assert [name for name, _ in ros.woken] == ["first", "second"]
    ros.tell(25)
    assert (len(ros.woken), ros.due) == (2, 30)
    ros.tell(30)
    assert [name for name, _ in ros.woken][2:] == ["third"]
    ros.tell(30)
    assert ros.due == 0


def test_equal_due_times(ros):
    """The thread that began to sleep first wakes up first."""
    for name in ("first", "second"):
        ros.start(name, ros.sleepers.sleep, 10 * MS)
    ros.tell(10)
    assert [name for name, _ in ros.woken] == ["first"]


def wait_in(condition, seconds):
    with condition:
        return simulated_time.wait(condition, seconds)


def test_a_condition_that_is_notified(ros):
    """It does not wake another thread when it would have been due."""
    condition = threading.Condition()
    ros.start("notified", wait_in, condition, 0.01)
    ros.start("sleeps", ros.sleepers.sleep, 20 * MS)
    with condition:
        condition.notify()
    wait_for(lambda: ros.woken == [("notified", True)], "the thread")
    assert ros.due == 20
    ros.tell(20)
    assert ros.woken[1:] == [("sleeps", False)]


def test_a_condition_with_a_timeout(ros):
    condition = threading.Condition()
    ros.start("waits", wait_in, condition, 0.01)
    ros.tell(10)
    assert ros.woken == [("waits", False)]
    assert not condition._waiters


def test_shutdown(ros, monkeypatch):
    """A sleep ends after the shutdown, and not before."""
    is_over = threading.Event()
    monkeypatch.setattr(simulated_time.rospy.core, "is_shutdown_requested", lambda: True)
    monkeypatch.setattr(simulated_time.rospy, "is_shutdown", is_over.is_set)
    thread = ros.start("sleeps", ros.sleepers.sleep, 10 * MS)
    ros.sleepers.on_shutdown("")
    time.sleep(0.02)  # long enough to end too early
    assert ros.woken == []
    is_over.set()
    thread.join(60.0)
    assert ros.woken == [("sleeps", False)]


def test_a_thread_that_sleeps_during_a_shutdown(ros, monkeypatch):
    """A thread may find that ROS runs, and begin to sleep when no thread receives /clock."""
    monkeypatch.setattr(simulated_time.rospy.core, "is_shutdown_requested", lambda: True)
    monkeypatch.setattr(simulated_time.rospy, "is_shutdown", lambda: True)
    ros.sleepers.on_shutdown("")
    thread = threading.Thread(target=ros.sleepers.sleep, args=[10 * MS], daemon=True)
    thread.start()
    thread.join(60.0)
    assert not thread.is_alive()


class Topic:
    def __init__(self):
        self.impl = self

    def get_num_connections(self):
        return 1


@pytest.mark.parametrize(
    "read", [simulated_time.poll, partial(simulated_time.count_connections, Topic())]
)
def test_a_thread_that_polls(ros, read):
    """Its read at one time ends when the clock has advanced."""

    def read_often():
        for _ in range(MAX_READS + 1):
            read()

    ros.start("polls", read_often)
    assert ros.due == POLL_PERIOD // MS
    ros.tell(10)
    assert ros.woken == [("polls", None)]


def _select(file, seconds):
    return select.select([file], [], [], seconds)[0]


def _poll(file, seconds):
    polled = select.poll()
    polled.register(file, select.POLLIN)
    return polled.poll(1e3 * seconds)


def _epoll(file, seconds):
    with select.epoll() as polled:
        polled.register(file, select.EPOLLIN)
        return polled.poll(timeout=seconds, maxevents=1)


def _selector(kind):
    def wait(file, seconds):
        with kind() as selector:
            selector.register(file, selectors.EVENT_READ)
            return selector.select(timeout=seconds)

    return wait


@pytest.mark.parametrize(
    "wait",
    [
        *(_select, _poll, _epoll, _selector(selectors.SelectSelector)),
        *(_selector(selectors.PollSelector), _selector(selectors.EpollSelector)),
    ],
    ids="select poll epoll SelectSelector PollSelector EpollSelector".split(),
)
def test_files(ros, monkeypatch, wait):
    """A pipe is ready when it has been written before the next message on /clock."""
    for owner, name in (
        *((select, each) for each in ("select", "poll", "epoll")),
        *((selectors.SelectSelector, "select"), (selectors._PollLikeSelector, "select")),
        (selectors.EpollSelector, "select"),
    ):
        monkeypatch.setattr(owner, name, getattr(owner, name))  # at the end, set it back
    simulated_time.simulate_files()

    def is_ready(seconds):
        return bool(wait(receiver, seconds))

    receiver, sender = os.pipe()
    ros.start("selects", is_ready, 0.025)
    os.write(sender, b"x")
    ros.tell(10)
    assert ros.woken == [("selects", True)]
    assert is_ready(0.025)  # at once
    os.read(receiver, 1)
    ros.start("expires", is_ready, 0.005)
    assert ros.due == 15
    ros.tell(15)
    assert ros.woken[1:] == [("expires", False)]


PROGRAM = """
import pickle, random, sys, time
from datetime import datetime, timezone
import numpy
import other
print(random.random(), numpy.random.random())
print(time.time(), time.monotonic_ns(), time.perf_counter(), __name__, __file__, sys.argv[1:])
print(time.clock_gettime(time.CLOCK_REALTIME), time.clock_gettime_ns(time.CLOCK_BOOTTIME))
print(time.clock_gettime(time.CLOCK_THREAD_CPUTIME_ID) > 0.0)
print(datetime.now() == datetime.today() == datetime.fromtimestamp(time.time()))
print(datetime.utcnow(), datetime.now(timezone.utc))
print(repr(datetime.now()), pickle.loads(pickle.dumps(datetime.now())) == datetime.now())
other.fail()
"""
OTHER = "def fail():\n    raise IndexError(3)\n"


def test_a_program(tmp_path):
    """It gets its own name and arguments, and its random numbers are known.

    Modules in the current directory are not imported.
    """
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    (tmp_path / "other.py").write_text(OTHER)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "queue.py").write_text("raise AssertionError")
    with open(simulated_time.__file__, encoding="ascii") as file, open(os.devnull, "wb") as null:
        command = [sys.executable, "-c", file.read(), str(null.fileno()), path, "a", "b"]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            pass_fds=[null.fileno()],
            cwd=tmp_path / "folder",
        )
    numbers = random.Random(0).random(), numpy.random.RandomState(0).random_sample()
    assert done.stdout.splitlines() == [
        "{} {}".format(*numbers),
        f"1800000000.0 0 0.0 __main__ {path} ['a', 'b']",
        "1800000000.0 0",
        "True",
        "True",
        "2027-01-15 08:00:00 2027-01-15 08:00:00+00:00",
        "datetime.datetime(2027, 1, 15, 8, 0) True",
    ]
    assert done.stderr.endswith("IndexError: 3\n")
    assert done.returncode == 1


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("my_node.py", True),
        (rospy.__file__, False),
        (queue.__file__, True),
        (subprocess.__file__, False),
    ],
)
def test_who_gets_the_simulated_time(file, expected):
    """Files of the node, also through the standard library, but not rospy and subprocess."""
    functions = {}
    exec(compile("def call(function):\n    return function()", file, "exec"), functions)
    assert functions["call"](simulated_time.is_for_node) == expected


def test_rospy_through_the_standard_library():
    """A library acts for the file that calls it."""
    functions = {}
    for name, file in (("outer", rospy.__file__), ("inner", queue.__file__)):
        exec(compile(f"def {name}(f, *others):\n    return f(*others)", file, "exec"), functions)
    assert not functions["outer"](functions["inner"], simulated_time.is_for_node)


SIMULATES = """
import os, queue, signal, sys, threading, time, types
import mushr_ros_intro.replay.simulated_time as simulated
for name, program in eval(sys.argv[1]).items():
    if not os.fork():
        signals = []  # that the next child gets when it begins
        os.register_at_fork(after_in_child=lambda: signals and os.kill(os.getpid(), signals.pop()))
        simulated.simulate()
        exec(program)
        os._exit(0)
    if os.wait()[1]:
        print(name)
"""

PROGRAMS = {
    "before the time of ROS is known, the clocks stand, but timeouts are real": """
try:
    queue.Queue().get(timeout=0.01)
except queue.Empty:
    pass
""",
    "a child process keeps the real time: no thread of it receives the simulated time": """
simulated.rospy.rostime.is_rostime_initialized = lambda: True
simulated.rospy.rostime.is_wallclock = lambda: False
assert simulated.is_initialized()
if not os.fork():
    signal.alarm(20)
    time.sleep(0.01)
    os._exit(3)
assert os.WEXITSTATUS(os.wait()[1]) == 3
""",
    "a child that is terminated when it begins ends, as one of multiprocessing.Pool": """
simulated.rospy.core.register_signals()
signals.append(signal.SIGTERM)
if not os.fork():
    os._exit(0)
assert os.WTERMSIG(os.wait()[1]) == signal.SIGTERM
assert not signal.pthread_sigmask(signal.SIG_BLOCK, [])
""",
    "after a message, the world knows when a thread is due, also if none sleeps": """
reader, simulated.sleepers.file = os.pipe()
os.set_blocking(reader, False)
subscriber = types.SimpleNamespace(callbacks=[], statistics_logger=None)
simulated.rospy.topics._SubscriberImpl.receive_callback(subscriber, [], None)
assert os.read(reader, 100) == bytes(8)
""",
    "the timeout of a message that does not come passes in simulated time": """
instants, rospy = [simulated.START], simulated.rospy
simulated.read = lambda: instants[-1]
rospy.rostime.wallsleep = lambda seconds: instants.append(instants[-1] + round(1e9 * seconds))
rospy.topics.Subscriber = lambda *_: types.SimpleNamespace(unregister=list)
try:
    rospy.wait_for_message("/topic", None, timeout=0.05)
except rospy.ROSException:
    assert instants[-1] == simulated.START + 50_000_000
    os._exit(0)
raise AssertionError
""",
    "a message is written at once, so the last one is not lost when the node ends": """
written = []
write = lambda data: written.append((data, threading.current_thread()))
transport = types.SimpleNamespace(done=False, set_cleanup_callback=id, write_data=write)
connection = simulated.tcpros_pubsub.QueuedConnection(transport, queue_size=10)
connection.write_data(b"stop")
os._exit(written != [(b"stop", threading.main_thread())])
""",
    "the thread that registers the node ends with it": """
manager = simulated.rospy.impl.registration.RegManager(None)
manager.cleanup("")
assert manager.handler.done
""",
    "otherwise, timeouts would be compared with the real time, and outlast a shutdown": """
assert queue.time is threading._time is simulated.time_of_waits
assert simulated.rospy.core._preshutdown_hooks == [simulated.sleepers.on_shutdown]
assert simulated.rospy.Publisher.get_num_connections is simulated.count_connections
""",
}


def test_programs_with_simulated_time():
    """In forks of one process: each import of rospy takes 0.3 s of processor time."""
    command = [sys.executable, "-c", SIMULATES, repr(PROGRAMS)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (0, "")
    assert queue.time is not simulated_time.time_of_waits


HIDING = {
    "rospy": ({"rospy.py": "print(1)"}, "import rospy\nrospy.Duration(1)"),
    "random": ({"random.py": "print(1)"}, "import rospy"),
    "a message": ({"geometry_msgs/__init__.py": ""}, "from geometry_msgs.msg import Pose"),
    "an unused one, one of the grader, and one that Python has loaded": (
        dict.fromkeys(("queue2.py", "runpy.py", "os.py"), "answer = 3"),
        "import os, queue2, runpy\nprint(queue2.answer, runpy.answer, os.sep)",
    ),
}


@pytest.mark.parametrize("name", HIDING)
def test_a_file_that_hides_a_module(tmp_path, name):
    """Imports have the same result as without the grader: the last line of the output."""
    files, program = HIDING[name]
    for file, text in files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    node = tmp_path / "node.py"
    node.write_text(program)
    with open(simulated_time.__file__) as source, open(os.devnull, "wb") as due:
        hook = ["-c", source.read(), str(due.fileno())]
        runs = [
            subprocess.run(
                ["/usr/bin/python3", *before, node],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                pass_fds=[due.fileno()],
                text=True,
            )
            for before in ([], hook)
        ]
    right, replayed = (run.stdout.splitlines()[-1:] for run in runs)
    assert replayed == right, runs[1].stdout
    assert runs[0].returncode == runs[1].returncode
