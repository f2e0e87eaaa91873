"""Declare and check parameters: one call per parameter, with its type, unit, range and default."""

import math
import os
import textwrap
from difflib import get_close_matches
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, TypeVar

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import user_path
from mushr_ros_intro.wording import similar

T = TypeVar("T")


class Declaration(NamedTuple):
    """The meaning of a parameter, the values that it accepts, and its default, as text."""

    meaning: str
    expected: str
    default: str

    def text(self, name: str) -> str:
        """Return the lines about the parameter `name` in the answer to --help."""
        values = "; ".join(filter(None, (self.meaning, self.expected, self.default)))
        indent = " " * 4
        lines = textwrap.fill(values, 100, initial_indent=indent, subsequent_indent=indent)
        return f"  {name}\n{lines}"


class Parameters:
    """The parameters of a node, or of a file.

    Each method declares a parameter and returns its value. It raises UserError if the value is
    anything else than the method returns. `meaning` describes the parameter for --help.

    Args:
        values: the parameters by name.
        prefix: precedes each name in messages, such as ``~``.
    """

    def __init__(self, values: Mapping[str, Any], prefix: str = "~") -> None:
        self._values = values
        self._prefix = prefix
        self.declared: Dict[str, Declaration] = {}
        """Every parameter that a method was asked for."""
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
        for name in sorted(set(self._values) - set(self.declared)):
            hint = similar(name, self.declared, self._prefix)
            messages.append(f"parameter {self._prefix}{name} is not known, and has no effect{hint}")
        return messages

    def check_names(self, *known: str) -> None:
        """Raise UserError if a parameter has another name than these."""
        for name in self._values:
            if name not in known:
                raise self.error(name, f"only the keys {', '.join(known)}")

    def number(
        self, name: str, default: float, unit: str, low: float, high: float, meaning: str = ""
    ) -> float:
        """Return a number from `low` to `high`; text such as 1e-6, which YAML takes for a string.

        A parameter with the default NaN is required.
        """
        expected = f"a number from {low:g} to {high:g} {unit}".rstrip()
        shown = None if math.isnan(default) else f"{default:g}"
        value = self._get(name, default, meaning, expected, shown)
        try:
            number = float(value) if isinstance(value, (int, float, str)) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        is_number = low <= number <= high and not isinstance(value, bool)
        return float(self._checked(name, number, is_number, expected))

    def optional_number(
        self, name: str, unit: str, low: float, high: float, meaning: str
    ) -> Optional[float]:
        """Return a number, or None if the parameter is missing; see `number`."""
        expected = f"a number from {low:g} to {high:g} {unit}"
        if self._get(name, None, meaning, expected, "") is None:
            return None
        return self.number(name, math.nan, unit, low, high, meaning)

    def integer(self, name: str, default: float, low: float, high: float, meaning: str = "") -> int:
        """Return a whole number from `low` to `high`; see `number`."""
        value = self.number(name, default, "", low, high, meaning)
        return int(self._checked(name, int(value), value == int(value), "a whole number"))

    def flag(self, name: str, default: bool, meaning: str = "") -> bool:
        """Return true or false."""
        expected = "true or false"
        value = self._get(name, default, meaning, expected, str(default).lower())
        return bool(self._checked(name, value, isinstance(value, bool), expected))

    def text(
        self, name: str, default: Optional[str] = None, expected: str = "", meaning: str = ""
    ) -> str:
        """Return text that is not empty. Without a `default` the parameter is required."""
        value = self._get(name, default, meaning, expected, default)
        is_text = isinstance(value, str) and bool(value.strip())
        return str(self._checked(name, value, is_text, expected or "text that is not empty"))

    def loaded(self, name: str, expected: str, load: Callable[[str], T]) -> T:
        """Return what `load` reads from the file that text means; the parameter is required."""
        return load(self.text(name, expected=expected))

    def any_text(self, name: str, default: str, shown: str, meaning: str) -> str:
        """Return text, which may be empty; `shown` describes the default."""
        value = self._get(name, default, meaning, "", shown)
        return str(self._checked(name, value, isinstance(value, str), "text"))

    def optional_text(self, name: str, meaning: str = "") -> Optional[str]:
        """Return text, or None if the parameter is missing or empty."""
        is_empty = self._get(name, "", meaning, "", "") == ""
        return None if is_empty else self.text(name, meaning=meaning)

    def choice(
        self, name: str, options: Sequence[str], default: Optional[str] = None, meaning: str = ""
    ) -> str:
        """Return one of `options`."""
        expected = f"one of {', '.join(options)}"
        value = self._get(name, default, meaning, expected, default)
        expected += similar(str(value), options)
        return str(self._checked(name, value, value in options, expected))

    def items(self, name: str, expected: str, meaning: str = "") -> List[Any]:
        """Return a list that is not empty; the parameter is required."""
        value = self._get(name, None, meaning, expected, None)
        is_list = isinstance(value, list) and bool(value)
        return list(self._checked(name, value, is_list, expected) or ())

    def folder(self, name: str, default: str, meaning: str = "") -> str:
        """Return the absolute path of a folder that exists; see `user_path`."""
        path = os.path.realpath(user_path(self.text(name, default, "", meaning)))
        expected = f"a folder; there is none at {path}"
        return str(self._checked(name, path, os.path.isdir(path), expected))

    def file_name(self, name: str, default: str, meaning: str = "") -> str:
        """Return the name of a file, without a folder."""
        value = self.text(name, default, "a file name without a folder", meaning)
        is_name = value not in (".", "..") and os.sep not in value
        return str(self._checked(name, value, is_name, "a file name without a folder"))

    def error(self, name: str, expected: str) -> UserError:
        """Return the error that says what was expected of a parameter."""
        if name in self._values:
            what = f"is {self._values[name]!r}"
        else:
            unknown = map(str, set(self._values) - set(self.declared))
            close = get_close_matches(name, unknown, 1)
            what = f"is not set, but {self._prefix}{close[0]} is" if close else "is not set"
        return UserError(f"parameter {self._prefix}{name} {what}; expected {expected}")

    def _get(
        self, name: str, default: Any, meaning: str, expected: str, shown: Optional[str]
    ) -> Any:
        """Declare a parameter, and return its value or the default.

        Args:
            name: of the parameter.
            default: its value if it is not set.
            meaning: see `Declaration`.
            expected: see `Declaration`.
            shown: the default as text; empty if it is not shown, None if the value is required.
        """
        text = "required" if shown is None else f"default {shown}" if shown else ""
        self.declared[name] = Declaration(meaning, expected, text)
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


class Description(Parameters):
    """Parameters that are not set and not checked, to find out which ones a node declares."""

    def __init__(self) -> None:
        super().__init__({})

    def _checked(self, name: str, value: Any, is_valid: bool, expected: str) -> Any:
        return value

    def loaded(self, name: str, expected: str, load: Callable[[str], Any]) -> Any:
        """Declare the parameter, and load nothing."""
        return super().loaded(name, expected, lambda _: None)
