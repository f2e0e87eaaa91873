"""Run a Python program in simulated time: `python3 -c THIS_FILE FILE PROGRAM ARGUMENT...`.

The clocks of the modules time and datetime advance with the time of ROS, from other values on, so
that a stamp of one of them is recognised. The program sleeps in this time with `time.sleep`,
`rospy.sleep`, `rospy.Rate` and `rospy.Timer`, and waits in it with the timeouts of threading,
queue, select, selectors, asyncio and `rospy.wait_for_message`. A thread that reads the time, or
counts the connections of a topic, again and again sleeps for POLL_PERIOD. Before ROS publishes the
time, and after it has ended, the clocks advance by such sleeps only. The functions of `random`
and `numpy.random` give the same random numbers in each run; a generator without a seed does not.

If several threads are due, each message on /clock wakes one of them, in the order of their due
times. So the order does not depend on the load of the machine. The program writes to FILE, the
number of an open pipe, when the next thread is due [ns], as 8 bytes, little-endian; 0 if no thread
sleeps. It does this when a thread falls asleep, and when a thread has processed a message that
has woken no other one.

Libraries of ROS, and child processes, keep the real time, and so do the modules subprocess and
multiprocessing, which wait for child processes. A message to the node itself is sent at once: if
TCP collected small ones, all threads would wait while a message is on its way.

This file is a program of its own, which a node in a sandbox can run without this package.
"""

# ruff: noqa: E402

import sys

STARTED_WITH = set(sys.modules)
"""The modules that a file of the program cannot hide: Python has loaded them before."""

import os
import runpy

if __name__ == "__main__":
    folder = os.path.dirname(os.path.realpath(sys.argv[2]))
    sys.path[0] = folder  # instead of the current directory, as if Python had started the program
    import rospy  # and the modules that it imports: files of the program hide them as in rosrun

    if not hasattr(rospy, "__path__"):  # it is such a file
        sys.argv = sys.argv[2:]
        runpy.run_path(sys.argv[0], run_name="__main__")
        sys.exit()
    del sys.path[0]

import contextlib
import datetime
import heapq
import http.server
import itertools
import multiprocessing
import queue
import random
import select
import selectors
import signal
import socket
import subprocess
import threading
import time
from functools import partial
from types import SimpleNamespace
from typing import Any, Callable, List, Optional, Tuple

import genpy
import rosgraph
import rospy
import rospy.impl.registration
import rospy.impl.simtime
from rospy.impl import tcpros_base, tcpros_pubsub

START = 1_000_000_000_000_000_000
"""The time of ROS until the first message on /clock [ns]."""

STARTS = {"time": 1_800_000_000_000_000_000, "monotonic": 0, "perf_counter": 0}
"""The times of other clocks then, by their names in the module time [ns]."""

CLOCKS = {
    time.CLOCK_REALTIME: "time",
    **dict.fromkeys((time.CLOCK_MONOTONIC, time.CLOCK_MONOTONIC_RAW), "monotonic"),
    time.CLOCK_BOOTTIME: "monotonic",
}
"""Their names by the numbers for clock_gettime; the other clocks measure processor time."""

SHUTDOWN_POLL = 0.001
"""Period at which a thread waits for the end of a shutdown of ROS [s of wall-clock time]."""

MAX_READS = 100
"""A thread that calls `poll` more often at the same time polls something."""

POLL_PERIOD = 10_000_000
"""A thread that polls looks once in this time [ns]."""

ROUNDING = 1e-10
"""Between the errors of times as floats and half a nanosecond [s]."""

LIBRARIES = (os.path.dirname(os.__file__) + os.sep, "<frozen", sys._getframe().f_code.co_filename)
"""Files of the standard library, and this one: they act for the file that calls them."""

_FOLDERS: Tuple[Any, ...] = (rospy, rosgraph, genpy, multiprocessing)
REAL_TIME = (
    *(os.path.dirname(each.__file__) + os.sep for each in _FOLDERS),
    *(subprocess.__file__, http.server.__file__),
)
"""Files that keep the real time; multiprocessing and subprocess wait for processes that have it."""

real_sleep, real_wait, get_rostime = time.sleep, threading.Condition.wait, rospy.get_rostime
real_time, real_monotonic = time.time, time.monotonic
real_count = rospy.topics.Topic.get_num_connections
real_clean_up = rospy.impl.registration.RegManager.cleanup
slept = 0
"""For how long the program has slept while ROS did not publish the time [ns]."""

is_child = False
"""Whether this is a child process of a node, in which no thread receives /clock."""


