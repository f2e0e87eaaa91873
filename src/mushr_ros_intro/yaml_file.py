"""Read small YAML files that users write."""

import re
from typing import Any, Dict

import yaml

from mushr_ros_intro.errors import UserError


class _Loader(yaml.SafeLoader):
    """Refuses a key that is there twice: PyYAML takes the last value, yaml-cpp the first."""

    def construct_mapping(self, node: Any, deep: bool = False) -> Dict[Any, Any]:
        keys = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:merge":
                value = repr(self.construct_object(key, deep=True))
                if value in keys:
                    problem = f"the key {value} is there twice"
                    raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
                keys.add(value)
        return super().construct_mapping(node, deep)


def read_mapping(path: str, expected: str, is_map: bool = False) -> Dict[str, Any]:
    """Return the mapping in a YAML file; an empty file is an empty mapping.

    Args:
        path: the file.
        expected: ends each error message, as in "keys such as 'image: map.png'".
        is_map: accept what yaml-cpp accepts, with which map_server reads maps: a tab after a key,
            more documents after the first, and other encodings in comments.

    Raises:
        UserError: the file cannot be read, or is not a mapping.
    """
    try:
        with open(path, "rb") as file:
            data = file.read()
        if is_map:
            text = re.sub(r"(?m)^(\s*\w+:)[ \t]+", r"\1 ", data.decode(errors="replace"))
            values = next(yaml.load_all(text, _Loader), None)
        else:
            values = yaml.load(data, _Loader)
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
