"""Wording of messages."""

from difflib import get_close_matches
from typing import Iterable


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, such as 2 rows."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def similar(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return a question that names the known name most like `name`; empty if none is like it."""
    close = get_close_matches(name, list(known), 1)
    return f"; did you mean {prefix}{close[0]}?" if close else ""
