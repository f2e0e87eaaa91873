"""Wording of messages."""

from difflib import get_close_matches
from typing import Iterable


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, such as 2 rows."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def similar(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return a question that names the known name most like `name`; empty if none is like it.

    A name of three letters or more is also like the shortest known name that contains it.
    """
    known = sorted(known, key=len)
    containing = [each for each in known if len(name) > 2 and name in each]
    close = get_close_matches(name, known, 1, 0.7) or containing
    return f"; did you mean {prefix}{close[0]}?" if close else ""
