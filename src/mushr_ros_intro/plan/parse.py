"""Read plan files: a start pose, then a speed and a steering angle per line.

    0, 0, 0.785       the start pose: x [m], y [m], theta [rad]
    2.0, 0.09         speed [m/s], steering angle [rad, left positive], for one second
    3.0, -0.15, 0.5   the same with a duration [s]

Comments from ``#`` to the end of the line, blank lines, spaces, CRLF and a byte order mark
are allowed.
"""

import re
import unicodedata
from itertools import accumulate
from typing import List, Tuple

from mushr_ros_intro.geometry import MAX_COORDINATE, ORIGIN, Pose
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.plan.plan import (
    MAX_DURATION,
    MAX_SPEED,
    MAX_STEERING_ANGLE,
    Fault,
    Plan,
    PlanError,
    Row,
    as_float32,
)
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.wording import counted

MAX_FILE_SIZE = 100_000_000
"""Larger plan files are refused [bytes]; a plan of a million rows has twelve million."""

MAX_FAULTS = 1000
"""Number of faults after which the rest of a file is not checked: it is no plan."""

_DOCUMENTS = (b"PK\3\4", b"\xd0\xcf\x11\xe0", b"%PDF", b"{\\rtf", b"\x89PNG", b"\xff\xd8\xff")
"""How files of other programs begin: .docx, .odt and .zip, .doc, .pdf, .rtf, .png, .jpg."""

# Unambiguous, so that matching takes time in proportion to the length of any line.
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")

_HAS_NUMBER = re.compile("[0-9]|nan|inf", re.IGNORECASE)

_LIMITS = {
    "x": (-MAX_COORDINATE, MAX_COORDINATE, "metres"),
    "y": (-MAX_COORDINATE, MAX_COORDINATE, "metres"),
    "theta": (-MAX_COORDINATE, MAX_COORDINATE, "radians"),
    "speed": (-MAX_SPEED, MAX_SPEED, "m/s"),
    "steering angle": (-MAX_STEERING_ANGLE, MAX_STEERING_ANGLE, "radians"),
    "duration": (1.0 / NANOSECONDS, MAX_DURATION / NANOSECONDS, "seconds"),
}

_START = ("x", "y", "theta"), 3, "a start pose 'x, y, theta' in m, m, rad"
"""The names of the columns of a line, the smallest number of columns, and both for messages."""

_ROW = (
    ("speed", "steering angle", "duration"),
    2,
    "'speed, steering angle' or 'speed, steering angle, duration' in m/s, rad, s",
)


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is not a plan; it lists every fault of the file.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
    except OSError as error:
        text = f"the file cannot be read ({error.strerror}); expected a plan file"
        raise PlanError([Fault(path, 0, 0, text)]) from None
    if len(data) > MAX_FILE_SIZE:
        text = f"the file has more than {MAX_FILE_SIZE} bytes; expected a plan file"
        raise PlanError([Fault(path, 0, 0, text)])
    return parse_plan(data, path)


def read_named_plan(name: str) -> Plan:
    """Return the plan that is given by its path, or by its name in this package.

    Raises:
        UserError: the plan cannot be found or read.
    """
    return read_plan(find_file(name, package_folder("plans"), ".txt"))


