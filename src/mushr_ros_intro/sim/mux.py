"""Decide which of several command inputs drives the car.

Each input has a priority and a timeout. A command passes unless an input of higher priority is
live, that is, has sent one less than its timeout ago. The instants are the commands' stamps
[ns], so the decision does not depend on when a busy machine delivers them.
"""

from typing import Any, Dict, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.sim.stamps import CLOCK_LAG, effective_stamp, from_seconds

IDLE = "idle"

NOBODY = (IDLE, "default")
"""What a mux calls active, in lower case, while nobody drives: MuSHR's gets stops by default."""


class Input(NamedTuple):
    """One input of the mux."""

    name: str
    topic: str
    timeout: int
    """How long the input stays live after a command [ns]."""
    priority: int
    """The greater wins."""
    short_desc: str


class Config(NamedTuple):
    """What a mux is made of."""

    inputs: Tuple[Input, ...]
    """By falling priority."""
    publisher: str
    """The topic that the winner's commands go to."""


class ConfigError(UserError):
    """A mux configuration that cannot be used; the message names every fault."""


def parse_config(raw: Any) -> Config:
    """Read a configuration in the form of MuSHR's ackermann_cmd_mux.

    Args:
        raw: ``{"subscribers": [{"name", "topic", "timeout" [s], "priority", "short_desc"}, ...],
            "publisher": topic}``; short_desc may be left out.

    Raises:
        ConfigError: keys are missing or unknown, values are of the wrong kind, or two inputs
            share a name, a topic or a priority, or one has the topic of the publisher.
    """
    faults: List[str] = []
    if not isinstance(raw, dict):
        raise ConfigError(f"is {raw!r}; expected the keys 'subscribers' and 'publisher'")
    for key in sorted(set(map(str, raw)) - {"subscribers", "publisher"}):
        faults.append(f"unknown key '{key}'; expected only 'subscribers' and 'publisher'")
    publisher = _checked(raw, "publisher", "", faults)
    subscribers = raw.get("subscribers")
    inputs: List[Input] = []
    if not isinstance(subscribers, list) or not subscribers:
        faults.append("'subscribers' is missing or empty; expected a list of inputs")
        subscribers = []
    for number, entry in enumerate(subscribers, 1):
        found = _parse_input(entry, f"subscribers[{number}]", faults)
        if found:
            inputs.append(found)
    for field in ("name", "topic", "priority"):
        seen: Dict[Any, str] = {}
        for each in inputs:
            value = getattr(each, field)
            if value in seen:
                faults.append(
                    f"inputs '{seen[value]}' and '{each.name}' share the {field} {value!r}; "
                    f"expected each input to have its own"
                )
            seen[value] = each.name
    for each in inputs:
        if each.topic == publisher:
            faults.append(
                f"input '{each.name}' has the topic '{publisher}' of the key 'publisher'; "
                "expected another, or the mux would feed itself"
            )
    if faults:
        raise ConfigError("; ".join(faults))
    return Config(tuple(sorted(inputs, key=lambda each: -each.priority)), publisher)


def _parse_input(entry: Any, where: str, faults: List[str]) -> Optional[Input]:
    """Read one entry of the list of inputs; add what is wrong with it to `faults`."""
    before = len(faults)
    if not isinstance(entry, dict):
        faults.append(f"{where} is {entry!r}; expected name, topic, timeout and priority")
        return None
    known = ("name", "topic", "timeout", "priority", "short_desc")
    for key in sorted(set(map(str, entry)) - set(known)):
        faults.append(f"{where} has the unknown key '{key}'; expected only {', '.join(known)}")
    name = _checked(entry, "name", where, faults)
    topic = _checked(entry, "topic", where, faults)
    timeout = _number(entry, "timeout", where, faults)
    priority = _number(entry, "priority", where, faults)
    if timeout is not None and not 1e-9 <= timeout <= 1e6:
        faults.append(f"{where} has the timeout {timeout!r}; expected seconds, 1e-9 to 1e6")
    if priority is not None and priority != int(priority):
        faults.append(f"{where} has the priority {priority!r}; expected a whole number")
    if name == IDLE:
        faults.append(f"{where} has the name '{IDLE}', which means that none is; expected another")
    if len(faults) > before or timeout is None or priority is None:
        return None
    return Input(
        name, topic, from_seconds(timeout), int(priority), str(entry.get("short_desc", ""))
    )


