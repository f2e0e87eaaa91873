"""Detect that another input has taken over the car."""

from typing import NamedTuple

from mushr_ros_intro.simulator.mux import IDLE

NOBODY = (IDLE, "default")
"""The active inputs, in lower case, if no input drives: MuSHR's `default` gets only stops."""


class TakeoverMonitor(NamedTuple):
    """The monitor of a node that sends commands to one input of the mux.

    The car is taken over if another input drives. It also counts as taken over if no input drives
    after the sender's input has driven, because then the commands arrived too late. This does not
    change any more, even if the sender's input drives again.
    """

    input: str
    """The name of the sender's input, such as navigation; case does not matter."""
    has_driven: bool = False
    """Whether the sender's input has driven the car in this plan."""
    taken_over_by: str = ""
    """The active input at the takeover; empty if there was none."""

    def on_active(self, active: str, is_sending: bool) -> "TakeoverMonitor":
        """Return the state after the mux published the name `active` of the input that drives."""
        name = active.strip().lower()
        if name == self.input.lower():
            return self._replace(has_driven=self.has_driven or is_sending)
        if self.taken_over_by or not self.has_driven and name in NOBODY:
            return self
        return self._replace(taken_over_by=active.strip() or IDLE)

    def plan_ended(self) -> "TakeoverMonitor":
        """Return the state after the stop of a plan; the mux may then be idle."""
        return self._replace(has_driven=False)
