"""Detect that another input has taken over the car."""

from typing import NamedTuple

from mushr_ros_intro.simulator.mux import IDLE

NOBODY = (IDLE, "default")
"""The active inputs, in lower case, if no input drives: MuSHR's `default` gets only stops."""


class TakeoverMonitor(NamedTuple):
    """The monitor of a node that sends commands to one input of the mux.

    The car is lost if another input drives. It is also lost if no input drives after the sender's
    input has driven, because the commands arrived too late. A lost car stays lost.
    """

    ours: str
    """The name of the sender's input, such as navigation; case does not matter."""
    had: bool = False
    """Whether the sender's input has driven the car."""
    lost_to: str = ""
    """The active input at which the car was lost; empty if it is not lost."""

    def hear(self, active: str, is_sending: bool) -> "TakeoverMonitor":
        """Return the state after the mux published `active`."""
        name = active.strip().lower()
        if name == self.ours.lower():
            return self._replace(had=self.had or is_sending)
        if self.lost_to or not self.had and name in NOBODY:
            return self
        return self._replace(lost_to=active.strip() or IDLE)

    def rest(self) -> "TakeoverMonitor":
        """Return the state after the stop of a plan; the mux may then be idle."""
        return self._replace(had=False)
