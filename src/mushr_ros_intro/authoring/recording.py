"""Turn the commands that a car got into the rows of a plan.

The commands apply at their stamps, as the simulated car has it, in whatever order they come. Each
is good for a while; after that the car stands, until the next one. All instants are integer
nanoseconds.
"""

import bisect
from itertools import chain
from typing import Iterable, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.plan.model import Row
from mushr_ros_intro.sim.stamps import STAMP_TOLERANCE


class _Change(NamedTuple):
    """From when on the car does what."""

    stamp: int
    speed: float
    steering_angle: float


class Recording:
    """The commands of a drive, from the first one on that asks for anything but to stand."""

    def __init__(self, command_timeout: int):
        """Begin a recording; each command is good for `command_timeout` [ns] after its stamp."""
        self._timeout = command_timeout
        self._changes: List[_Change] = []  # of the commands before which none will be put any more
        self._good_until = 0  # the last one of them
        self._recent: List[Command] = []  # in the order of their stamps

    @property
    def begin(self) -> Optional[int]:
        """The stamp of the first command [ns], None where there is none yet."""
        if self._changes:
            return self._changes[0].stamp
        return next((each.stamp for each in self._recent if _asks_for_something(each)), None)

    def add(self, command: Command, now: int) -> None:
        """Take a command that arrives at `now` [ns].

        It is put in its place, among those that are stamped less than STAMP_TOLERANCE ago. Of
        commands with the same stamp the one that arrives last counts.
        """
        place = bisect.bisect_right([each.stamp for each in self._recent], command.stamp)
        self._recent.insert(place, command)
        settled = bisect.bisect_left([each.stamp for each in self._recent], now - STAMP_TOLERANCE)
        self._good_until = self._follow(self._changes, self._recent[:settled])
        del self._recent[:settled]

    def forget_until(self, stamp: int) -> None:
        """Drop the commands from before `stamp` [ns]."""
        self._changes.clear()
        self._recent = [each for each in self._recent if each.stamp >= stamp]

    def rows(self) -> Tuple[Row, ...]:
        """Return the rows so far, without the standing after the last of them."""
        changes = self._changes[-1:]
        good_until = self._follow(changes, self._recent)
        changes = self._changes[:-1] + changes
        if not changes:
            return ()
        if changes[-1].stamp < good_until:
            changes.append(_Change(good_until, 0.0, 0.0))
        while len(changes) > 1 and changes[-2].speed == 0.0:
            changes.pop()
        ends = chain((each.stamp for each in changes[1:]), (changes[-1].stamp,))
        return tuple(
            Row(change.speed, change.steering_angle, end - change.stamp, 0)
            for change, end in zip(changes, ends)
            if end > change.stamp
        )

    def _follow(self, changes: List[_Change], commands: Iterable[Command]) -> int:
        """Add to `changes` what `commands` make the car do; return until when they are good."""
        good_until = self._good_until
        for command in commands:
            if changes:
                last = changes[-1]
                if good_until < command.stamp and last.speed != 0.0:
                    last = _Change(good_until, 0.0, last.steering_angle)
                    changes.append(last)
            elif not _asks_for_something(command):
                continue
            good_until = command.stamp + self._timeout
            if not changes or last[1:] != (command.speed, command.steering_angle):
                changes.append(_Change(command.stamp, command.speed, command.steering_angle))
        return good_until


def _asks_for_something(command: Command) -> bool:
    """Say whether a command is more than one to stand with straight wheels."""
    return command.speed != 0.0 or command.steering_angle != 0.0
