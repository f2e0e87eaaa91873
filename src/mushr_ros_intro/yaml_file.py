"""Read small YAML files that users write."""

from typing import Any, Dict

import yaml

from mushr_ros_intro.errors import UserError


def read_mapping(path: str, expected: str) -> Dict[str, Any]:
    """Return the mapping in a YAML file; an empty file is an empty mapping.

    Args:
        path: the file.
        expected: ends each error message, as in "keys such as 'image: map.png'".

    Raises:
        UserError: the file cannot be read, or is not a mapping.
    """
    try:
        with open(path, "rb") as file:
            values = yaml.safe_load(file)
        if not isinstance(values or {}, dict):
            raise ValueError("the file has no keys")
    except Exception as problem:  # PyYAML raises errors of many classes, such as for !!int x
        raise UserError(f"{path}: {_reason(problem)}; expected {expected}") from None
    return values or {}


def _reason(problem: Exception) -> str:
    """Return the reason for an error, on one line, with its position in the file if known."""
    if isinstance(problem, OSError):
        return f"the file cannot be read ({problem.strerror})"
    mark = getattr(problem, "problem_mark", None)
    position = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
    text = getattr(problem, "problem", None) or str(problem) or type(problem).__name__
    return position + " ".join(text.split())
