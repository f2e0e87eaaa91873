"""Select one of several command inputs for the car.

Each input has a priority and a timeout. An input is live until its timeout after its last command.
A command passes unless an input of higher priority is live. All instants are in nanoseconds [ns].
"""

import itertools
import math
from typing import Any, NamedTuple, Optional, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.stamps import from_seconds

IDLE = "idle"
"""Published as the active input if no input drives."""


class Input(NamedTuple):
    """One input of the mux."""

    name: str
    topic: str
    timeout: int
    """Time after a command for which the input is live [ns]."""
    priority: int
    """The live input with the highest priority drives."""


class Config(NamedTuple):
    """The configuration of a mux."""

    inputs: Tuple[Input, ...]
    """In the order of decreasing priority."""
    publisher: str
    """The topic of the forwarded commands."""


class Mux(NamedTuple):
    """The state of a mux. Begin with Mux(); each method returns the next state."""

    expires: Tuple[Tuple[Input, int], ...] = ()
    """Each live input, and the instant at which its last command expires [ns]."""
    active: str = IDLE
    """The name of the input that drives, or idle."""

    def command(self, source: Input, instant: int, until: int) -> Tuple["Mux", bool]:
        """Return the state after a command, and whether the command passes.

        Args:
            source: the input of the command.
            instant: when the command would begin to drive [ns].
            until: when the command expires [ns].
        """
        passes = not any(
            other.priority > source.priority and instant < live for other, live in self.expires
        )
        expires = dict(self.expires)
        expires[source] = max(expires.get(source, 0), until)
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


def full_topic(mux: str, topic: str) -> str:
    """Return the full name of a topic of the configuration; `mux` is the name of the node."""
    return topic if topic.startswith("/") else f"{mux}/{topic.lstrip('~/')}"


def parse_config(raw: Any) -> Config:
    """Read a configuration; see `read_config`."""
    return read_config(_parameters(raw, "~", "subscribers", "publisher"))


def read_config(parameters: Parameters) -> Config:
    """Read a configuration in the format of MuSHR's ackermann_cmd_mux.

    Args:
        parameters: ``{"publisher": topic, "subscribers": [{"name", "topic", "timeout" [s],
            "priority", "short_desc"}, ...]}``; short_desc is optional.

    Raises:
        UserError: keys are missing or unknown, values have the wrong type, two inputs have
            the same name, topic or priority, or an input has the topic of the publisher.
    """
    parameters.check_names("subscribers", "publisher")
    publisher = parameters.text(
        "publisher", expected="a topic", meaning="topic of the forwarded commands"
    )
    meaning = "each with name, topic, timeout [s], priority and short_desc"
    entries = parameters.items("subscribers", "a list of inputs", meaning)
    inputs = [_input(entry, f"~subscribers[{number}]/") for number, entry in enumerate(entries, 1)]
    for one, other in itertools.combinations(inputs, 2):
        for field in ("name", "topic", "priority"):
            value = getattr(one, field)
            if value == getattr(other, field):
                raise UserError(
                    f"inputs '{one.name}' and '{other.name}' share the {field} {value!r}; "
                    "expected each input to have its own"
                )
    if publisher in (each.topic for each in inputs):
        raise parameters.error("publisher", "another topic than those of the inputs")
    return Config(tuple(sorted(inputs, key=lambda each: -each.priority)), publisher)


def _input(entry: Any, prefix: str) -> Input:
    """Read one entry of the list of inputs."""
    keys = _parameters(entry, prefix, "name", "topic", "timeout", "priority", "short_desc")
    name = keys.text("name", expected="a name")
    if name == IDLE:
        raise keys.error("name", "another name; this one means that no input drives")
    timeout = keys.number("timeout", math.nan, "s", 1e-9, 1e6)
    priority = keys.integer("priority", math.nan, -1e9, 1e9)
    return Input(name, keys.text("topic", expected="a topic"), from_seconds(timeout), priority)


def _parameters(raw: Any, prefix: str, *known: str) -> Parameters:
    """Return the parameters of a mapping that has known keys only."""
    expected = f"only the keys {', '.join(known)}"
    if not isinstance(raw, dict):
        raise UserError(f"parameter {prefix} is {raw!r}; expected {expected}")
    parameters = Parameters(raw, prefix)
    parameters.check_names(*known)
    return parameters
