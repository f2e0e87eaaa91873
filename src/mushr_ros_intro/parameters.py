"""Declare and check parameters: one call per parameter, with its type, unit, range and default."""

import math
import os
from typing import Any, Dict, Mapping, Optional, Sequence

from mushr_ros_intro.errors import UserError


class ParameterError(UserError):
    """A parameter that cannot be used; names the parameter, its value and what was expected."""


class Parameters:
    """The parameters of a node, or of a file.

    Args:
        values: the parameters by name.
        prefix: precedes each name in messages, such as ``~``.
    """

    def __init__(self, values: Mapping[str, Any], prefix: str = "~") -> None:
        self._values = values
        self._prefix = prefix
        self.resolved: Dict[str, Any] = {}
        """The value of every parameter that has been read, with defaults filled in."""

    def __str__(self) -> str:
        return ", ".join(f"{name}: {value}" for name, value in self.resolved.items())

    def with_values(self, **values: Any) -> "Parameters":
        """Return the same parameters with other values for some."""
        return Parameters({**self._values, **values}, self._prefix)

    def number(self, name: str, default: float, unit: str, low: float, high: float) -> float:
        """Return a number from `low` to `high`; text such as 1e-6, which YAML takes for a string.

        Raises:
            ParameterError: the parameter is anything else.
        """
        value = self._values.get(name, default)
        try:
            number = float(value) if isinstance(value, (int, float, str)) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        if isinstance(value, bool) or not low <= number <= high:
            raise self.error(name, f"a number from {low:g} to {high:g} {unit}".rstrip())
        return float(self._keep(name, number))

    def integer(self, name: str, default: int, low: float, high: float) -> int:
        """Return a whole number from `low` to `high`.

        Raises:
            ParameterError: the parameter is anything else.
        """
        value = self.number(name, default, "", low, high)
        if value != int(value):
            raise self.error(name, "a whole number")
        return int(self._keep(name, int(value)))

    def flag(self, name: str, default: bool) -> bool:
        """Return true or false.

        Raises:
            ParameterError: the parameter is anything else.
        """
        value = self._values.get(name, default)
        if not isinstance(value, bool):
            raise self.error(name, "true or false")
        return bool(self._keep(name, value))

    def text(self, name: str, default: Optional[str] = None, expected: str = "") -> str:
        """Return text that is not empty. Without a `default` the parameter is required.

        Raises:
            ParameterError: the parameter is missing, or no text; the message says `expected`.
        """
        value = self._values.get(name, default)
        if not isinstance(value, str) or not value.strip():
            raise self.error(name, expected or "text that is not empty")
        return str(self._keep(name, value))

    def optional_text(self, name: str) -> Optional[str]:
        """Return text, or None if the parameter is missing or empty.

        Raises:
            ParameterError: the parameter is no text.
        """
        return None if self._values.get(name, "") == "" else self.text(name)

    def choice(self, name: str, options: Sequence[str], default: Optional[str] = None) -> str:
        """Return one of `options`.

        Raises:
            ParameterError: the parameter is none of them.
        """
        value = self._values.get(name, default)
        if value not in options:
            raise self.error(name, f"one of {', '.join(options)}")
        return str(self._keep(name, value))

    def folder(self, name: str, default: str) -> str:
        """Return the absolute path of a folder that exists; see `user_path`.

        Raises:
            ParameterError: the parameter is no text, or there is no such folder.
        """
        path = os.path.realpath(user_path(self.text(name, default)))
        if not os.path.isdir(path):
            raise self.error(name, f"a folder; there is none at {path}")
        return path

    def file_name(self, name: str, default: str) -> str:
        """Return the name of a file, without a folder.

        Raises:
            ParameterError: the parameter is anything else.
        """
        value = self._values.get(name, default)
        if not isinstance(value, str) or value in ("", ".", "..") or os.sep in value:
            raise self.error(name, "a file name without a folder")
        return str(self._keep(name, value))

    def error(self, name: str, expected: str) -> ParameterError:
        """Return the error that says what was expected of a parameter."""
        what = f"is {self._values[name]!r}" if name in self._values else "is not set"
        return ParameterError(f"parameter {self._prefix}{name} {what}; expected {expected}")

    def _keep(self, name: str, value: Any) -> Any:
        """Note the resolved value of a parameter, and return it."""
        self.resolved[name] = value
        return value


def user_path(path: str) -> str:
    """Return the absolute path that a user means by `path`.

    A relative path starts at the user's directory. roslaunch starts nodes in ROS_HOME, but leaves
    PWD as it was in the user's shell.
    """
    return os.path.abspath(os.path.join(os.environ.get("PWD", "."), os.path.expanduser(path)))
