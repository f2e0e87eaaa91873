"""Learn from the node under test when its next thread is due; see simulated_time.py."""

import contextlib
import os
import select
from typing import Optional

from mushr_ros_intro.isolation.node_process import PIPE


class DueTimes:
    """A pipe, to which the node writes when its next thread is due."""

    def __init__(self) -> None:
        self._reader, self.file = os.pipe()
        """The number of the file to which the node writes."""
        os.set_blocking(self._reader, False)
        self._last = 0

    def wait(self, seconds: float) -> bool:
        """Wait until the node writes, at most for `seconds`; return whether it has written."""
        is_written, _, _ = select.select([self._reader], [], [], seconds)
        if is_written:
            self.read()
        return bool(is_written)

    def read(self) -> int:
        """Return the time that the node has written last [ns]; 0 if that is unknown."""
        with contextlib.suppress(BlockingIOError):  # nothing is new
            self._last = int.from_bytes(os.read(self._reader, PIPE)[-8:], "little")
        return self._last

    def time_left(self, now: int, pose_period: Optional[int]) -> Optional[int]:
        """Return the time until the next thread of the node is due [ns]; None if unknown.

        Args:
            now: the time [ns].
            pose_period: between two reports of the car [ns], which are at its multiples, if a
                thread receives them; None if no thread does.
        """
        due = self.read()
        times = [due - now] if due else []
        if pose_period:
            times.append(pose_period - now % pose_period)
        return min(times, default=None)
