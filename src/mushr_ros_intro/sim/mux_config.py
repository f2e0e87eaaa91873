"""Read the configuration of a mux, in the format of MuSHR's ackermann_cmd_mux."""

from typing import Any, Dict, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.sim.stamps import from_seconds

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
    short_desc: str


class Config(NamedTuple):
    """The configuration of a mux."""

    inputs: Tuple[Input, ...]
    """In the order of decreasing priority."""
    publisher: str
    """The topic of the forwarded commands."""


class ConfigError(UserError):
    """An invalid mux configuration; the message lists all faults."""


def parse_config(raw: Any) -> Config:
    """Read a configuration in the format of MuSHR's ackermann_cmd_mux.

    Args:
        raw: ``{"subscribers": [{"name", "topic", "timeout" [s], "priority", "short_desc"}, ...],
            "publisher": topic}``; short_desc is optional.

    Raises:
        ConfigError: keys are missing or unknown, values have the wrong type, two inputs have the
            same name, topic or priority, or an input has the topic of the publisher.
    """
    faults: List[str] = []
    if not isinstance(raw, dict):
        raise ConfigError(
            f"the mux's configuration is {raw!r}; expected the keys 'subscribers' and 'publisher'"
        )
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
                "expected another; the mux would receive its own commands"
            )
    if faults:
        raise ConfigError("the mux's configuration " + "; ".join(faults))
    return Config(tuple(sorted(inputs, key=lambda each: -each.priority)), publisher)


def _parse_input(entry: Any, where: str, faults: List[str]) -> Optional[Input]:
    """Read one entry of the list of inputs; add its faults to `faults`."""
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
        faults.append(
            f"{where} has the name '{IDLE}', which means that no input drives; expected another"
        )
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
