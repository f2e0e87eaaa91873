"""Read from /proc whether threads wait, and for how long they have run."""

import contextlib
import os
from typing import Collection, Dict, List, NamedTuple

from mushr_ros_intro.stamps import NANOSECONDS

Usages = Dict[str, bytes]
"""By the number of a thread: how long it has run and waited for a processor [ns], and how often.

The text of a thread changes whenever it runs. The times alone may not: Linux subtracts the time
for which a virtual machine itself did not run from the times of the threads that run next.
"""

_MAX_THREADS = 300
"""No more threads are observed, because each needs open files."""

_TICK = NANOSECONDS // os.sysconf("SC_CLK_TCK")
"""The unit of the times in the file `stat` [ns]."""


class _Files(NamedTuple):
    """The process of a thread, and its open files in /proc; opening them takes most of the time."""

    process: int
    counts: int
    stat: int
    children: int


class Threads:
    """The threads of a process and, if `with_children`, of its child processes."""

    def __init__(
        self,
        process: int,
        with_children: bool = True,
        without: Collection[int] = (),
        starters: int = 0,
    ) -> None:
        """Observe the threads.

        Args:
            process: the number of the process.
            with_children: whether to observe its child processes, too.
            without: the numbers of threads that are left out.
            starters: how many processes only start another one.
        """
        self.processes = [process]
        """The process and its child processes, when they were last observed."""
        self._starters = starters
        self._with_children = with_children
        self._without = {str(each) for each in without}
        self._has_statistics = _has_statistics()
        counts = "schedstat" if self._has_statistics else "status"
        self._names = (counts, "stat", "children")
        self._files: Dict[str, _Files] = {}
        self._texts: List[bytes] = []  # the values of `usages`, in the order of `_files`
        self.usages: Usages = {}
        """When the threads were last observed; the same object if none has run since then."""
        self.ran = 0.0
        """For how long the threads have run [s of processor time]."""

    @property
    def has_children(self) -> bool:
        """Whether there is a child process besides the starters and the one that they start."""
        return len(self.processes) > self._starters + 1

    def are_waiting(self) -> bool:
        """Observe the threads; return whether all of them wait, at the same time.

        Each is found waiting, and none has begun to run meanwhile.
        """
        self.observe()
        before = self.usages
        is_each_waiting = self.is_each_waiting()
        self.observe()
        return is_each_waiting and self.usages is before

    def is_each_waiting(self) -> bool:
        """Return whether each thread waits, one after another.

        A thread that waits for a processor is not found waiting.
        """
        try:
            for files in self._files.values():
                text = os.pread(files.stat, 200, 0)
                if text[text.rindex(b")") + 2] in b"RD":
                    return False
        except OSError:  # a thread has ended
            return False
        return True

    def observe(self) -> None:
        """Read the usages of the threads."""
        found: Usages = {}
        try:
            texts = list(map(self._usage, self._files.values()))
            if texts == self._texts and texts:
                return
            found.update(zip(self._files, texts))
        except OSError:  # a thread has ended
            for name, files in self._files.items():
                with contextlib.suppress(OSError):
                    found[name] = self._usage(files)
        for name in self._files.keys() - found.keys():
            for file in self._files.pop(name)[1:]:
                os.close(file)
        is_complete = self._add_new(found)
        for name, usage in found.items():
            before = self.usages.get(name, b"0")
            if usage != before:
                self.ran += (int(usage.split()[0]) - int(before.split()[0])) / NANOSECONDS
        self.usages, self._texts = found, list(found.values()) if is_complete else []

    def _add_new(self, found: Usages) -> bool:
        """Add the usages of new threads; only a thread that has run or ended can have created them.

        Return False if the list of threads may be incomplete: it stops at a thread that ends.
        """
        for name, usage in list(found.items()):
            if usage != self.usages.get(name):
                self._add_children(name)
        alive, is_complete = [], True
        for process in self.processes:  # grows in this loop
            with contextlib.suppress(OSError):
                names = os.listdir(f"/proc/{process}/task")
                alive.append(process)
                for name in names:
                    is_new = name not in found and name not in self._without
                    if is_new and len(found) < _MAX_THREADS:
                        is_complete &= self._open(process, name, found)
        self.processes = alive
        return is_complete

    def _open(self, process: int, name: str, found: Usages) -> bool:
        """Open the files of a new thread, and add its usage; return False if it has ended."""
        with contextlib.suppress(OSError):
            folder = f"/proc/{process}/task/{name}"
            files = [os.open(f"{folder}/{each}", os.O_RDONLY) for each in self._names]
            self._files[name] = _Files(process, *files)
            found[name] = self._usage(self._files[name])
            self._add_children(name)
            return True
        return False

    def _add_children(self, name: str) -> None:
        """Add the child processes of a thread."""
        if self._with_children:
            with contextlib.suppress(OSError):
                for each in os.pread(self._files[name].children, 4096, 0).split():
                    if int(each) not in self.processes:
                        self.processes.append(int(each))

    def _usage(self, files: _Files) -> bytes:
        """Return the usage of a thread; raise OSError if it has ended."""
        if self._has_statistics:
            return os.pread(files.counts, 100, 0)
        counts, stat = os.pread(files.counts, 4096, 0), os.pread(files.stat, 4096, 0)
        fields = stat[stat.rindex(b")") + 2 :].split()
        times = (int(fields[11]) + int(fields[12])) * _TICK
        return b"%d 0 %s" % (times, counts[counts.rindex(b"\nvoluntary_ctxt_switches") :])


def _has_statistics() -> bool:
    """Return whether the system keeps statistics of the scheduler."""
    with contextlib.suppress(OSError), open("/proc/self/schedstat", encoding="ascii") as file:
        return file.read().split() != ["0", "0", "0"]
    return False
