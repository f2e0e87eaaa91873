"""Start, watch and end the process of the node in a replay."""

import contextlib
import os
import re
import signal
import subprocess
import threading
from functools import partial
from typing import Iterable, Iterator, List, NamedTuple, Optional

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.stamps import NANOSECONDS

SHOWN_LINES = 15
"""Number of lines at the end of the node's output that a message quotes."""

KEPT_OUTPUT = 20_000
"""Size of the kept end of a node's output [bytes]."""

IDLE_SHARE = 0.1
"""A node that runs for a smaller share of the time is idle, also if it polls the time."""

MAX_OUTPUT = 50_000_000
"""A node that prints more has failed [bytes]."""

MAX_MEMORY = 1_500_000_000
"""A node has failed if all its processes together use more memory [bytes]."""

MAX_THREADS = 250
"""A node that starts more has failed."""


def _read(path: str) -> str:
    with open(path, encoding="ascii", errors="replace") as file:
        return file.read()


def activity_of(threads: Iterable[str]) -> Optional[int]:
    """Return the time for which threads have run [ns]; None if one of them runs now.

    If two calls return the same number, the threads are idle, also on a busy machine.

    Args:
        threads: their folders in /proc.
    """
    total = 0
    with contextlib.suppress(OSError, ValueError):  # a process or a thread has ended
        for folder in threads:
            if _read(f"{folder}/stat").rpartition(")")[2].split()[0] == "R":
                return None
            total += int(_read(f"{folder}/schedstat").split()[0])
        return total
    return None


def delay_of(threads: Iterable[str]) -> float:
    """Return for how long threads have waited for a processor [s]; args as for `activity_of`."""
    total = 0
    with contextlib.suppress(OSError, ValueError):
        for folder in threads:
            total += int(_read(f"{folder}/schedstat").split()[1])
    return total / NANOSECONDS


def _memory_of(process: int) -> int:
    """Return the memory that a process uses, without that of files [bytes]; raise OSError."""
    sizes = re.findall(r"^Rss(?:Anon|Shmem):\s*(\d+) kB$", _read(f"/proc/{process}/status"), re.M)
    return 1024 * sum(map(int, sizes))


class Sample(NamedTuple):
    """What the node and this process have done so far."""

    time: float
    """[s of monotonic wall-clock time]"""
    node: Optional[int]
    """The activity of the node [ns]; see `activity_of`."""
    received: Optional[int]
    """The activity of the threads that receive its messages [ns]."""

    def is_idle_since(self, before: "Sample") -> bool:
        """Return whether the node was idle, and all its messages have been processed here."""
        if None in (*self, *before):
            return False
        share = (self.node - before.node) / NANOSECONDS / (self.time - before.time)  # type: ignore
        return share <= IDLE_SHARE and self.received == before.received


def receiving_activity() -> Optional[int]:
    """Return the activity of the threads that receive messages; see `activity_of`.

    rospy gives them the names of the topics.
    """
    threads = (each for each in threading.enumerate() if each.name.startswith("/"))
    return activity_of(f"/proc/self/task/{each.native_id}" for each in threads)


class NodeProcess:
    """The process of the node in a replay, with all processes of its group."""

    def __init__(self, command: List[str], has_namespaces: bool = False) -> None:
        """Start the node.

        Args:
            command: the program and its arguments, which include the environment.
            has_namespaces: whether it is bwrap, which runs the node in a process group of its own.

        Raises:
            UserError: the program cannot be started.
        """
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except OSError as error:
            raise UserError(f"{command[0]} cannot be started ({error.strerror})") from None
        self._has_namespaces = has_namespaces
        self._output = b""
        self._printed = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout
        for chunk in iter(partial(os.read, self._process.stdout.fileno(), 65536), b""):
            self._output = (self._output + chunk)[-KEPT_OUTPUT:]
            self._printed += len(chunk)

    def excess(self) -> str:
        """Return which limit the node has exceeded; empty if none. If it has, kill it."""
        fault = ""
        with contextlib.suppress(OSError):  # a process has ended
            if self._printed > MAX_OUTPUT:
                fault = f"the node printed more than {MAX_OUTPUT / 1e6:g} MB of output"
            elif sum(1 for _ in self._threads()) > MAX_THREADS:
                fault = f"the node started more than {MAX_THREADS} processes and threads"
            elif sum(map(_memory_of, [self._process.pid, *self._children()])) > MAX_MEMORY:
                fault = f"the node used more than {MAX_MEMORY / 1e6:g} MB of memory"
        if fault:
            self._kill()
        return fault

    @property
    def has_ended(self) -> bool:
        """Whether the node's process has ended."""
        return self._process.poll() is not None

    @property
    def output(self) -> str:
        """The end of the node's output, without control characters, which XML must not contain."""
        lines = self._output.decode(errors="replace").splitlines()
        return "\n".join("".join(c for c in line if c.isprintable()) for line in lines)

    def activity(self) -> Optional[int]:
        """Return the activity of the node's threads; see `activity_of`."""
        return activity_of(self._threads())

    @property
    def delay(self) -> float:
        """The time for which the node and this process have waited for a processor [s].

        A busy machine delays a node by this time, at most.
        """
        here = (f"/proc/self/task/{task}" for task in os.listdir("/proc/self/task"))
        return delay_of(self._threads()) + delay_of(here)

    def _threads(self) -> Iterator[str]:
        """Yield the folders in /proc of all threads of the node and of its child processes.

        Raises:
            OSError: a process or a thread has ended.
        """
        processes = [str(self._process.pid)]
        for process in processes:
            for thread in os.listdir(f"/proc/{process}/task"):
                folder = f"/proc/{process}/task/{thread}"
                yield folder
                processes += _read(f"{folder}/children").split()

    def _children(self) -> List[int]:
        """Return the numbers of all child processes, and of theirs, in the order of `_threads`."""
        processes = (int(folder.split("/")[2]) for folder in self._threads())
        return [each for each in dict.fromkeys(processes) if each != self._process.pid]

    def end(self) -> None:
        """End the node, its child processes, and all processes of its group."""
        with contextlib.suppress(OSError, IndexError):  # it has ended
            processes = [self._process.pid, *self._children()]
            # The first process in bwrap's namespace ignores the signal.
            os.killpg(processes[int(self._has_namespaces)], signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(3.0)
        self._kill()
        self._process.wait(10.0)
        self._reader.join(1.0)

    def _kill(self) -> None:
        """Kill all processes, also those that have left the group of the first one."""
        with contextlib.suppress(OSError):
            for process in self._children():
                os.kill(process, signal.SIGKILL)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def describe_failure(self) -> str:
        """Return why the node failed, with the end of its output; empty if its exit status is 0."""
        status = self._process.wait()
        if status == 0:
            return ""
        self._reader.join(1.0)
        if self._has_namespaces and status > 128:  # so bwrap reports a signal
            status = 128 - status
        how = f"ended with exit status {status}"
        if status < 0:
            how = f"was killed by signal {signal.Signals(-status).name}"
        if status in (126, 127):  # of env
            how += " (does its first line name an existing interpreter, and is it executable?)"
        shown = self.output.splitlines()[-SHOWN_LINES:]
        output = "; its last output:\n" + "\n".join(shown) if shown else "; it printed nothing"
        return f"the node {how}{output}"
