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
        self._has_ended = True  # a thread, perhaps: list the threads again
        self._newest: Optional[bytes] = None
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
                self._has_ended = True
                return False
            if text[text.rindex(b")") + 2] in b"RD":
                return False
        self.observe()
        return self.usages is before and bool(before)

    def observe(self) -> None:
        """Read the clocks; list the threads again if a thread of the system is new."""
        newest = None if self._newest_file is None else os.pread(self._newest_file, 20, 0)
        times = self._read_clocks()
        # Only a thread that has run can have begun another one.
        has_new = times != self._times if newest is None else newest != self._newest
        if has_new or times is None:
            self._newest = newest
            before = self._times if times is None else times
            times = {clock: before.get(clock, 0) for clock in self._list()}
        usages = [*self._files, *times.values()]
        if usages != self.usages:
            ran = [times[clock] - self._times.get(clock, 0) for clock in times]
            self.ran += sum(ran) / NANOSECONDS
            self.usages, self._times = usages, times

    def _read_clocks(self) -> Optional[Dict[int, int]]:
        """Return the processor times [ns] by clocks; None if a thread or process has ended."""
        if self._has_ended:
            return None
        try:
            return {clock: time.clock_gettime_ns(clock) for clock in self._times}
        except OSError:
            return None

    def _list(self) -> List[int]:
        """List the processes and the threads again; return their clocks."""
        self.processes, self._has_ended = [], False
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
        self._files = found
        if self._process == os.getpid():
            return [~number << 3 | _THREAD for number in found]
        return clocks


def _children(thread: str) -> List[int]:
    """Return the child processes of a thread, given its folder in /proc; raise OSError."""
    with open(f"{thread}/children", encoding="ascii") as file:
        return list(map(int, file.read().split()))
