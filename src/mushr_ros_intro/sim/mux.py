"""Decide which of several command inputs drives the car.

Each input has a priority and a timeout. A command passes unless an input of higher priority is
live: the input has sent a command less than its timeout ago. All instants are the stamps of
commands [ns], so the decision does not depend on when a busy machine delivers them.
"""

from typing import NamedTuple, Optional, Tuple

from mushr_ros_intro.sim.mux_config import IDLE, Input


class Mux(NamedTuple):
    """The state of a mux. Begin with Mux(); each method returns the state that follows."""

    expires: Tuple[Tuple[Input, int], ...] = ()
    """Each live input, and when its last command expires [ns]."""
    active: str = IDLE
    """The name of the input that drives, or idle."""

    def command(self, source: Input, stamp: int, slack: int = 0) -> Tuple["Mux", bool]:
        """Take a command from `source`, and return whether it passes.

        Args:
            source: the input.
            stamp: of the command [ns].
            slack: how much later than after the input's timeout the command expires [ns].
        """
        passes = not any(
            other.priority > source.priority and stamp < until for other, until in self.expires
        )
        expires = dict(self.expires)
        expires[source] = max(expires.get(source, 0), stamp + source.timeout + slack)
        return Mux(tuple(expires.items()), source.name if passes else self.active), passes

    @property
    def deadline(self) -> Optional[int]:
        """When the last live input expires if no command comes before [ns]; None if idle."""
        return max((until for _, until in self.expires), default=None)

    def expire(self, now: int) -> Tuple["Mux", Optional[int]]:
        """Let time pass until `now` [ns].

        Returns:
            The state that follows; and when the car has to stop [ns] if the last live input has
            expired, otherwise None.
        """
        deadline = self.deadline
        if deadline is None or now < deadline:
            return self, None
        return Mux(), deadline

    def restart(self, now: int) -> "Mux":
        """Let every live input expire at `now` [ns], because the clock was set back."""
        return self._replace(expires=tuple((each, now) for each, _ in self.expires))
