"""Select one of several command inputs for the car.

Each input has a priority and a timeout. An input is live until its timeout after its last command.
A command passes unless an input of higher priority is live. All instants are in nanoseconds [ns].

A node and a replay use the same `Mux`, which knows no topics and reads no clocks.
"""

import itertools
import math
from typing import Any, Callable, Dict, NamedTuple, Optional, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import (
    REQUIRED,
    Parameter,
    Parameters,
    RefusedError,
    Table,
    Values,
    integer,
    not_empty,
    number,
    text,
)
from mushr_ros_intro.stamps import (
    COMMAND_PERIOD,
    NANOSECONDS,
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    CurrentTime,
    effective_stamp,
    from_seconds,
)

LATE_AFTER = COMMAND_PERIOD // 2
"""If a command arrives later than this after its stamp, its timeout counts from its arrival [ns].

In wall-clock time only. So a sender with a late clock can drive the car.
"""

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


class Mux:
    """Decides by the stamps of the commands which of them pass, and when the car has to stop.

    Wall-clock times are monotonic [s]; infinity if the time on the clock alone counts.
    """

    def __init__(self, is_simulated: bool, warn: Callable[[str], Any]) -> None:
        """Begin without a live input.

        Args:
            is_simulated: whether the instants are simulated time.
            warn: logs a warning.
        """
        self.active = IDLE
        """The name of the input that drives, or idle."""
        self._is_simulated, self._warn = is_simulated, warn
        self._tolerance = SIMULATED_STAMP_TOLERANCE if is_simulated else STAMP_TOLERANCE
        self._time = CurrentTime()
        self._expires: Dict[Input, int] = {}  # when the last command of each live input expires
        # When the newest command without a valid stamp expires: on the clock, and at the earliest.
        self._without_stamp, self._min_wall = -1, -math.inf

    @property
    def deadline(self) -> Optional[int]:
        """When the last live input expires if no command arrives [ns]; None if idle."""
        return max(self._expires.values(), default=None)

    def held(self, wall: float) -> float:
        """Return for how long no input may expire [s of wall-clock time].

        A command without a valid stamp counts from its arrival. In lock-step, the clock of the mux
        may be seconds late at that time and then advance at once, and the command would expire at
        once. So such a command is valid for at least its timeout in wall-clock time, too.
        """
        return self._min_wall - wall if self.deadline == self._without_stamp else 0.0

    def add(self, source: Input, stamp: int, now: int, wall: float) -> Tuple[Optional[int], bool]:
        """Add a command.

        Args:
            source: its input.
            stamp: its stamp [ns].
            now: when it arrives [ns].
            wall: when it arrives [s of wall-clock time].

        Returns:
            The stamp of a stop before the command, None if there is none; and whether it passes.
        """
        now = self._read(now)
        begin = effective_stamp(stamp, now, self._tolerance)
        has_stamp, until = begin == stamp, begin + source.timeout
        if self._is_simulated:
            until += 0 if has_stamp else source.timeout
        else:
            if now > begin + LATE_AFTER:
                until = now + source.timeout
            begin = min(begin, now)  # the stamp is in the future if the sender's clock is early
        # Expire first. In simulated time, the output then depends on the stamps alone.
        stop = self._expire(begin, wall)
        passes = not any(
            other.priority > source.priority and begin < live
            for other, live in self._expires.items()
        )
        self._expires[source] = max(self._expires.get(source, 0), until)
        if passes:
            self.active = source.name
        if not has_stamp and self.deadline == until:
            self._without_stamp, self._min_wall = until, wall + source.timeout / NANOSECONDS
        return stop, passes

    def expire(self, now: int, wall: float) -> Optional[int]:
        """Return the stamp of the stop that has to be sent at `now` [ns], None if there is none."""
        return self._expire(self._read(now), wall)

    def _expire(self, now: int, wall: float) -> Optional[int]:
        deadline = self.deadline
        if self.held(wall) > 0.0 or deadline is None or now < deadline:
            return None
        self._expires, self.active = {}, IDLE
        # A stop without a stamp applies on arrival. A command that arrives later, but has an
        # earlier stamp, replaces it (see car/history.py).
        return deadline if self._is_simulated and deadline != self._without_stamp else 0

    def _read(self, now: int) -> int:
        """Return the time [ns]. If the clock was set back, all inputs expire."""
        if self._time.update(now):
            self._warn("the clock was set back; all inputs expire")
            self._expires = dict.fromkeys(self._expires, self._time.now)
        return self._time.now


