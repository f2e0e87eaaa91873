"""Check how the threads of a node are observed."""

import os
import subprocess
import sys
import threading

import pytest

from mushr_ros_intro.isolation import threads
from mushr_ros_intro.isolation.threads import Threads
from support.helpers import wait_for


@pytest.fixture(params=[True, False], ids=["statistics", "no_statistics"])
def worker(request, monkeypatch):
    """Return a thread that works for a moment when its event is set, and an observer of it.

    Without statistics of the scheduler, the observer reads other files.
    """
    if not request.param:
        monkeypatch.setattr(threads, "_has_statistics", lambda: False)
    go = threading.Event()

    def work():
        while go.wait():
            go.clear()
            sum(range(100))

    others = list(map(int, os.listdir("/proc/self/task")))
    threading.Thread(target=work, daemon=True).start()
    return go, Threads(os.getpid(), False, others)


def test_a_thread_that_waits(worker):
    go, observer = worker
    wait_for(observer.are_waiting, "the worker to wait")
    before = observer.usages
    assert len(before) == 1
    assert observer.are_waiting() and observer.usages is before


def test_a_thread_that_has_run_meanwhile(worker):
    """Even if it has run for a moment only, between two observations."""
    go, observer = worker
    wait_for(observer.are_waiting, "the worker to wait")
    before = observer.usages
    go.set()
    wait_for(lambda: not go.is_set() and observer.are_waiting(), "the worker to wait again")
    assert observer.usages is not before and observer.usages.keys() == before.keys()


STARVED = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
print("runs", flush=True)
while True:
    pass
"""


def test_a_thread_that_waits_for_a_processor():
    """It does not count as waiting; two programs on one processor run for half of the time each."""
    command = (sys.executable, "-c", STARVED)
    programs = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
    try:
        for each in programs:
            assert each.stdout.readline()
        observer = Threads(programs[0].pid)
        observer.observe()
        before = observer.ran

        def has_run():
            assert not observer.are_waiting()
            return observer.ran > before + 0.05

        wait_for(has_run, "the program to run")
    finally:
        for each in programs:
            each.kill()
            each.communicate()


PARENT = """
import os, time
child = os.fork()
if not child:
    time.sleep(300)
print(child, flush=True)
os.waitpid(child, 0)
print("ended", flush=True)
time.sleep(300)
"""


def test_child_processes():
    """They are observed, too, as long as they live."""
    with subprocess.Popen((sys.executable, "-c", PARENT), stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        observer = Threads(parent.pid)
        wait_for(observer.are_waiting, "both to wait")
        assert observer.processes == [parent.pid, child]
        assert set(observer.usages) == {str(parent.pid), str(child)}
        os.kill(child, 9)
        assert parent.stdout.readline() == b"ended\n"
        wait_for(observer.are_waiting, "the parent to wait")
        assert observer.processes == [parent.pid]
        parent.kill()
        parent.wait()
        assert not observer.are_waiting() and observer.processes == []


@pytest.mark.parametrize("is_own", [True, False])
def test_files_are_read_if_a_thread_has_run(worker, monkeypatch, is_own):
    """Clocks of processor time show it: of the threads of this process, or of another process."""
    program = subprocess.Popen(("cat",), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    observer = worker[1] if is_own else Threads(program.pid)
    wait_for(observer.are_waiting, "the thread to wait")
    observer.observe()
    reads = []
    monkeypatch.setattr(observer, "_usage", lambda files: reads.append(files) or b"1")
    observer.observe()
    assert not reads
    if is_own:
        worker[0].set()
    else:
        program.communicate(b"x")
    wait_for(lambda: observer.observe() or reads, "a thread to run")
