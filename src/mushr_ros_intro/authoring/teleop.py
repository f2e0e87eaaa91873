"""Turn keys that are held into commands: W and S for the speed, A and D for the steering.

A window sees keys go down and come up (see Keys.down and Keys.up). A terminal sees characters
only, so there a key counts as held for a while after each (see Keys.typed).

All instants are integer nanoseconds.
"""

from typing import Dict, NamedTuple, Optional, Tuple

from mushr_ros_intro.sim.stamps import NANOSECONDS

DIRECTIONS: Dict[str, Tuple[int, int]] = {"w": (1, 0), "s": (-1, 0), "a": (0, 1), "d": (0, -1)}
"""What each key adds: forward, and to the left."""

PERIOD = NANOSECONDS // 10
"""Between commands while a key is held [ns]."""

BOUNCE = NANOSECONDS // 50
"""A key that comes up and goes down again within this [ns] has been held all along."""

FIRST_HOLD = 600_000_000
"""How long a character holds its key in a terminal [ns]: desktops begin to repeat after 0.5 s."""

NEXT_HOLD = 200_000_000
"""Likewise for a character that comes while its key is held: repeats are some 0.03 s apart."""

STOP = (0.0, 0.0)


class Held(NamedTuple):
    """A key that is held."""

    key: str
    """Its letter, in lower case."""
    until: Optional[int] = None
    """When it no longer is [ns]; None while it is down."""


class Keys(NamedTuple):
    """Which keys are held. Begin with Keys(); each method returns the state that follows."""

    held: Tuple[Held, ...] = ()

    def down(self, key: str) -> "Keys":
        """Take a key that went down, or is repeated; any but W, A, S, D lets all keys go."""
        key = key.lower()
        if key not in DIRECTIONS:
            return Keys()
        return Keys((*(each for each in self.held if each.key != key), Held(key)))

    def up(self, key: str, now: int) -> "Keys":
        """Take a key that came up, and that may go down again at once.

        X11 reports each repeat of a held key as up and down.
        """
        key = key.lower()
        return Keys(
            tuple(Held(key, now + BOUNCE) if each.key == key else each for each in self.held)
        )

    def typed(self, key: str, now: int) -> "Keys":
        """Take a character from a terminal; any but W, A, S, D lets all keys go.

        A terminal repeats only the key that went down last, so what else is held stays so with
        it, and W with A is a left turn. The opposite key is let go.
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
        """Let time pass until `now` [ns]."""
        return Keys(tuple(each for each in self.held if each.until is None or now < each.until))

    def drive(self, speed: float, steering_angle: float) -> Optional[Tuple[float, float]]:
        """Return the speed [m/s] and the steering angle [rad] to drive with, or None for no key.

        Args:
            speed: that W stands for [m/s].
            steering_angle: that A stands for [rad].
        """
        if not self.held:
            return None
        forward = sum(DIRECTIONS[each.key][0] for each in self.held)
        left = sum(DIRECTIONS[each.key][1] for each in self.held)
        return forward * speed, left * steering_angle


class Schedule(NamedTuple):
    """When to send what. Begin with Schedule(); each step returns the state that follows."""

    wanted: Optional[Tuple[float, float]] = None
    """What was sent last; None after a stop."""
    due: int = 0
    """When to send it again [ns]."""

    def step(
        self, wanted: Optional[Tuple[float, float]], now: int
    ) -> Tuple["Schedule", Optional[Tuple[float, float]]]:
        """Say what to send at `now` [ns], if anything.

        What is new goes out at once, what is old every PERIOD; where nothing is wanted any more
        one stop goes out, and then nothing, so that the mux lets others drive.
        """
        if wanted is None:
            return Schedule(), STOP if self.wanted is not None else None
        early = self.due - now
        if wanted == self.wanted and 0 < early <= PERIOD:
            return self, None
        on_time = wanted == self.wanted and -PERIOD < early <= 0
        return Schedule(wanted, (self.due if on_time else now) + PERIOD), wanted
