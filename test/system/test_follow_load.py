"""A controller drives equally under any load."""

import contextlib
import glob
import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from mushr_ros_intro.replay.own_process import in_own_process
from support.controllers import copy_controllers, follow, limits_calls, unobserved_threads

STYLES = ("three_threads", "loop", "answer", "timer", "explorer")


def pin_replays(processors):
    """Let the server of multiprocessing, which starts all replays, use some processors only."""
    for path in glob.glob("/proc/self/task/*/children"):
        with contextlib.suppress(FileNotFoundError), open(path, encoding="ascii") as file:  # ended
            for child in file.read().split():
                os.sched_setaffinity(int(child), processors)


@pytest.mark.full
@pytest.mark.parametrize("name", STYLES)
def test_equal_drives(tmp_path, name):
    """Alone on all processors, and two at the same time on one processor."""
    processors = os.sched_getaffinity(0)
    pin_replays(processors)
    copy_controllers(tmp_path)
    alone = follow(name, tmp_path)
    assert alone.passed, alone.verdict
    pin_replays({min(processors)})
    with ThreadPoolExecutor(2) as pool:
        others = list(pool.map(follow, 2 * [name], 2 * [tmp_path]))
    for each in others:
        assert each.recorded.sent == alone.recorded.sent
        assert each.drive.driven.tobytes() == alone.drive.driven.tobytes()
        assert each.verdict == alone.verdict


def test_the_clock_waits_for_all_threads_of_a_replay():
    """A thread may delay another one that waits for the same lock of Python."""
    assert in_own_process(unobserved_threads, seconds=60.0) == ["MainThread"]


def test_a_replay_waits_for_the_answer_of_a_node():
    """It may wait for a processor; after a timeout, rospy would sleep before the next call."""
    assert not in_own_process(limits_calls, seconds=60.0)
