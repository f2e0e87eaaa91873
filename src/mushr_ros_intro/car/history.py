"""Keep a car's recent events in the order of their stamps.

Every event (a command or an initial pose) applies at its stamp, not on arrival. A message that
arrives late, twice or out of order is inserted at its place, so the pose at any instant depends on
the stamped messages alone and not on the load of the machine.
"""

import bisect
from typing import List, Optional, Tuple

from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Car, Command, Event, State
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.sim.stamps import STAMP_TOLERANCE


class History:
    """The events of the last while, in order, and the car's state after each of them."""

    def __init__(self, car: Car, start: State, world: Optional[World] = None):
        """Start from the state `start`, in a `world` where there are walls."""
        self._car = car
        self._world = world
        self._events: List[Tuple[int, bool]] = []  # the order: placements before commands
        self._payload: List[Event] = []
        self._states = [start]  # the state after each event; the first is from before them

    def add(self, event: Event, now: int) -> None:
        """Put `event`, which arrives at `now` [ns], in its place, and redo what came after it.

        At the same stamp a placement comes before commands; otherwise the later arrival counts.
        An event from before the history begins applies at its beginning; it reaches back
        STAMP_TOLERANCE from the latest `now`.
        """
        event = event._replace(stamp=max(event.stamp, self._states[0].stamp))
        key = (event.stamp, isinstance(event, Command))
        place = bisect.bisect_right(self._events, key)
        self._events.insert(place, key)
        self._payload.insert(place, event)
        self._redo(place)
        self._forget(now - STAMP_TOLERANCE)

    def build(self, world: World) -> None:
        """Put up the walls of `world`, in the place of others, for all that is in the history."""
        self._world = world
        self._redo(0)

    def state_at(self, stamp: int) -> State:
        """Return the state at `stamp` [ns]; before the history begins, that at its beginning."""
        place = bisect.bisect_right(self._events, (stamp, True))
        state = self._states[place]
        return advance(state, max(stamp, state.stamp), self._car)

    def _redo(self, place: int) -> None:
        """Work out the states after the events from the one at `place` on."""
        del self._states[place + 1 :]
        for event in self._payload[place:]:
            state = advance(self._states[-1], event.stamp, self._car)
            self._states.append(apply(state, event, self._car, self._world))

    def _forget(self, horizon: int) -> None:
        """Drop the events before `horizon` [ns], but for the state that they led to."""
        old = bisect.bisect_left(self._events, (horizon, False))
        del self._events[:old], self._payload[:old], self._states[:old]