def parse_plan(data: bytes, path: str) -> Plan:
    """Parse the bytes of a plan file; `path` is its name in faults and in the plan.

    Raises:
        PlanError: the bytes are not a plan; it lists every fault with line and column.
    """
    lines = _lines(data, path)
    faults: List[Fault] = []
    plan = Plan(path, ORIGIN, ())
    rows: List[Row] = []
    total = 0
    count = 0  # of the lines that are not blank: the start pose and the rows
    for number, line in enumerate(lines, 1):
        content = line.split("#", 1)[0].rstrip()
        if not content:
            continue
        cells = content.split(",")
        columns = _columns(cells)
        if not count and not _HAS_NUMBER.search(content):
            found = [(1, f"the line has no number; expected {_START[2]}, and # before a comment")]
        else:
            count += 1
            found = _line_faults(cells, columns, is_start=count == 1)
            found = found and (_foreign_character(content) or found)
        faults += [Fault(path, number, column, text) for column, text in found]
        if len(faults) >= MAX_FAULTS:
            faults.append(Fault(path, number, 1, "too many faults; the rest is not checked"))
            break
        if found:
            continue
        values = [float(cell.strip()) for cell in cells]  # float() accepts fewer spaces
        if count == 1:
            plan = Plan(path, Pose(*values), (), number, columns)
            continue
        speed, angle, seconds = [*values, 1.0][:3]
        duration = from_seconds(seconds)
        rows.append(Row(as_float32(speed), as_float32(angle), duration, number, columns))
        total += duration
        if total - duration <= MAX_DURATION < total:
            text = f"here the plan exceeds {MAX_DURATION // NANOSECONDS} s; expected a shorter plan"
            faults.append(Fault(path, number, 1, text))

    if not count:
        text = f"the file has no line with numbers; expected {_START[2]}"
        faults.append(Fault(path, 1, 1, text))
    elif count == 1:
        text = f"no command after the start pose; expected {_ROW[2]}"
        faults.append(Fault(path, len(lines), 1, text))
    if faults:
        raise PlanError(faults)
    return plan._replace(rows=tuple(rows))


def _lines(data: bytes, path: str) -> List[str]:
    """Return the lines of a plan file; raise PlanError if it is not plain text in UTF-8."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise PlanError([Fault(path, 1, 1, "the file is UTF-16; expected UTF-8 or plain ASCII")])
    if data.startswith(_DOCUMENTS):
        problem = "the file is a document, a picture or an archive; expected plain text"
        raise PlanError([Fault(path, 1, 1, problem)])
    text = data.decode("utf-8-sig", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _columns(cells: List[str]) -> Tuple[int, ...]:
    """Return the column in the line of the first character of each cell, counted from 1."""
    begins = accumulate([1, *(len(cell) + 1 for cell in cells)])
    return tuple(begin + len(cell) - len(cell.lstrip()) for begin, cell in zip(begins, cells))


def _line_faults(
    cells: List[str], columns: Tuple[int, ...], is_start: bool
) -> List[Tuple[int, str]]:
    """Return the column and the text of each fault of a line."""
    names, fewest, expected = _START if is_start else _ROW
    expected += ", separated by commas; decimals have a point"
    semicolon = ",".join(cells).find(";")
    if semicolon >= 0:  # spreadsheets write '2,0; 0,09' in countries with decimal commas
        return [(semicolon + 1, f"the line has a semicolon; expected {expected}")]
    if not fewest <= len(cells) <= len(names):
        end = columns[-1] + len(cells[-1].strip())
        column = columns[len(names)] if len(cells) > len(names) else end
        return [(column, f"{counted(len(cells), 'column')}; expected {expected}")]
    texts = [_number_fault(name, cell.strip()) for name, cell in zip(names, cells)]
    return [(column, text) for column, text in zip(columns, texts) if text]


def _foreign_character(content: str) -> List[Tuple[int, str]]:
    """Return the column and the fault of a character that only looks like one of ASCII.

    Text that is copied from a PDF or a web page contains a minus sign or a no-break space.
    """
    for column, char in enumerate(content, 1):
        typed = char
        if unicodedata.category(char) == "Pd" or char == "\N{MINUS SIGN}":
            typed = "-"
        elif unicodedata.decomposition(char).startswith(("<noBreak>", "<compat>", "<wide>")):
            typed = unicodedata.normalize("NFKC", char)
        if typed.isascii() and not char.isascii():
            name = f"{unicodedata.name(char)} (U+{ord(char):04X})"
            return [(column, f"the line has the character {name}; type {typed!r} instead")]
    return []


def _number_fault(name: str, cell: str) -> str:
    """Return the fault of one number of a plan, or an empty text."""
    if not cell:
        return f"{name} is missing; expected a number"
    shown = repr(cell if len(cell) <= 40 else cell[:37] + "...")
    if not _NUMBER.fullmatch(cell):
        if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            return f"{name} is {shown}; expected a finite number"
        return f"{name} is {shown}, which is not a number; expected one such as 0.1"
    low, high, unit = _LIMITS[name]
    if not low <= float(cell) <= high:
        return f"{name} {shown} is out of range; expected {unit}, from {low:g} to {high:g}"
    return ""