def _checked(raw: Dict[Any, Any], key: str, where: str, faults: List[str]) -> str:
    """Return the text at `key`, or add a fault."""
    value = raw.get(key)
    if isinstance(value, str) and value.strip():
        return value
    place = f"{where} " if where else ""
    fault = f"has {value!r} for" if key in raw else "lacks"
    faults.append(f"{place}{fault} the key '{key}'; expected a name".strip())
    return ""


def _number(raw: Dict[Any, Any], key: str, where: str, faults: List[str]) -> Optional[float]:
    """Return the finite number at `key`, or add a fault."""
    value = raw.get(key)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300:
        return value
    fault = f"has {value!r} for" if key in raw else "lacks"
    faults.append(f"{where} {fault} the key '{key}'; expected a number")
    return None


class Mux(NamedTuple):
    """The state of a mux: when each live input's last command runs out.

    Begin with Mux(); each method returns the state that follows.
    """

    expires: Tuple[Tuple[Input, int], ...] = ()
    """Each input that is live and when it no longer is [ns]."""
    active: str = IDLE
    """The name of the input that drives, or idle."""

    def command(self, source: Input, stamp: int, slack: int = 0) -> Tuple["Mux", bool]:
        """Take a command from `source` stamped `stamp` [ns]; say whether it passes.

        It is good for the input's timeout, and for `slack` [ns] more.
        """
        passes = not any(
            other.priority > source.priority and stamp < until for other, until in self.expires
        )
        held = dict(self.expires)
        held[source] = max(held.get(source, 0), stamp + source.timeout + slack)
        return Mux(tuple(held.items()), source.name if passes else self.active), passes

    @property
    def deadline(self) -> Optional[int]:
        """When the last live input runs out [ns], if no command comes before; None if idle."""
        return max((until for _, until in self.expires), default=None)

    def expire(self, now: int) -> Tuple["Mux", Optional[int]]:
        """Let time pass until `now` [ns].

        Returns:
            The state that follows, and the instant [ns] at which the car is to stop where the
            last live input has run out, otherwise None.
        """
        deadline = self.deadline
        if deadline is None or now < deadline:
            return self, None
        return Mux(), deadline

    def restart(self, now: int) -> "Mux":
        """Let every live input run out at `now` [ns], because the clock was set back to it."""
        return self._replace(expires=tuple((each, now) for each, _ in self.expires))


def sent_at(stamp: int, now: int, timeout: int, is_simulated: bool) -> Tuple[int, int]:
    """Return when a command with a stamp was sent, and by how much that may be wrong [ns].

    Simulated time is one clock for all, but in lock-step a second of it takes milliseconds:
    commands may be here long before the clock's last steps are.

    Args:
        stamp: the command's [ns].
        now: what the mux takes for the present [ns].
        timeout: the input's [ns].
        is_simulated: whether the time is.
    """
    if not is_simulated:
        return effective_stamp(stamp, now), 0
    sent = effective_stamp(stamp, now, CLOCK_LAG)
    return sent, 0 if stamp and sent == stamp else timeout


class TakeoverMonitor(NamedTuple):
    """What the sender of an input makes of what a mux calls active.

    A car that somebody else drives is lost for good, and so is one that the sender had and has no
    longer, because its commands came too late.
    """

    ours: str
    """The name of the input, such as navigation; MuSHR's mux says Navigation."""
    had: bool = False
    """Whether it has driven the car."""
    lost_to: str = ""
    """What the mux called active when the car was lost; nothing before that."""

    def hear(self, active: str, is_sending: bool) -> "TakeoverMonitor":
        """Return what follows from the mux calling an input `active`."""
        name = active.strip().lower()
        if name == self.ours.lower():
            return self._replace(had=self.had or is_sending)
        if self.lost_to or not self.had and name in NOBODY:
            return self
        return self._replace(lost_to=active.strip() or IDLE)
