"""Check how the process of a replay ends."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from mushr_ros_intro.replay import own_process
from mushr_ros_intro.replay.own_process import KilledError
from support.helpers import wait_for


def _blocked_signals():
    return signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_memory_of_the_replay():
    """A node cannot make the process of its replay use all memory."""
    with pytest.raises(KilledError):
        own_process.in_own_process(bytearray, 3_000_000_000, seconds=60.0)


def _start_thread(pid_file, gate):
    """Write the number of this process; end when the gate exists, beside a thread that stays."""
    threading.Thread(target=time.sleep, args=[300.0]).start()
    with open(f"{pid_file}.new", "w") as file:
        file.write(str(os.getpid()))
    os.rename(f"{pid_file}.new", pid_file)
    while not os.path.exists(gate):
        time.sleep(0.01)


def test_the_parent_process_is_killed(tmp_path):
    """The process of the replay ends after the replay, although nobody receives its result."""
    pid_file, gate = str(tmp_path / "pid"), str(tmp_path / "gate")
    code = (
        "import sys; import test_own_process as this; "
        "this.own_process.in_own_process(this._start_thread, *sys.argv[1:], seconds=300.0)"
    )
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path]),
    }
    command = [sys.executable, "-c", code, pid_file, gate]
    with subprocess.Popen(command, env=environment) as parent:
        wait_for(lambda: os.path.exists(pid_file), "the process of the replay")
        parent.kill()
    with open(pid_file) as file:
        process = f"/proc/{file.read()}"
    assert os.path.exists(process)
    open(gate, "w").close()
    wait_for(lambda: not os.path.exists(process), "the end of the process of the replay")


def test_no_more_signals_are_blocked():
    """The node inherits the mask of signals."""
    found = own_process.in_own_process(_blocked_signals, seconds=60.0)
    assert found == signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_an_interrupt_while_the_process_of_a_replay_starts(monkeypatch):
    """The process ends, too."""
    kind = own_process.prepared_processes().Process
    started, start = [], kind.start

    def interrupted(process):
        start(process)
        started.append(process)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(kind, "start", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        own_process.in_own_process(time.sleep, 60.0, seconds=60.0)
    signal.signal(signal.SIGINT, before)
    assert started[0].exitcode == -signal.SIGKILL
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
