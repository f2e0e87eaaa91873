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


def test_a_run_that_takes_no_time(worker, monkeypatch):
    """On a virtual machine, a thread may run for 0 ns: only the number of its runs changes."""
    observer = worker[1]
    wait_for(observer.are_waiting, "the worker to wait")
    monkeypatch.setattr(observer, "_usage", lambda files: b"5 5 1")
    observer.observe()
    before = observer.usages
    monkeypatch.setattr(observer, "_usage", lambda files: b"5 5 2")
    observer.observe()
    assert observer.usages is not before and observer.ran < 1.0


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


def test_a_thread_that_is_started_by_one_that_ends(worker):
    """It is observed although no thread has run that was observed before and still lives."""
    go, observer = worker
    wait_for(observer.are_waiting, "the worker to wait")
    start, started, end = threading.Event(), threading.Event(), threading.Event()

    def run():
        start.wait()
        threading.Thread(target=work, daemon=True).start()

    def work():
        started.set()
        end.wait()

    first = threading.Thread(target=run, daemon=True)
    first.start()
    go.set()  # a thread that runs lets the observer look for new ones
    wait_for(lambda: observer.are_waiting() and len(observer.usages) == 2, "both to wait")
    start.set()
    assert started.wait(5.0)
    name = str(first.native_id)
    wait_for(lambda: name not in os.listdir("/proc/self/task"), "the first thread to end")
    observer.observe()
    assert len(observer.usages) == 2 and name not in observer.usages
    end.set()


def test_a_thread_that_ends_before_it_is_read(worker, monkeypatch):
    """The list of threads may lack those after it, so it is read again."""
    go, observer = worker
    wait_for(observer.are_waiting, "the worker to wait")
    lists = [["1"]]
    real = os.listdir
    monkeypatch.setattr(threads.os, "listdir", lambda path: lists.pop() if lists else real(path))
    end = threading.Event()
    threading.Thread(target=end.wait, daemon=True).start()
    go.set()
    wait_for(lambda: observer.observe() or not lists, "the list to be read")
    wait_for(observer.are_waiting, "both to wait")
    assert len(observer.usages) == 2
    end.set()