class Waiter:
    """What a thread waits for: it is released by another thread, or when it is due."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._lock.acquire()
        self.acquire = self._lock.acquire

    def release(self) -> None:
        """Let the thread run."""
        with contextlib.suppress(RuntimeError):  # it was released
            self._lock.release()


class Sleepers:
    """The threads that sleep in simulated time."""

    def __init__(self) -> None:
        self.file: Optional[int] = None
        """The number of the open pipe."""
        self._lock = threading.RLock()  # a signal handler may shut down ROS at any time
        self._queue: List[Tuple[int, int, Waiter]] = []  # due [ns], number, ...
        self._numbers = itertools.count()
        self._has_woken = False  # a thread, which has not slept since then
        self._is_over = False  # no thread receives /clock any more

    def sleep(self, duration: int, waiter: Optional[Waiter] = None) -> bool:
        """Sleep for a duration [ns], or until another thread releases `waiter`; return if it did.

        If ROS shuts down, the sleep ends afterwards.
        """
        entry = (read() + duration, next(self._numbers), waiter or Waiter())
        with self._lock:
            heapq.heappush(self._queue, entry)
            self._has_woken = False
            self._write()
            if self._is_over:
                entry[-1].release()
        entry[-1].acquire()
        with self._lock:
            is_due = entry not in self._queue
            if not is_due:
                self._queue.remove(entry)
                heapq.heapify(self._queue)
                self._write()
        if is_due or (waiter and not rospy.core.is_shutdown_requested()):
            return not is_due
        while not rospy.is_shutdown():
            real_sleep(SHUTDOWN_POLL)
        return False

    def on_time(self, now: int) -> None:
        """Wake the thread that is due first at a time [ns], if any."""
        with self._lock:
            self._has_woken = bool(self._queue) and self._queue[0][0] <= now
            if self._has_woken:
                heapq.heappop(self._queue)[-1].release()

    def on_processed(self) -> None:
        """Note that a thread has processed a message."""
        with self._lock:
            if not self._has_woken:
                self._write()

    def _write(self) -> None:
        if self.file is not None:
            due = self._queue[0][0] if self._queue else 0
            os.write(self.file, due.to_bytes(8, "little"))

    def on_shutdown(self, reason: str) -> None:
        """Wake all threads, also those that begin to sleep later."""
        with self._lock:
            self._is_over = True
            for _, _, waiter in self._queue:
                waiter.release()


class Reads(threading.local):
    """How often a thread has called `poll` at a time, and whether its last wait has expired."""

    time, count, has_expired = 0, 0, False


sleepers, reads = Sleepers(), Reads()


def is_initialized() -> bool:
    """Return whether ROS publishes the time, and runs."""
    is_known = rospy.rostime.is_rostime_initialized() and not rospy.rostime.is_wallclock()
    return is_known and not is_child and not rospy.is_shutdown()


def is_for_node() -> bool:
    """Return whether a file of the node has called a function, itself or through a library."""
    frame: Any = sys._getframe(1)
    while frame and not frame.f_code.co_filename.startswith(REAL_TIME):
        if not frame.f_code.co_filename.startswith(LIBRARIES):
            return True
        frame = frame.f_back
    return not frame


def is_simulated() -> bool:
    """Return whether to use the simulated time."""
    return is_initialized() and is_for_node()


def read() -> int:
    """Return the time [ns]; after ROS has ended, the last one."""
    is_known = rospy.rostime.is_rostime_initialized() and not rospy.rostime.is_wallclock()
    return max(START, get_rostime().to_nsec()) if is_known and not is_child else START


def sleep_without_ros(seconds: float) -> None:
    """Sleep in real time, and let the clocks of the program advance as far [s]."""
    global slept
    real_sleep(seconds)
    slept += round(seconds * 1e9)


def poll() -> None:
    """Note that a thread reads what a loop may wait for: the time, or a number of connections."""
    now = read()
    if now != reads.time:
        reads.time, reads.count = now, 0
    reads.count += 1
    if reads.count > MAX_READS and not is_child:
        reads.count = 0
        sleep_for(POLL_PERIOD / 1e9)


def count_connections(topic: Any) -> int:
    """Return how many connections a topic has, as `get_num_connections` of rospy."""
    poll()
    return int(real_count(topic))


def simulate_clock(name: str, start: int) -> None:
    """Replace a clock of the module time, given its time at START [ns]."""

    def replace(name: str, convert: Callable[[int], Any]) -> None:
        real = getattr(time, name)

        def now() -> Any:
            if is_child or not is_for_node():
                return real()
            poll()
            return convert(read() + slept - START + start)

        setattr(time, name, now)

    replace(name, lambda now: now / 1e9)
    replace(f"{name}_ns", lambda now: now)


def simulate_clock_gettime(ending: str) -> None:
    """Replace `time.clock_gettime` or, with the ending "_ns", `time.clock_gettime_ns`."""
    real = getattr(time, f"clock_gettime{ending}")

    def gettime(clock: int) -> Any:
        return getattr(time, CLOCKS[clock] + ending)() if clock in CLOCKS else real(clock)

    setattr(time, f"clock_gettime{ending}", gettime)


class Datetime(datetime.datetime):
    """A datetime that reads the time with `time.time`, as `datetime.datetime.today` does."""

    __module__, __qualname__ = "datetime", "datetime"  # for pickle

    def __repr__(self) -> str:
        return f"datetime.{super().__repr__()}"

    @classmethod
    def now(cls, tz: Optional[datetime.tzinfo] = None) -> "Datetime":
        """Return the time in a time zone."""
        return cls.fromtimestamp(time.time(), tz)

    @classmethod
    def utcnow(cls) -> "Datetime":
        """Return the time in UTC, without a time zone."""
        return cls.now(datetime.timezone.utc).replace(tzinfo=None)


def read_in_ros() -> Any:
    """Return the time, as `rospy.get_rostime`; START before the first message on /clock."""
    poll()
    return max(get_rostime(), rospy.Time(0, START))


def sleep_in_ros(duration: Any) -> None:
    """Sleep, as `rospy.sleep`."""
    if not isinstance(duration, genpy.Duration):
        duration = genpy.Duration.from_sec(duration)
    if duration.to_nsec() > 0:
        sleepers.sleep(duration.to_nsec())
    if rospy.is_shutdown():
        raise rospy.ROSInterruptException("ROS shutdown request")


def sleep_for(seconds: float) -> None:
    """Sleep, as the functions of rospy that sleep in wall-clock time."""
    if seconds > 0.0 and is_initialized():
        sleepers.sleep(round(seconds * 1e9))
    else:
        sleep_without_ros(seconds)


def sleep(seconds: float) -> None:
    """Sleep, as `time.sleep`."""
    (sleep_for if is_for_node() else real_sleep)(seconds)


def time_of_waits() -> float:
    """Return the time with which threading and queue measure timeouts, also before `START` [s].

    After a wait that has expired, it is later than the end of the wait, whatever the rounding.
    """
    late, reads.has_expired = ROUNDING * reads.has_expired, False
    return time.monotonic() + late if is_simulated() else real_monotonic()


def wait(condition: Any, timeout: Optional[float] = None) -> bool:
    """Wait, as `threading.Condition.wait`."""
    if timeout is None or timeout <= 0.0 or not is_simulated():
        return bool(real_wait(condition, timeout))
    waiter = Waiter()
    condition._waiters.append(waiter)
    state = condition._release_save()
    try:
        is_released = sleepers.sleep(round(timeout * 1e9), waiter)
        reads.has_expired = not is_released
        return is_released
    finally:
        condition._acquire_restore(state)
        with contextlib.suppress(ValueError):
            condition._waiters.remove(waiter)


def wait_for_files(look: Callable[[Any], Any], timeout: Any, unit: int = 1_000_000_000) -> Any:
    """Wait until files are ready, and return them; look for them once in POLL_PERIOD.

    Args:
        look: the real function, which waits for at most its argument.
        timeout: in units of `unit` [ns]; None or a negative number for no limit.
        unit: see `timeout`.
    """
    if timeout is None or timeout <= 0.0 or not is_simulated():
        return look(timeout)
    due = read() + round(timeout * unit)
    while not any(found := look(0)) and read() < due and is_initialized():
        sleepers.sleep(min(POLL_PERIOD, due - read()))
    return found


class Poll:
    """A `select.poll` or `select.epoll` that waits in simulated time."""

    def __init__(self, kind: Any, unit: int, *arguments: Any, **options: Any) -> None:
        """Create a real one of a kind, whose timeouts have a unit [ns]."""
        self._real, self._unit = kind(*arguments, **options), unit

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def __enter__(self) -> "Poll":
        return self

    def __exit__(self, *_: Any) -> None:
        self._real.close()

    def poll(self, timeout: Any = None, *most: Any, **options: Any) -> Any:
        """Return the files that are ready, and their events."""
        return wait_for_files(lambda t: self._real.poll(t, *most, **options), timeout, self._unit)


def simulate_files() -> None:
    """Replace what waits for files."""

    def of_selector(real: Callable[..., Any]) -> Callable[..., Any]:
        return lambda selector, timeout=None: wait_for_files(partial(real, selector), timeout)

    # The methods call poll and epoll with timeouts that are rounded up to whole milliseconds.
    poll_like: Any = selectors._PollLikeSelector
    for each in (selectors.SelectSelector, poll_like, selectors.EpollSelector):
        each.select = of_selector(each.select)  # type: ignore
    real = select.select
    select.select = lambda *files: wait_for_files(partial(real, *files[:3]), *files[3:] or [None])
    select.poll = partial(Poll, select.poll, 1_000_000)  # type: ignore
    select.epoll = partial(Poll, select.epoll, 1_000_000_000)  # type: ignore


def simulate_forks() -> None:
    """Let a child process keep the real time, and end at a signal.

    rospy's handler would end ROS for the node, too. Python drops a signal that comes while the
    child begins, as from multiprocessing.Pool; so both signals are blocked until then.
    """
    signals, masks = (signal.SIGINT, signal.SIGTERM), threading.local()

    def block() -> None:
        masks.before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)

    def unblock() -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, masks.before)

    def begin() -> None:
        global is_child
        is_child = is_child or is_initialized()  # otherwise the child can become the node
        for number in signals:
            if signal.getsignal(number) == rospy.core._ros_signal:
                signal.signal(number, signal.SIG_DFL)
        unblock()

    os.register_at_fork(before=block, after_in_parent=unblock, after_in_child=begin)


def write_at_once(connection: Any, data: bytes) -> Any:
    """Write a message in the thread that publishes it.

    With a queue_size, another thread of rospy writes it. Then the last messages of a node are lost
    if the node ends before this thread runs, which depends on the load of the machine.
    """
    return connection._connection.write_data(data)


def write_header(connection: socket.socket, header: Any) -> int:
    """Write the first message of a connection; TCP sends it, and each later one, at once."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return int(rosgraph.network.write_ros_handshake_header(connection, header))


