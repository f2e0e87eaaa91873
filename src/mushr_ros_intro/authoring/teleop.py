"""Turn held keys into commands: W and S for the speed, A and D for the steering angle, or arrows.

A window reports when a key goes down and up (`Keys.down`, `Keys.up`). A terminal reports characters
only, so each one counts as a key held for a short time (`Keys.typed`). All instants are integer
nanoseconds.
"""

import re
from typing import Dict, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

DIRECTIONS: Dict[str, Tuple[int, int]] = {"w": (1, 0), "s": (-1, 0), "a": (0, 1), "d": (0, -1)}
"""The effect of each key: forward, left."""

ARROWS = {"up": "w", "down": "s", "left": "a", "right": "d"}
"""The keys that have the same effect, by their names in lower case."""

BOUNCE = NANOSECONDS // 50
"""A key that goes up and down again within this time was held throughout [ns]."""

FIRST_HOLD = 700_000_000
"""Time for which a character holds its key [ns]: X.org starts to repeat after 0.66 s."""

NEXT_HOLD = 200_000_000
"""The same for a character whose key is already held [ns]: repeats are about 0.03 s apart."""

STOP = (0.0, 0.0)

_TERMINAL_KEY = re.compile(
    r"\x1b+(?:\[\[[^\x1b]|[\[O][0-?]*[ -/]*[@-Z\\-~]|[^\x1b\[O])|.", re.DOTALL
)
"""A character, or the escape sequence of a key: ECMA-48, the Linux console, Alt with a key."""

_INCOMPLETE = re.compile(r"(?:\x1b+(?:\[\[|[\[O][0-?]*[ -/]*)?)?\Z")
"""The beginning of such a sequence at the end of a text, or nothing."""

_TERMINAL_ARROWS = {
    f"\x1b{kind}{letter}": name
    for kind in "[O"
    for letter, name in zip("ABCD", ("up", "down", "right", "left"))
}


def keys_in(typed: str) -> Tuple[List[str], str]:
    """Return the keys in what a terminal has read, and the beginning of one that is incomplete.

    Arrows have their names; any other escape sequence is one key, whatever letters it contains.
    """
    rest = _INCOMPLETE.search(typed)
    assert rest
    found = _TERMINAL_KEY.findall(typed[: rest.start()])
    return [_TERMINAL_ARROWS.get(each, each) for each in found], rest[0]


def _named(key: str) -> str:
    """Return the letter of a key that drives; of any other key, its name."""
    return ARROWS.get(key.lower(), key.lower())


class Held(NamedTuple):
    """A key that is held."""

    key: str
    """Its letter, in lower case."""
    until: Optional[int] = None
    """When it is released [ns]; None while it is down."""


class Keys(NamedTuple):
    """The keys that are held, initially none. Each method returns the new state."""

    held: Tuple[Held, ...] = ()

    def down(self, key: str) -> "Keys":
        """Handle a key that goes down or repeats; any other than those that drive releases all."""
        key = _named(key)
        if key not in DIRECTIONS:
            return Keys()
        return Keys((*(each for each in self.held if each.key != key), Held(key)))

    def up(self, key: str, now: int) -> "Keys":
        """Handle a key that goes up: release it after BOUNCE, unless it goes down again.

        X11 reports each repeat of a held key as up and down.
        """
        key = _named(key)
        return Keys(
            tuple(Held(key, now + BOUNCE) if each.key == key else each for each in self.held)
        )

    def typed(self, key: str, now: int) -> "Keys":
        """Handle a key of `keys_in`; any other than those that drive releases all.

        A terminal repeats only the last key that went down. Other held keys therefore stay held as
        long as that one, so that W with A is a left turn. The opposite key is released.
        """
        key = _named(key)
        if key not in DIRECTIONS:
            return Keys()
        held = self.at(now).held
        opposite = tuple(-axis for axis in DIRECTIONS[key])
        until = now + (NEXT_HOLD if any(each.key == key for each in held) else FIRST_HOLD)
        kept = (each for each in held if each.key != key and DIRECTIONS[each.key] != opposite)
        return Keys(
            (*(Held(each.key, max(each.until or 0, until)) for each in kept), Held(key, until))
        )

    def at(self, now: int) -> "Keys":
        """Return the keys that are still held at `now` [ns]."""
        return Keys(tuple(each for each in self.held if each.until is None or now < each.until))

    def drive(self, speed: float, steering_angle: float) -> Optional[Tuple[float, float]]:
        """Return the speed [m/s] and the steering angle [rad] to drive with, None without a key.

        Args:
            speed: of the key W [m/s].
            steering_angle: of the key A [rad].
        """
        if not self.held:
            return None
        forward = sum(DIRECTIONS[each.key][0] for each in self.held)
        left = sum(DIRECTIONS[each.key][1] for each in self.held)
        return forward * speed, left * steering_angle


class Schedule(NamedTuple):
    """When to send which command. `step` returns the new state."""

    last: Optional[Tuple[float, float]] = None
    """The last command; None after a stop."""
    due: int = 0
    """When to repeat it [ns]."""

    def step(
        self, wanted: Optional[Tuple[float, float]], now: int
    ) -> Tuple["Schedule", Optional[Tuple[float, float]]]:
        """Return the new state, and the command to send at `now` [ns] or None.

        Send a new command at once, and repeat it every COMMAND_PERIOD. After the last one
        send one stop, then nothing, so that the mux passes on the commands of others.
        """
        if wanted is None:
            return Schedule(), STOP if self.last is not None else None
        early = self.due - now
        if wanted == self.last and 0 < early <= COMMAND_PERIOD:
            return self, None
        on_time = wanted == self.last and -COMMAND_PERIOD < early <= 0
        return Schedule(wanted, (self.due if on_time else now) + COMMAND_PERIOD), wanted
