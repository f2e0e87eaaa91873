"""Check how the threads of a node are observed."""

import os
import subprocess
import sys
import threading

import pytest

from mushr_ros_intro.isolation import threads
from mushr_ros_intro.isolation.threads import Threads
from support.helpers import wait_for


@pytest.fixture
def worker():
    """Return a thread that works for a moment when its event is set, and an observer of it."""
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
    assert observer.count == 1
    assert observer.are_waiting() and observer.usages is before


def test_a_thread_that_has_run_meanwhile(worker):
    """Even if it has run for a moment only, between two observations."""
    go, observer = worker
    wait_for(observer.are_waiting, "the worker to wait")
    before = observer.usages
    go.set()
    wait_for(lambda: not go.is_set() and observer.are_waiting(), "the worker to wait again")
    assert observer.usages is not before and observer.count == 1


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
        assert observer.count == 2
        os.kill(child, 9)
        assert parent.stdout.readline() == b"ended\n"
        wait_for(observer.are_waiting, "the parent to wait")
        assert observer.processes == [parent.pid]
        parent.kill()
        parent.wait()
        assert not observer.are_waiting() and observer.processes == []


def test_a_thread_that_has_ended(worker):
    go, observer = worker
    ends = threading.Event()
    threading.Thread(target=ends.wait).start()
    wait_for(lambda: observer.are_waiting() and observer.count == 2, "both threads to wait")
    before = observer.usages
    ends.set()
    wait_for(lambda: observer.are_waiting() and observer.count == 1, "the thread to end")
    assert observer.usages is not before


STARTS_A_THREAD = """
import threading
input()
threading.Thread(target=threading.Event().wait).start()
print(flush=True)
"""


@pytest.mark.parametrize("is_known", [True, False])
def test_new_threads(monkeypatch, tmp_path, is_known):
    """The threads are listed again if a thread of the system is new, or if that is unknown."""
    newest = tmp_path / "newest"
    newest.write_text("1")
    monkeypatch.setattr(threads, "_NEWEST", str(newest if is_known else tmp_path / "missing"))
    command = (sys.executable, "-c", STARTS_A_THREAD)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        observer = Threads(program.pid)
        observer.observe()
        program.stdin.write(b"\n")
        program.stdin.flush()
        assert program.stdout.readline()
        observer.observe()
        assert observer.count == (1 if is_known else 2)
        newest.write_text("2")
        observer.observe()
        assert observer.count == 2
        program.kill()
