"""Write tables that no spreadsheet program takes for formulas."""

import csv
import io
import re
import unicodedata
from typing import Iterable, Sequence

from mushr_ros_intro.classroom.html_page import clean

_FORMULA = ("=", "+", "-", "@")
"""A cell that begins like this is a formula in spreadsheet programs."""

_NUMBER = re.compile(r"-?[0-9.]+")


def as_csv(rows: Iterable[Sequence[str]]) -> str:
    """Return rows as CSV; text that looks like a formula gets a leading apostrophe."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([*map(plain, row)] for row in rows)
    return text.getvalue()


def plain(text: str) -> str:
    """Return text on one line that no spreadsheet program takes for a formula."""
    line = " ".join(clean(text).split())
    is_formula = unicodedata.normalize("NFKC", line).lstrip().startswith(_FORMULA)
    return f"'{line}" if is_formula and not _NUMBER.fullmatch(line) else line
