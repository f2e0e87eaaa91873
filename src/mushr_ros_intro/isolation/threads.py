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
        self._is_complete = False  # whether `_files` has all threads
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
                self._is_complete = False
                return False
            if text[text.rindex(b")") + 2] in b"RD":
                return False
        self.observe()
        return self.usages is before and bool(before)

    def observe(self) -> None:
        """Read the clocks; look for new threads if a thread of the system is new."""
        newest = None if self._newest_file is None else os.pread(self._newest_file, 20, 0)
        times = self._read_clocks()
        # Only a thread that has run can have begun another one.
        has_new = times != self._times if newest is None else newest != self._newest
        if has_new or times is None:
            self._newest = newest
            before = self._times if times is None else times
            self._drop_ended()
            self._add_new()
            times = {clock: before.get(clock, 0) for clock in self._clocks()}
        usages = [*self._files, *times.values()]
        if usages != self.usages:
            ran = [times[clock] - self._times.get(clock, 0) for clock in times]
            self.ran += sum(ran) / NANOSECONDS
            self.usages, self._times = usages, times

    def _read_clocks(self) -> Optional[Dict[int, int]]:
        """Return the processor times [ns] by clocks; None if the threads must be listed again."""
        if not self._is_complete:
            return None
        try:
            return {clock: time.clock_gettime_ns(clock) for clock in self._times}
        except OSError:  # a thread or a process has ended
            return None

    def _clocks(self) -> List[int]:
        if self._process == os.getpid():
            return [~number << 3 | _THREAD for number in self._files]
        return [~process << 3 | _PROCESS for process in self.processes]

    def _drop_ended(self) -> None:
        """Drop the processes and threads that have ended."""
        self.processes = [each for each in self.processes if os.path.exists(f"/proc/{each}/task")]
        for number, file in list(self._files.items()):
            try:
                os.pread(file, 1, 0)
            except OSError:
                os.close(self._files.pop(number))

    def _add_new(self) -> None:
        """Add new threads and processes; a list may lack some, if a thread ends meanwhile."""
        self._is_complete = True
        for process in self.processes:  # grows in this loop
            tasks = f"/proc/{process}/task"
            try:
                names = os.listdir(tasks)
                self._is_complete &= os.stat(tasks).st_nlink == len(names) + 2
            except OSError:  # the process has ended
                self._is_complete = False
                continue
            for number in map(int, names):
                if number in self._without:
                    continue
                with contextlib.suppress(OSError):  # it has ended
                    if number not in self._files and len(self._files) < _MAX_THREADS:
                        self._files[number] = os.open(f"{tasks}/{number}/stat", os.O_RDONLY)
                    if self._with_children:
                        children = _children(f"{tasks}/{number}")
                        self.processes += [each for each in children if each not in self.processes]


def _children(thread: str) -> List[int]:
    """Return the child processes of a thread, given its folder in /proc; raise OSError."""
    with open(f"{thread}/children", encoding="ascii") as file:
        return list(map(int, file.read().split()))
