"""Read small YAML files that users write."""

import os
import stat
from typing import Any, Dict, Type

import yaml

from mushr_ros_intro.errors import UserError

MAX_SIZE = 65_536
"""Larger files are refused [bytes]."""


def _compose_node(loader: Any, parent: Any, index: Any) -> Any:
    """Compose a node as PyYAML does, but refuse aliases.

    A few lines of aliases can stand for more than fits in memory.
    """
    if loader.check_event(yaml.AliasEvent):
        raise yaml.MarkedYAMLError(None, None, "found an alias", loader.peek_event().start_mark)
    return yaml.composer.Composer.compose_node(loader, parent, index)


class _TextLoader(yaml.BaseLoader):
    """Load every scalar as text."""

    compose_node = _compose_node


class _ValueLoader(yaml.SafeLoader):
    """Load scalars as text, numbers, booleans and null."""

    compose_node = _compose_node


def read_mapping(
    path: str, expected: str, error: Type[UserError], as_text: bool = False
) -> Dict[str, Any]:
    """Return the mapping in a YAML file; an empty file is an empty mapping.

    Args:
        path: the file.
        expected: ends each error message, as in "keys such as 'image: map.png'".
        error: the class of the errors.
        as_text: whether to load every scalar as text.

    Raises:
        UserError: of the class `error`, if the file cannot be read or is not a mapping.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            kind = "a directory" if os.path.isdir(path) else "not a regular file"
            raise ValueError(f"this is {kind}")
        with open(path, "rb") as file:
            data = file.read(MAX_SIZE + 1)
        if len(data) > MAX_SIZE:
            raise ValueError(f"the file has more than {MAX_SIZE} bytes")
        values = yaml.load(data, _TextLoader if as_text else _ValueLoader)  # noqa: S506, both are safe
        if not isinstance(values or {}, dict):
            raise ValueError("the file has no keys")
    except Exception as problem:  # PyYAML raises errors of many classes, such as for !!int x
        raise error(f"{path}: {_reason(problem)}; expected {expected}") from None
    return values or {}


def _reason(problem: Exception) -> str:
    """Return the reason for an error, on one line, with its position in the file if known."""
    if isinstance(problem, OSError):
        return f"the file cannot be read ({problem.strerror})"
    if isinstance(problem, RecursionError):
        return "this is nested too deeply"
    mark = getattr(problem, "problem_mark", None)
    position = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
    text = getattr(problem, "problem", None) or str(problem) or type(problem).__name__
    return position + " ".join(text.split())
