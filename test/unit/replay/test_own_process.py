"""Check how the process of a replay ends."""

import os
import signal
import time

import pytest

from mushr_ros_intro.replay import own_process
from mushr_ros_intro.replay.own_process import KilledError


def _blocked_signals():
    return signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_memory_of_the_replay():
    """A node cannot make the process of its replay use all memory."""
    with pytest.raises(KilledError):
        own_process.in_own_process(bytearray, 3_000_000_000, seconds=60.0)


def test_no_signal_is_blocked():
    """The node inherits the mask of signals."""
    assert own_process.in_own_process(_blocked_signals, seconds=60.0) == set()


def test_an_interrupt_while_the_process_of_a_replay_starts(monkeypatch):
    """The process ends, too."""
    started, start = [], own_process._processes.Process.start

    def interrupted(process):
        start(process)
        started.append(process)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(own_process._processes.Process, "start", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        own_process.in_own_process(time.sleep, 60.0, seconds=60.0)
    signal.signal(signal.SIGINT, before)
    assert started[0].exitcode == -signal.SIGKILL
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
