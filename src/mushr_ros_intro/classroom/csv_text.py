"""Write text for pages and tables: without terminal codes, and in CSV without formulas."""

import csv
import io
import re
import unicodedata
from typing import Iterable, Sequence

_TERMINAL_CODE = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(\x07|\x1b\\)?)")
_NOT_TEXT = re.compile("[^\t\n\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_FORMULA = ("=", "+", "-", "@")
"""A cell that begins like this is a formula in spreadsheet programs."""


def clean(text: str) -> str:
    """Return text without terminal codes; a character that XML does not allow becomes U+FFFD."""
    lines = _TERMINAL_CODE.sub("", text).replace("\r\n", "\n").replace("\r", "\n")
    return _NOT_TEXT.sub("\ufffd", lines)


def shown(points: float) -> str:
    """Return points as text, such as 2 or 0.5."""
    return f"{points:.12g}"


def as_csv(rows: Iterable[Sequence[str]]) -> str:
    """Return rows as CSV; text that looks like a formula gets a leading apostrophe."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([*map(plain, row)] for row in rows)
    return text.getvalue()


def plain(text: str) -> str:
    """Return text on one line that no spreadsheet program takes for a formula."""
    line = " ".join(clean(text).split())
    is_formula = unicodedata.normalize("NFKC", line).lstrip().startswith(_FORMULA)
    return f"'{line}" if is_formula else line
