"""Select one of several command inputs for the car.

Each input has a priority and a timeout. An input is live until its timeout after its last command.
A command passes unless an input of higher priority is live. All instants are stamps of commands
[ns], so the selection does not depend on the time at which the commands arrive.
"""

from typing import NamedTuple, Optional, Tuple

from mushr_ros_intro.sim.mux_config import IDLE, Input


class Mux(NamedTuple):
    """The state of a mux. Begin with Mux(); each method returns the next state."""

    expires: Tuple[Tuple[Input, int], ...] = ()
    """Each live input, and the instant at which its last command expires [ns]."""
    active: str = IDLE
    """The name of the input that drives, or idle."""

    def command(self, source: Input, stamp: int, slack: int = 0) -> Tuple["Mux", bool]:
        """Return the state after a command, and whether the command passes.

        Args:
            source: the input of the command.
            stamp: the stamp of the command [ns].
            slack: time that is added to the input's timeout for this command [ns].
        """
        passes = not any(
            other.priority > source.priority and stamp < until for other, until in self.expires
        )
        expires = dict(self.expires)
        expires[source] = max(expires.get(source, 0), stamp + source.timeout + slack)
        return Mux(tuple(expires.items()), source.name if passes else self.active), passes

    @property
    def deadline(self) -> Optional[int]:
        """When the last live input expires if no command arrives [ns]; None if idle."""
        return max((until for _, until in self.expires), default=None)

    def expire(self, now: int) -> Tuple["Mux", Optional[int]]:
        """Return the state at `now` [ns].

        Also return the instant at which the car has to stop [ns] if the last live input has
        expired, otherwise None.
        """
        deadline = self.deadline
        if deadline is None or now < deadline:
            return self, None
        return Mux(), deadline

    def restart(self, now: int) -> "Mux":
        """Return the state in which every live input expires at `now` [ns].

        For a clock that was set back.
        """
        return self._replace(expires=tuple((each, now) for each, _ in self.expires))
