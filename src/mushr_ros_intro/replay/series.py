"""Collect what a topic publishes, for the test node posetest.py."""

import time
from typing import Any, List, Tuple


class Series:
    """The items of a topic with their stamps."""

    _QUIET = 1.0
    """Time without a message after which none is in transit any more [s of wall-clock time]."""

    def __init__(self) -> None:
        self.entries: List[Tuple[int, Any]] = []
        """All pairs of stamp [ns] and item, in order of arrival."""
        self._last_arrival = 0.0

    def add(self, stamp: int, item: Any) -> None:
        """Add an item with its stamp [ns]."""
        self.entries.append((stamp, item))
        self._last_arrival = time.monotonic()

    def covers(self, duration: int, now: int) -> bool:
        """Return whether the first `duration` [ns] of the series is complete at `now` [ns].

        This depends on the stamps, because a fast clock can be ahead of messages in transit. Only
        if no message arrives any more it depends on the clock.
        """
        if not self.entries:
            return False
        end = self.entries[0][0] + duration
        is_quiet = time.monotonic() > self._last_arrival + self._QUIET
        return self.entries[-1][0] >= end or (now >= end and is_quiet)
