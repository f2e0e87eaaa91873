"""Observe whether threads wait, and for how long they have run."""

import contextlib
import os
import time
from typing import Collection, Dict, List, Optional

from mushr_ros_intro.stamps import NANOSECONDS

_MAX_THREADS = 300
"""No more threads are observed, because each needs an open file."""

_PROCESS, _THREAD = 2, 6
"""Kinds of clocks of processor time; see CPUCLOCK_SCHED and CPUCLOCK_PERTHREAD of Linux.

Linux allows clocks of all processes, and of the threads of this process.
"""

_NEWEST = "/proc/sys/kernel/ns_last_pid"
"""This file contains the number of the newest thread of the system."""


class Threads:
    """The threads of a process and, if `with_children`, of its child processes."""

    def __init__(
        self, process: int, with_children: bool = True, without: Collection[int] = ()
    ) -> None:
        """Args: the number of the process; the numbers of threads that are left out."""
        self._process = process
        self._with_children = with_children
        self._without = set(without)
        self._files: Dict[int, int] = {}  # open files with the states, by numbers of threads
        self._times: Dict[int, int] = {}  # processor times [ns], by clocks
        self._newest: Optional[bytes] = None  # None: list the threads again
        self._newest_file: Optional[int] = None
        with contextlib.suppress(OSError):
            self._newest_file = os.open(_NEWEST, os.O_RDONLY)
        self.processes = [process]
        """The process and its child processes, when they were last observed."""
        self.usages: List[int] = []
        """The same object as long as none of the threads runs, begins or ends."""
        self.ran = 0.0
        """For how long the threads have run [s of processor time]."""

    @property
    def count(self) -> int:
        """The number of threads, when they were last observed."""
        return len(self._files)

    def are_waiting(self) -> bool:
        """Observe the threads; return whether all of them wait, at the same time.

        Each is found waiting, and none has begun to run meanwhile. A thread that waits for a
        processor is not found waiting.
        """
        self.observe()
        before = self.usages
        for number, file in self._files.items():
            try:
                text = os.pread(file, 200, 0)
            except OSError:  # the thread has ended
                os.close(self._files.pop(number))
                self._newest = None
                return False
            if text[text.rindex(b")") + 2] in b"RD":
                return False
        self.observe()
        return self.usages is before and bool(before)

    def observe(self) -> None:
        """Read the clocks; first list the threads, if a thread of the system is new."""
        newest = None if self._newest_file is None else os.pread(self._newest_file, 20, 0)
        if newest is None or newest != self._newest:
            self._newest = newest
            self._list()
        try:
            times = {clock: time.clock_gettime_ns(clock) for clock in self._times}
        except OSError:  # a process, or a thread of this process, has ended
            self._newest = None
            self.observe()
            return
        usages = [*self._files, *times.values()]
        if usages != self.usages:
            self.ran += (sum(times.values()) - sum(self._times.values())) / NANOSECONDS
            self.usages, self._times = usages, times

    def _list(self) -> None:
        """List the processes, the threads and their clocks again."""
        self.processes = []
        found: Dict[int, int] = {}
        clocks, processes = [], [self._process]
        for process in processes:  # grows in this loop
            with contextlib.suppress(OSError):  # it has ended
                clock = ~process << 3 | _PROCESS
                time.clock_gettime_ns(clock)
                names = os.listdir(f"/proc/{process}/task")
                self.processes.append(process)
                clocks.append(clock)
                for number in map(int, names):
                    if number not in self._without and len(found) < _MAX_THREADS:
                        folder = f"/proc/{process}/task/{number}"
                        with contextlib.suppress(OSError):  # it has ended
                            file = self._files.pop(number, None)
                            found[number] = file or os.open(f"{folder}/stat", os.O_RDONLY)
                            if self._with_children:
                                processes += _children(folder)
        for file in self._files.values():
            os.close(file)
        if self._process == os.getpid():
            clocks = [~number << 3 | _THREAD for number in found]
        self._files = found
        self._times = {clock: self._times.get(clock, 0) for clock in clocks}


def _children(thread: str) -> List[int]:
    """Return the child processes of a thread, given its folder in /proc; raise OSError."""
    with open(f"{thread}/children", encoding="ascii") as file:
        return list(map(int, file.read().split()))
