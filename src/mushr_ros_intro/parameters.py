"""Declare parameters in a table, which reads and checks their values, and describes them.

A table is a sequence of `Parameter`, such as ``number("rate", 10.0, "Hz", 0.1, 1e3, "of the
scans")``. A node has one as its attribute PARAMETERS; see `node.main`.
"""

import os
import textwrap
from difflib import get_close_matches
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Set

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import user_path
from mushr_ros_intro.wording import similar

REQUIRED: Any = object()
"""The default of a parameter that has to be set."""

_TEXT = "text that is not empty"


class RefusedError(ValueError):
    """A value that a parameter does not accept; the text says what is expected, if it is known."""


class Values(Dict[str, Any]):
    """The values of parameters by name."""

    text = ""
    """The parameters as they were set, with defaults filled in."""


class Parameter(NamedTuple):
    """The declaration of a parameter."""

    name: str
    default: Any
    """If it is not set; REQUIRED; or a function of the values of the parameters before it.

    With the default None, text that is empty means that it is not set.
    """
    expected: str
    """The values that it accepts, as text."""
    convert: Callable[[Any], Any]
    """Return the value, given what is set. Raises RefusedError, or UserError with a message."""
    meaning: str = ""

    def help(self) -> str:
        """Return the lines about the parameter in the answer to --help."""
        default = f"default {_shown(self.default)}"
        if self.default is REQUIRED:
            default = "required"
        elif self.default is None or callable(self.default):
            default = ""
        values = "; ".join(filter(None, (self.meaning, self.expected, default)))
        indent = " " * 4
        lines = textwrap.fill(values, 100, initial_indent=indent, subsequent_indent=indent)
        return f"  {self.name}\n{lines}"


Table = Sequence[Parameter]


class Parameters:
    """Parameters that are set, of a node or of a file.

    Args:
        values: the parameters by name.
        prefix: precedes each name in messages, such as ``~``.
    """

    def __init__(self, values: Mapping[str, Any], prefix: str = "~") -> None:
        self._values = values
        self._prefix = prefix
        self._known: Set[str] = set()

    def __bool__(self) -> bool:
        """Return whether there is any parameter."""
        return bool(self._values)

    def read(self, table: Table) -> Values:
        """Return the values of the parameters of a table.

        Raises:
            UserError: a value is not valid, or a required one is missing.
        """
        self._known.update(each.name for each in table)
        values, texts = Values(), []
        for each in table:
            default = each.default(values) if callable(each.default) else each.default
            values[each.name] = self._value(each, default)
            if values[each.name] is not None:
                texts.append(f"{each.name}: {self._values.get(each.name, default)}")
        values.text = ", ".join(texts)
        return values

    def get(self, parameter: Parameter) -> Any:
        """Return the value of one parameter; see `read`."""
        return self.read([parameter])[parameter.name]

    def unknown(self, table: Table) -> List[str]:
        """Return a message for each parameter that is set, but not in a table."""
        messages, known = [], [each.name for each in table]
        for name in sorted(set(self._values) - set(known)):
            hint = similar(name, known, self._prefix)
            messages.append(f"parameter {self._prefix}{name} is not known, and has no effect{hint}")
        return messages

    def refuse_unknown(self, table: Table) -> None:
        """Raise UserError if a parameter is not in a table."""
        known = [each.name for each in table]
        for name in self._values:
            if name not in known:
                raise self.error(name, f"only the keys {', '.join(known)}")

    def error(self, name: str, expected: str) -> UserError:
        """Return the error that says what was expected of a parameter."""
        if name in self._values:
            what = f"is {self._values[name]!r}"
        else:
            close = get_close_matches(name, map(str, set(self._values) - self._known), 1)
            what = f"is not set, but {self._prefix}{close[0]} is" if close else "is not set"
        return UserError(f"parameter {self._prefix}{name} {what}; expected {expected}")

    def _value(self, parameter: Parameter, default: Any) -> Any:
        value = self._values.get(parameter.name, default)
        if value is None and parameter.name not in self._values:
            return None
        if default is None and value == "":
            return None
        try:
            if value is REQUIRED:
                raise RefusedError
            return parameter.convert(value)
        except RefusedError as refused:
            expected = str(refused) or parameter.expected or _TEXT
            raise self.error(parameter.name, expected) from None


def number(
    name: str, default: Any, unit: str, low: float, high: float, meaning: str = ""
) -> Parameter:
    """Declare a number from `low` to `high`; text such as 1e-6, which YAML takes for a string."""
    expected = f"a number from {low:g} to {high:g} {unit}".rstrip()

    def convert(value: Any) -> float:
        try:
            found = float(value) if isinstance(value, (int, float, str)) else None
        except (ValueError, OverflowError):
            found = None
        if found is None or isinstance(value, bool) or not low <= found <= high:
            raise RefusedError
        return found

    return Parameter(name, default, expected, convert, meaning)


def integer(name: str, default: Any, low: float, high: float, meaning: str = "") -> Parameter:
    """Declare a whole number from `low` to `high`; see `number`."""
    read = number(name, default, "", low, high, meaning)

    def convert(value: Any) -> int:
        found = read.convert(value)
        return int(_checked(found, found == int(found)))

    return read._replace(expected=f"a whole {read.expected[2:]}", convert=convert)


def flag(name: str, default: Any, meaning: str = "") -> Parameter:
    """Declare a value that is true or false."""
    return Parameter(
        name,
        default,
        "true or false",
        lambda value: _checked(value, isinstance(value, bool)),
        meaning,
    )


def text(name: str, default: Any, meaning: str = "", expected: str = "") -> Parameter:
    """Declare text that is not empty."""
    return Parameter(name, default, expected, not_empty, meaning)


def loaded(
    name: str, load: Callable[[str], Any], meaning: str = "", expected: str = ""
) -> Parameter:
    """Declare text that has to be set; the value is what `load` reads from the file it means."""
    return Parameter(name, REQUIRED, expected, lambda value: load(not_empty(value)), meaning)


def choice(name: str, options: Sequence[str], default: Any, meaning: str = "") -> Parameter:
    """Declare a value that is one of `options`."""
    expected = f"one of {', '.join(options)}"

    def convert(value: Any) -> Any:
        return _checked(value, value in options, expected + similar(str(value), options))

    return Parameter(name, default, expected, convert, meaning)


def folder(name: str, default: Any, meaning: str = "") -> Parameter:
    """Declare a folder that exists; the value is its absolute path, see `user_path`."""

    def convert(value: Any) -> str:
        path = os.path.realpath(user_path(not_empty(value)))
        return str(_checked(path, os.path.isdir(path), f"a folder; there is none at {path}"))

    return Parameter(name, default, "", convert, meaning)


def file_name(name: str, default: Any, meaning: str = "") -> Parameter:
    """Declare the name of a file, without a folder."""

    def convert(value: Any) -> str:
        return str(_checked(not_empty(value), value not in (".", "..") and os.sep not in value))

    return Parameter(name, default, "a file name without a folder", convert, meaning)


def _checked(value: Any, is_valid: bool, expected: str = "") -> Any:
    """Return a value; raise RefusedError if it is not valid."""
    if not is_valid:
        raise RefusedError(expected)
    return value


def not_empty(value: Any) -> str:
    """Return text; raise RefusedError if it is empty, or something else."""
    return str(_checked(value, isinstance(value, str) and bool(value.strip())))


def _shown(value: Any) -> str:
    """Return a default as text."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)
