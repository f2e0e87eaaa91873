"""Check how the process of a node is started, described and ended."""

import sys

import pytest

from mushr_ros_intro.isolation import node_process
from mushr_ros_intro.isolation.node_process import MAX_OUTPUT, NodeProcess
from support.helpers import wait_for

LEAVES = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
child = os.fork()
os.setsid() if child == 0 else None
print(os.getpid(), flush=True) if child == 0 else None
time.sleep(300)
"""


def run(*command, has_namespaces=False):
    """Run a program to its end; return the description of its failure."""
    process = NodeProcess(["env", "-i", *command], has_namespaces)
    wait_for(lambda: process.has_ended, "the end of the program")
    process.end()
    return process.describe_failure()


@pytest.mark.parametrize(
    ("line", "mode", "status"),
    [("#!/nowhere/python", 0o755, 127), ("#!/usr/bin/python3", 0o644, 126)],
)
def test_programs_that_cannot_be_started(tmp_path, line, mode, status):
    program = tmp_path / "node.py"
    program.write_text(f"{line}\n")
    program.chmod(mode)
    failure = run(str(program))
    assert f"status {status} (does its first line name an existing interpreter, and" in failure


def test_ends():
    assert run("true") == ""
    assert run("false") == "the node ended with exit status 1; it printed nothing"
    assert "killed by signal SIGKILL" in run("python3", "-c", "import os; os.kill(os.getpid(), 9)")


def test_signal_in_bwrap():
    """bwrap adds 128 to the number of the signal that has killed the node."""
    assert "killed by signal SIGKILL" in run("sh", "-c", "exit 137", has_namespaces=True)
    assert "killed by signal SIGHUP" in run("sh", "-c", "exit 129", has_namespaces=True)
    assert "exit status 128" in run("sh", "-c", "exit 128", has_namespaces=True)
    assert "exit status 137" in run("sh", "-c", "exit 137")
    assert "killed by signal 35;" in run("sh", "-c", "kill -35 $$")  # it has no name


@pytest.mark.parametrize(
    ("waits", "shown"), [("time.sleep(300)", []), ("stop()", ["Traceback", "rospy."])]
)
def test_the_exception_of_a_node_that_is_ended_is_not_shown(tmp_path, waits, shown):
    """Only if the end caused it."""
    program = tmp_path / "node.py"
    program.write_text(f"""
import os, rospy, signal, time
def stop(*_):
    raise rospy.ROSInterruptException("ROS shutdown request")
signal.signal(signal.SIGINT, stop)
os.write(1, b"drives\\n")
{waits}
""")
    process = NodeProcess([sys.executable, str(program)])
    wait_for(lambda: process.has_ended if shown else "drives" in process.output, "the node")
    process.end()
    lines = [line for line in process.output.splitlines() if not line.startswith(" ")]
    assert [line[: len(start)] for line, start in zip(lines[1:], shown)] == shown
    assert lines[0] == "drives" and len(lines) == 1 + len(shown)


def test_the_last_output(monkeypatch):
    """It is complete, also if the thread that reads it waits for a processor."""
    monkeypatch.setattr(NodeProcess, "_read_all", lambda process: None)
    process = NodeProcess(["sh", "-c", "echo before; sleep 300 & echo 'the end'; exit 1"])
    wait_for(lambda: process.has_ended, "the end of the program")
    assert process.describe_failure().endswith("its last output:\nbefore\nthe end")
    process.end()
    process = NodeProcess(["sh", "-c", "echo runs; sleep 300"])
    wait_for(lambda: process.output == "runs", "the output", 5.0)
    process.end()


TRACEBACK = """Traceback (most recent call last):
  File "/usr/lib/python3.9/runpy.py", line 87, in _run_code
    exec(code, run_globals)
  File "/s/node.py", line 3, in <module>
    rospy.sleep("a")
  File "<string>", line 280, in sleep_in_ros
    duration = genpy.Duration.from_sec(duration)
    ^^^^
  File "<frozen runpy>", line 88, in _run_code
  File "/usr/lib/genpy.py", line 5, in from_sec
TypeError: a
"""


def test_a_traceback_has_no_lines_of_the_grader():
    process = NodeProcess(["sh", "-c", f"echo '{TRACEBACK}'; exit 1"])
    shown = process.describe_failure()
    process.end()
    lines = TRACEBACK.splitlines()
    expected = [lines[0], *lines[3:5], *lines[9:]]
    assert shown.splitlines()[1:] == expected
    assert "sys.exit" not in shown


def test_an_exit_with_a_text():
    """Python prints the text, and the exit status is 1."""
    shown = run(sys.executable, "-c", "import sys; sys.exit('done')")
    assert "exit status 1 (sys.exit with a text means status 1); its last output:\ndone" in shown


def test_too_much_output():
    process = NodeProcess(["head", "-c", str(MAX_OUTPUT + 1), "/dev/zero"])
    fault = wait_for(process.excess, "all output")
    assert fault == "the node printed more than 50 MB of output"
    process.end()


SHARES = """
import mmap, os, time
memory = mmap.mmap(-1, 50_000_000)
os.fork()
memory[:] = bytes(len(memory))
time.sleep(300)
"""
"""Shared memory is no data of a process, so that the limit of the operating system ignores it."""

MAPS = """
import mmap, time
size = 40_000_000_000
memory = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, mmap.PROT_READ)
memory.madvise(mmap.MADV_NOHUGEPAGE)
for place in range(0, size, 2 << 20):
    memory[place]
time.sleep(300)
"""
"""The pages that it reads are all the same one, but each needs a page table."""

STARTS = """
import threading, time
for _ in range(30):
    threading.Thread(target=time.sleep, args=[300], daemon=True).start()
time.sleep(300)
"""


@pytest.mark.parametrize(
    ("code", "name", "limit", "message"),
    [
        (SHARES, "MAX_MEMORY", 60_000_000, "used more than 60 MB of memory"),
        (MAPS, "MAX_MEMORY", 60_000_000, "used more than 60 MB of memory"),
        (STARTS, "MAX_THREADS", 20, "started more than 20 processes and threads"),
    ],
)
def test_limits(monkeypatch, code, name, limit, message):
    """The limits hold for all processes of the node together."""
    monkeypatch.setattr(node_process, name, limit)
    process = NodeProcess([sys.executable, "-c", code])
    assert message in wait_for(process.excess, "a limit")
    wait_for(lambda: process.has_ended, "the end of the node")
    process.end()


def test_child_processes_end_too(tmp_path):
    """Also those that ignore SIGINT and have left the process group."""
    out = tmp_path / "out"
    process = NodeProcess(["sh", "-c", f"exec python3 -c '{LEAVES}' >{out}"])
    wait_for(lambda: out.exists() and out.read_text().strip(), "the child process")
    child = int(out.read_text())
    process.end()

    def is_gone():
        try:
            with open(f"/proc/{child}/stat") as file:
                return file.read().rpartition(")")[2].split()[0] == "Z"
        except (FileNotFoundError, ProcessLookupError):
            return True

    wait_for(is_gone, "the end of the child process")
