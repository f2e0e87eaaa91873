"""Declare and check parameters: one call per parameter, with its type, unit, range and default."""

import math
import os
from difflib import get_close_matches
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import user_path


class Parameters:
    """The parameters of a node, or of a file.

    Each method returns one parameter, or raises UserError if its value is anything else than
    the method returns.

    Args:
        values: the parameters by name.
        prefix: precedes each name in messages, such as ``~``.
    """

    def __init__(self, values: Mapping[str, Any], prefix: str = "~") -> None:
        self._values = values
        self._prefix = prefix
        self._known: Set[str] = set()
        self.resolved: Dict[str, Any] = {}
        """The value of every parameter that has been read, with defaults filled in."""

    def __str__(self) -> str:
        return ", ".join(f"{name}: {value}" for name, value in self.resolved.items())

    def __bool__(self) -> bool:
        """Return whether there is any parameter."""
        return bool(self._values)

    def with_values(self, **values: Any) -> "Parameters":
        """Return the same parameters with other values for some."""
        return Parameters({**self._values, **values}, self._prefix)

    def unknown(self) -> List[str]:
        """Return a message for each parameter that is set, but that no method was asked for."""
        messages = []
        for name in sorted(set(self._values) - self._known):
            close = get_close_matches(name, self._known, 1)
            hint = f"; did you mean {self._prefix}{close[0]}?" if close else ""
            messages.append(f"parameter {self._prefix}{name} is not known, and has no effect{hint}")
        return messages

    def number(self, name: str, default: float, unit: str, low: float, high: float) -> float:
        """Return a number from `low` to `high`; text such as 1e-6, which YAML takes for a string.

        A parameter with the default NaN is required.
        """
        value = self._get(name, default)
        try:
            number = float(value) if isinstance(value, (int, float, str)) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        is_number = low <= number <= high and not isinstance(value, bool)
        expected = f"a number from {low:g} to {high:g} {unit}".rstrip()
        return float(self._checked(name, number, is_number, expected))

    def integer(self, name: str, default: float, low: float, high: float) -> int:
        """Return a whole number from `low` to `high`; see `number`."""
        value = self.number(name, default, "", low, high)
        return int(self._checked(name, int(value), value == int(value), "a whole number"))

    def flag(self, name: str, default: bool) -> bool:
        """Return true or false."""
        value = self._get(name, default)
        return bool(self._checked(name, value, isinstance(value, bool), "true or false"))

    def text(self, name: str, default: Optional[str] = None, expected: str = "") -> str:
        """Return text that is not empty. Without a `default` the parameter is required."""
        value = self._get(name, default)
        is_text = isinstance(value, str) and bool(value.strip())
        return str(self._checked(name, value, is_text, expected or "text that is not empty"))

    def optional_text(self, name: str) -> Optional[str]:
        """Return text, or None if the parameter is missing or empty."""
        return None if self._get(name, "") == "" else self.text(name)

    def choice(self, name: str, options: Sequence[str], default: Optional[str] = None) -> str:
        """Return one of `options`."""
        value = self._get(name, default)
        return str(self._checked(name, value, value in options, f"one of {', '.join(options)}"))

    def folder(self, name: str, default: str) -> str:
        """Return the absolute path of a folder that exists; see `user_path`."""
        path = os.path.realpath(user_path(self.text(name, default)))
        expected = f"a folder; there is none at {path}"
        return str(self._checked(name, path, os.path.isdir(path), expected))

    def file_name(self, name: str, default: str) -> str:
        """Return the name of a file, without a folder."""
        value = self.text(name, default, "a file name without a folder")
        is_name = value not in (".", "..") and os.sep not in value
        return str(self._checked(name, value, is_name, "a file name without a folder"))

    def error(self, name: str, expected: str) -> UserError:
        """Return the error that says what was expected of a parameter."""
        if name in self._values:
            what = f"is {self._values[name]!r}"
        else:
            close = get_close_matches(name, map(str, set(self._values) - self._known), 1)
            what = f"is not set, but {self._prefix}{close[0]} is" if close else "is not set"
        return UserError(f"parameter {self._prefix}{name} {what}; expected {expected}")

    def _get(self, name: str, default: Any) -> Any:
        """Return the value of a parameter, or the default."""
        self._known.add(name)
        return self._values.get(name, default)

    def _checked(self, name: str, value: Any, is_valid: bool, expected: str) -> Any:
        """Note the value of a parameter, and return it.

        Raises:
            UserError: the value is not valid.
        """
        if not is_valid:
            raise self.error(name, expected)
        self.resolved[name] = value
        return value
