"""Turn held keys into commands: W and S for the speed, A and D for the steering angle.

A window reports when a key goes down and up (`Keys.down`, `Keys.up`). A terminal reports characters
only, so each one counts as a key held for a short time (`Keys.typed`). All instants are integer
nanoseconds.
"""

from typing import Dict, NamedTuple, Optional, Tuple

from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

DIRECTIONS: Dict[str, Tuple[int, int]] = {"w": (1, 0), "s": (-1, 0), "a": (0, 1), "d": (0, -1)}
"""The effect of each key: forward, left."""

BOUNCE = NANOSECONDS // 50
"""A key that goes up and down again within this time was held throughout [ns]."""

FIRST_HOLD = 600_000_000
"""Time for which a character holds its key [ns]: desktops start to repeat after 0.5 s."""

NEXT_HOLD = 200_000_000
"""The same for a character whose key is already held [ns]: repeats are about 0.03 s apart."""

STOP = (0.0, 0.0)


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
        """Handle a key that goes down or repeats; any other than W, A, S, D releases all keys."""
        key = key.lower()
        if key not in DIRECTIONS:
            return Keys()
        return Keys((*(each for each in self.held if each.key != key), Held(key)))

    def up(self, key: str, now: int) -> "Keys":
        """Handle a key that goes up: release it after BOUNCE, unless it goes down again.

        X11 reports each repeat of a held key as up and down.
        """
        key = key.lower()
        return Keys(
            tuple(Held(key, now + BOUNCE) if each.key == key else each for each in self.held)
        )

    def typed(self, key: str, now: int) -> "Keys":
        """Handle a character from a terminal; any other than W, A, S, D releases all keys.

        A terminal repeats only the last key that went down. Other held keys therefore stay held as
        long as that one, so that W with A is a left turn. The opposite key is released.
        """
        key = key.lower()
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
