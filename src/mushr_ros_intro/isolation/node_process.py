"""Start, watch and end the process of the node in a replay."""

import contextlib
import os
import re
import select
import signal
import subprocess
import threading
from typing import List

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.threads import Threads

SHOWN_LINES = 15
"""Number of lines at the end of the node's output that a message quotes."""

KEPT_OUTPUT = 20_000
"""Size of the kept end of a node's output [bytes]."""

PIPE = 65536
"""The capacity of a pipe of Linux [bytes]."""

MAX_OUTPUT = 50_000_000
"""A node that prints more has failed [bytes]."""

MAX_MEMORY = 1_500_000_000
"""A node has failed if all its processes together use more memory [bytes]."""

MAX_THREADS = 250
"""A node that starts more has failed."""


_NOT_OF_THE_NODE = re.compile(
    r'^ +File "(?:<string>|<frozen \w+>|.*/runpy\.py)", line .*\n(?:    (?! *File ).*\n)*',
    re.MULTILINE,
)
"""The lines of a traceback about the program that runs the node in simulated time."""

_OF_THE_END = re.compile(
    r"^(?:Exception in thread .*:\n)?Traceback \(most recent call last\):\n(?:[ \t].*\n)*"
    r"rospy\.exceptions\.ROSInterruptException: .*\n?",
    re.MULTILINE,
)
"""The traceback of a node that waits while it is ended."""


def _memory_of(process: int) -> int:
    """Return the memory that a process uses, without that of files [bytes]; raise OSError.

    That of its page tables counts: they can be large although the process has used few pages.
    """
    with open(f"/proc/{process}/status", encoding="ascii", errors="replace") as file:
        sizes = re.findall(r"^(?:RssAnon|RssShmem|VmPTE):\s*(\d+) kB$", file.read(), re.M)
    return 1024 * sum(map(int, sizes))


WAS_KILLED = "the node was killed by signal SIGKILL"
"""The description of a node that was killed begins with this."""


class NodeProcess:
    """The process of the node in a replay, with all processes of its group."""

    def __init__(self, command: List[str], has_namespaces: bool = False, *files: int) -> None:
        """Start the node.

        Args:
            command: the program and its arguments, which include the environment.
            has_namespaces: whether it is bwrap, which runs the node in a process group of its own.
            files: the numbers of open files for the node.

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
                pass_fds=files,
            )
        except OSError as error:
            raise UserError(f"{command[0]} cannot be started ({error.strerror})") from None
        self._has_namespaces = has_namespaces
        # bwrap starts a process that is the first one in the namespace, and this starts the node.
        self.threads = Threads(self._process.pid, starters=2 * has_namespaces)
        """The threads of the node and of its child processes."""
        self._output = b""
        self._printed = 0
        self._is_interrupted = False
        assert self._process.stdout
        self._pipe = self._process.stdout.fileno()
        os.set_blocking(self._pipe, False)
        self._is_reading = threading.Lock()
        threading.Thread(target=self._read_all, daemon=True).start()

    def _read_all(self) -> None:
        while self._read():
            select.select([self._pipe], [], [])

    def _read(self) -> bool:
        """Read what the node has printed; return whether it can print more."""
        with self._is_reading, contextlib.suppress(BlockingIOError):  # nothing is new
            chunk = os.read(self._pipe, PIPE)
            self._output = (self._output + chunk)[-KEPT_OUTPUT:]
            self._printed += len(chunk)
            return bool(chunk)
        return True

    def excess(self) -> str:
        """Return which limit the node has exceeded; empty if none. If it has, kill it."""
        fault = ""
        self.threads.observe()
        with contextlib.suppress(OSError):  # a process has ended
            if self._printed > MAX_OUTPUT:
                fault = f"the node printed more than {MAX_OUTPUT / 1e6:g} MB of output"
            elif len(self.threads.usages) > MAX_THREADS:
                fault = f"the node started more than {MAX_THREADS} processes and threads"
            elif sum(map(_memory_of, self.threads.processes)) > MAX_MEMORY:
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
        """The end of the node's output, without control characters, which XML must not contain.

        It does not contain the exceptions that `end` causes.
        """
        self._read()  # not to the end of the pipe, which a child process may hold
        text = _NOT_OF_THE_NODE.sub("", self._output.decode(errors="replace"))
        if self._is_interrupted:
            text = _OF_THE_END.sub("", text)
        lines = text.splitlines()
        return "\n".join("".join(c for c in line if c.isprintable()) for line in lines)

    def end(self) -> None:
        """End the node, its child processes, and all processes of its group."""
        self.threads.observe()
        self._is_interrupted = not self.has_ended
        with contextlib.suppress(OSError, IndexError):  # it has ended
            processes = self.threads.processes
            # The first process in bwrap's namespace ignores the signal.
            os.killpg(processes[int(self._has_namespaces)], signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(3.0)
        self._kill()
        self._process.wait()

    def _kill(self) -> None:
        """Kill all processes, also those that have left the group of the first one."""
        self.threads.observe()
        for process in set(self.threads.processes) - {self._process.pid}:
            with contextlib.suppress(OSError):  # it has ended
                os.kill(process, signal.SIGKILL)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def describe_failure(self) -> str:
        """Return why the node failed, with the end of its output; empty if its exit status is 0."""
        status = self._process.wait()
        if status == 0:
            return ""
        if self._has_namespaces and status - 128 in set(signal.Signals):  # of bwrap
            status = 128 - status
        how = f"ended with exit status {status}"
        if status < 0:
            names = {each.value: each.name for each in signal.Signals}
            how = f"was killed by signal {names.get(-status, -status)}"  # real-time ones have none
        if status in (126, 127):  # of env
            how += " (does its first line name an existing interpreter, and is it executable?)"
        if status == 1 and self._output and b"Traceback" not in self._output:
            how += " (sys.exit with a text means status 1)"
        shown = self.output.splitlines()[-SHOWN_LINES:]
        output = "; its last output:\n" + "\n".join(shown) if shown else "; it printed nothing"
        return f"the node {how}{output}"
