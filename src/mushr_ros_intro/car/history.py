"""Keep a car's recent events in the order of their stamps, and compute its states.

Each event (a command or an initial pose) applies at its stamp, not on arrival. An event that
arrives late, twice or out of order is inserted at its position. So the pose at any instant depends
on the stamped messages alone, and not on the load of the machine.

An event without a valid stamp applies on arrival. A stamped event of the same kind that arrives
later replaces it from the later event's stamp on, even if that stamp is earlier. So the stops that
MuSHR sends while no input drives, all with one old stamp, do not cancel the first command of a
plan.
"""

import bisect
from typing import List, Optional, Tuple

from mushr_ros_intro.car.model import Car, Command, Event, State
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.stamps import STAMP_TOLERANCE
from mushr_ros_intro.world.footprint import World

LENGTH = STAMP_TOLERANCE
"""How long an event is kept [ns]: no event with a valid stamp arrives later than this."""


class History:
    """The recent events of a car, in order, and the state after each of them."""

    def __init__(self, car: Car, start: State, world: Optional[World] = None):
        """Begin with the state `start`. Without a `world` there are no walls."""
        self._car = car
        self._world = world
        self._keys: List[Tuple[int, bool]] = []
        self._events: List[Event] = []
        self._states = [start]  # before the first event, and after each event

    def add(self, event: Event, now: int) -> None:
        """Insert `event`, which arrives at `now` [ns], and recompute the states after it.

        If stamps are equal, an initial pose applies before commands, and otherwise the events
        apply in the order of arrival. The history begins LENGTH before the latest `now`.
        An event from before its beginning applies at its beginning.
        """
        if event.stamp < self._states[0].stamp:
            event = event._replace(stamp=self._states[0].stamp)
        first = bisect.bisect_left(self._keys, (event.stamp, False))
        later = self._events[first:]
        if event.has_stamp:
            later = [each for each in later if each.has_stamp or type(each) is not type(event)]
        later.append(event)
        later.sort(key=_key)  # equal keys keep their order
        self._events[first:] = later
        self._keys[first:] = map(_key, later)
        self._recompute(first)
        self._forget(now - LENGTH)

    def set_walls(self, world: World, now: int) -> None:
        """Replace the walls at `now` [ns] by those of `world`; recompute the states kept."""
        self._forget(now - LENGTH)
        self._world = world
        self._recompute(0)

    def state_at(self, stamp: int) -> State:
        """Return the state at `stamp` [ns], or at the beginning of the history if that is later."""
        index = bisect.bisect_right(self._keys, (stamp, True))
        state = self._states[index]
        return advance(state, max(stamp, state.stamp), self._car)

    def _recompute(self, index: int) -> None:
        """Compute the states after the events from `index` on."""
        del self._states[index + 1 :]
        for event in self._events[index:]:
            state = advance(self._states[-1], event.stamp, self._car)
            self._states.append(apply(state, event, self._car, self._world))

    def _forget(self, horizon: int) -> None:
        """Drop the events before `horizon` [ns], but keep the state after the last of them."""
        old = bisect.bisect_left(self._keys, (horizon, False))
        del self._keys[:old], self._events[:old], self._states[:old]


def _key(event: Event) -> Tuple[int, bool]:
    """Return the position of an event: its stamp, and whether it is a command."""
    return event.stamp, isinstance(event, Command)