def clean_up(manager: Any, reason: str) -> None:
    """Unregister the node at the master, and end the thread that does this.

    Otherwise, it looks every 0.5 s whether to end, and another thread polls a closed socket.
    """
    manager.handler = SimpleNamespace(done=True)
    real_clean_up(manager, reason)


def simulate() -> None:
    """Replace the functions."""
    on_clock = rospy.impl.simtime._set_rostime_clock_wrapper
    process = rospy.topics._SubscriberImpl.receive_callback

    def on_message(msg: Any) -> None:
        on_clock(msg)
        sleepers.on_time(msg.clock.to_nsec())

    def receive(*arguments: Any) -> None:
        process(*arguments)
        sleepers.on_processed()

    simulate_forks()
    rospy.core.add_preshutdown_hook(sleepers.on_shutdown)
    rospy.impl.simtime._set_rostime_clock_wrapper = on_message
    rospy.topics._SubscriberImpl.receive_callback = receive
    tcpros_pubsub.QueuedConnection.write_data = write_at_once
    tcpros_base.write_ros_handshake_header = write_header
    rospy.topics.Topic.get_num_connections = count_connections
    rospy.impl.registration.RegManager.cleanup = clean_up
    rospy.timer.sleep = rospy.sleep = sleep_in_ros
    rospy.rostime.get_rostime = rospy.get_rostime = read_in_ros
    rospy.rostime.wallsleep = sleep_for  # of rospy.spin and rospy.wait_for_message
    time.sleep = sleep
    for name, start in STARTS.items():
        simulate_clock(name, start)
    for ending in ("", "_ns"):
        simulate_clock_gettime(ending)
    datetime.datetime, Datetime.__name__ = Datetime, "datetime"  # type: ignore
    # For the timeout of rospy.wait_for_message.
    rospy.client.time = SimpleNamespace(time=lambda: real_time() if is_child else read() / 1e9)
    threading._time = queue.time = time_of_waits  # type: ignore
    threading.Condition.wait = wait  # type: ignore
    queue.SimpleQueue = queue._PySimpleQueue  # type: ignore # the other one is in C
    simulate_files()


def is_hidden(module: str) -> bool:
    """Return whether a file of the program has the name of a module that comes from elsewhere."""
    path = os.path.join(folder, module)
    origin = getattr(sys.modules.get(module), "__file__", None) or ""
    exists = os.path.isfile(f"{path}.py") or os.path.isfile(os.path.join(path, "__init__.py"))
    return exists and not origin.startswith(os.path.join(folder, ""))


def main() -> None:
    """Run the program."""
    simulate()
    with contextlib.suppress(AttributeError):  # of a file of the program
        random.seed(0)
    with contextlib.suppress(ImportError):
        import numpy

        numpy.random.seed(0)
    sleepers.file = int(sys.argv[1])
    os.set_inheritable(sleepers.file, False)
    sys.argv = sys.argv[2:]
    sys.path.insert(0, folder)
    for name in set(sys.modules) - STARTED_WITH - set(sys.builtin_module_names):
        if is_hidden(name.partition(".")[0]):
            del sys.modules[name]  # of this file only; rospy does not need it
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