def full_topic(mux: str, topic: str) -> str:
    """Return the full name of a topic of the configuration; `mux` is the name of the node."""
    return topic if topic.startswith("/") else f"{mux}/{topic.lstrip('~/')}"


def parse_config(raw: Any) -> Config:
    """Return a configuration in the format of MuSHR's ackermann_cmd_mux.

    Args:
        raw: ``{"publisher": topic, "subscribers": [{"name", "topic", "timeout" [s], "priority",
            "short_desc"}, ...]}``; short_desc is optional.

    Raises:
        UserError: keys are missing or unknown, values have the wrong type, two inputs have
            the same name, topic or priority, or an input has the topic of the publisher.
    """
    return config_of(_read(raw, "~", MUX_PARAMETERS))


def config_of(values: Values) -> Config:
    """Return the configuration with the values of MUX_PARAMETERS.

    Raises:
        UserError: an input has the topic of the publisher.
    """
    inputs, publisher = values["subscribers"], values["publisher"]
    if publisher in (each.topic for each in inputs):
        expected = "expected another topic than those of the inputs"
        raise UserError(f"parameter ~publisher is {publisher!r}; {expected}")
    return Config(inputs, publisher)


def _inputs(entries: Any) -> Tuple[Input, ...]:
    """Return the inputs in the order of decreasing priority."""
    if not isinstance(entries, list) or not entries:
        raise RefusedError
    inputs = [_input(entry, f"~subscribers[{index}]/") for index, entry in enumerate(entries, 1)]
    for one, other in itertools.combinations(inputs, 2):
        for field in ("name", "topic", "priority"):
            value = getattr(one, field)
            if value == getattr(other, field):
                raise UserError(
                    f"inputs '{one.name}' and '{other.name}' share the {field} {value!r}; "
                    "expected each input to have its own"
                )
    return tuple(sorted(inputs, key=lambda each: -each.priority))


MUX_PARAMETERS = (
    text("publisher", REQUIRED, "topic of the forwarded commands", "a topic"),
    Parameter(
        "subscribers",
        REQUIRED,
        "a list of inputs",
        _inputs,
        "each with name, topic, timeout [s], priority and short_desc",
    ),
)


def _name(value: Any) -> str:
    """Return the name of an input."""
    if value == IDLE:
        raise RefusedError("another name; this one means that no input drives")
    return not_empty(value)


_INPUT_PARAMETERS = (
    Parameter("name", REQUIRED, "a name", _name),
    text("topic", REQUIRED, expected="a topic"),
    number("timeout", REQUIRED, "s", 1e-9, 1e6),
    integer("priority", REQUIRED, -1e9, 1e9),
    Parameter("short_desc", None, "", str),
)


def _input(entry: Any, prefix: str) -> Input:
    """Return the input that an entry describes."""
    values = _read(entry, prefix, _INPUT_PARAMETERS)
    timeout = from_seconds(values["timeout"])
    return Input(values["name"], values["topic"], timeout, values["priority"])


def _read(raw: Any, prefix: str, table: Table) -> Values:
    """Return the values in a mapping that has the keys of a table only."""
    if not isinstance(raw, dict):
        expected = ", ".join(each.name for each in table)
        raise UserError(f"parameter {prefix} is {raw!r}; expected only the keys {expected}")
    parameters = Parameters(raw, prefix)
    parameters.refuse_unknown(table)
    return parameters.read(table)
