"""Run a Python program in simulated time: `python3 -c THIS_FILE PROGRAM ARGUMENT...`.

The program gets the time of ROS from `time.time`, `time.monotonic` and `time.perf_counter`, and
sleeps in it with `time.sleep`, `rospy.sleep`, `rospy.Rate` and `rospy.Timer`. If several threads
are due, each message on /clock wakes one of them, in the order of their due times, so that the
order does not depend on the load of the machine. The random numbers of `random` and
`numpy.random` are the same in each run.

This file is a program of its own, which a node in a sandbox can run without this package.
"""

import heapq
import itertools
import os
import random
import runpy
import sys
import threading
import time
import types
from typing import List, Tuple

import genpy
import rospy
import rospy.impl.simtime

try:  # these must keep the real time, like rospy
    import numpy
    import tf2_ros  # noqa: F401
except ImportError:  # the program does not need them
    numpy = None  # type: ignore

START = 1_000_000_000_000_000_000
"""The time of a replay until the first message on /clock [ns]."""

SHUTDOWN_POLL = 0.3
"""Period at which a sleeping thread notices that ROS has shut down [s of wall-clock time]."""


class Sleepers:
    """The threads that sleep in simulated time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._queue: List[Tuple[int, int, threading.Event]] = []  # due [ns], number, ...
        self._numbers = itertools.count()

    def sleep(self, duration: int) -> None:
        """Sleep for a duration [ns]."""
        woken = threading.Event()
        with self._lock:
            heapq.heappush(self._queue, (read() + duration, next(self._numbers), woken))
        while not woken.wait(SHUTDOWN_POLL):
            if rospy.is_shutdown():
                return

    def on_time(self, now: int) -> None:
        """Wake the thread that is due first at a time [ns], if any."""
        with self._lock:
            if self._queue and self._queue[0][0] <= now:
                heapq.heappop(self._queue)[-1].set()


def is_simulated() -> bool:
    """Return whether ROS has been initialised, and publishes the time."""
    return rospy.rostime.is_rostime_initialized() and not rospy.rostime.is_wallclock()


def read() -> int:
    """Return the time [ns]."""
    return max(START, rospy.get_rostime().to_nsec()) if is_simulated() else START


def simulate(sleepers: Sleepers) -> None:
    """Replace the functions of rospy and of the module time."""
    on_clock, sleep = rospy.impl.simtime._set_rostime_clock_wrapper, time.sleep

    def on_message(msg) -> None:  # type: ignore
        on_clock(msg)
        sleepers.on_time(msg.clock.to_nsec())

    def sleep_in_ros(duration) -> None:  # type: ignore
        if not isinstance(duration, genpy.Duration):
            duration = genpy.Duration.from_sec(duration)
        if duration.to_nsec() > 0:
            sleepers.sleep(duration.to_nsec())
        if rospy.is_shutdown():
            raise rospy.ROSInterruptException("ROS shutdown request")

    def sleep_anywhere(seconds: float) -> None:
        if seconds > 0.0 and is_simulated() and not rospy.is_shutdown():
            sleepers.sleep(round(seconds * 1e9))
        else:
            sleep(seconds)

    rospy.impl.simtime._set_rostime_clock_wrapper = on_message
    rospy.timer.sleep = rospy.sleep = sleep_in_ros
    rospy.rostime.wallsleep = sleep_anywhere  # of rospy.spin and rospy.wait_for_message
    changed = types.ModuleType("time", time.__doc__)
    changed.__dict__.update(vars(time), sleep=sleep_anywhere)
    for name in ("time", "monotonic", "perf_counter"):
        setattr(changed, name, lambda: read() / 1e9)
        setattr(changed, f"{name}_ns", read)
    sys.modules["time"] = changed


def main() -> None:
    """Run the program."""
    simulate(Sleepers())
    random.seed(0)
    if numpy:
        numpy.random.seed(0)
    sys.argv = sys.argv[1:]
    sys.path[0] = os.path.dirname(os.path.realpath(sys.argv[0]))
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
