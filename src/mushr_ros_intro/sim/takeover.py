"""Find out from what the mux publishes whether another node has taken over the car."""

from typing import NamedTuple

from mushr_ros_intro.sim.mux_config import IDLE

NOBODY = (IDLE, "default")
"""The active inputs, in lower case, while nobody drives: MuSHR's `default` gets stops only."""


class TakeoverMonitor(NamedTuple):
    """The state of a sender's claim to the car.

    The car is lost for good if another input drives it. It is also lost if no input drives it after
    the sender's input did, because the commands arrived too late.
    """

    ours: str
    """The name of the sender's input, such as navigation; case does not matter."""
    had: bool = False
    """Whether the sender's input drives the car."""
    lost_to: str = ""
    """The active input when the car was lost; empty before."""

    def hear(self, active: str, is_sending: bool) -> "TakeoverMonitor":
        """Return the state after the mux published `active`."""
        name = active.strip().lower()
        if name == self.ours.lower():
            return self._replace(had=self.had or is_sending)
        if self.lost_to or not self.had and name in NOBODY:
            return self
        return self._replace(lost_to=active.strip() or IDLE)

    def rest(self) -> "TakeoverMonitor":
        """Return the state after a plan's stop: until its next command, the car may be idle."""
        return self._replace(had=False)
