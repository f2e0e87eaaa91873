"""Check the values of a node's parameters."""

import os
from typing import Any


class ParameterError(ValueError):
    """A parameter with a value that the node cannot use; names it, its value and the remedy."""


def number(name: str, value: Any, unit: str, least: float, most: float) -> float:
    """Return `value` as a float if it is a number from `least` to `most`.

    Raises:
        ParameterError: it is not.
    """
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    try:
        if is_number and least <= value <= most:
            return float(value)
    except OverflowError:
        pass  # an integer that no float holds, where there is no upper limit
    raise ParameterError(
        f"parameter {name} is {value!r}; expected a number from {least:g} to {most:g} {unit}"
    )


def flag(name: str, value: Any) -> bool:
    """Return `value` if it is true or false.

    Raises:
        ParameterError: it is not.
    """
    if not isinstance(value, bool):
        raise ParameterError(f"parameter {name} is {value!r}; expected true or false")
    return value


def text(name: str, value: Any) -> str:
    """Return `value` if it is text that is not empty.

    Raises:
        ParameterError: it is not.
    """
    if not isinstance(value, str) or not value.strip():
        raise ParameterError(f"parameter {name} is {value!r}; expected text that is not empty")
    return value


def folder(name: str, value: Any) -> str:
    """Return the path of the folder `value`; a relative one leads from where the user stands.

    roslaunch starts its nodes in ROS_HOME but leaves PWD as its own shell had it.

    Raises:
        ParameterError: it is not text, or no folder is there.
    """
    path = os.path.join(os.environ.get("PWD", "."), os.path.expanduser(text(name, value)))
    path = os.path.realpath(path)
    if not os.path.isdir(path):
        raise ParameterError(
            f"parameter {name} is {value!r}; expected a folder; there is none at {path}"
        )
    return path


def file_name(name: str, value: Any) -> str:
    """Return `value` if it can name a file in a folder.

    Raises:
        ParameterError: it cannot.
    """
    if not isinstance(value, str) or value in ("", ".", "..") or os.sep in value:
        raise ParameterError(f"parameter {name} is {value!r}; expected a file's name, no folder")
    return value
