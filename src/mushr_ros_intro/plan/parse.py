"""Parse plan files: a start pose, then a speed and a steering angle per line.

    0, 0, 0.785       the start pose: x [m], y [m], theta [rad]
    2.0, 0.09         speed [m/s], steering angle [rad, left positive], for one second
    3.0, -0.15, 0.5   the same with a duration [s]

Comments from ``#`` to the end of the line, blank lines, spaces, CRLF and a byte order mark
are allowed.
"""

import re
from typing import List, Match, Optional, Tuple

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.plan.model import (
    MAX_COORDINATE,
    MAX_DURATION,
    MAX_SPEED,
    MAX_STEERING_ANGLE,
    Fault,
    Plan,
    PlanError,
    Row,
    as_float32,
)
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

DEFAULT_DURATION = NANOSECONDS

MAX_FAULTS = 1000
"""After so many faults the rest of a file is not checked: it is not a plan, and may be huge."""

# Unambiguous, so that matching takes time in proportion to the length of any line.
_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"

_CELL = rf"\s*({_NUMBER})\s*"

_UNDECODABLE = "\udc80-\udcff"

_END = f"(?:#[^{_UNDECODABLE}]*)?"

_IS_NUMBER = re.compile(_NUMBER)

_IS_UNDECODABLE = re.compile(f"[{_UNDECODABLE}]")

_START = re.compile(f"{_CELL},{_CELL},{_CELL}{_END}")

_ROW = re.compile(f"{_CELL},{_CELL}(?:,{_CELL})?{_END}")

_MIN_SECONDS = 1.0 / NANOSECONDS

_MAX_SECONDS = MAX_DURATION / NANOSECONDS

_LIMITS = {
    "x": (MAX_COORDINATE, "metres"),
    "y": (MAX_COORDINATE, "metres"),
    "theta": (MAX_COORDINATE, "radians"),
    "speed": (MAX_SPEED, "m/s"),
    "steering angle": (MAX_STEERING_ANGLE, "radians"),
}

_START_COLUMNS = "a start pose 'x, y, theta' in m, m, rad"

_ROW_COLUMNS = "'speed, steering angle' or 'speed, steering angle, duration' in m/s, rad, s"


def parse_plan(data: bytes, path: str) -> Plan:
    """Parse the bytes of a plan file; `path` is its name in faults and in the plan.

    Raises:
        PlanError: the bytes are not a plan; it lists every fault with line and column.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise PlanError([Fault(path, 1, 1, "the file is UTF-16; expected UTF-8 or plain ASCII")])
    text = data.decode("utf-8-sig", errors="surrogateescape")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")

    faults: List[Fault] = []
    start: Optional[Plan] = None
    rows: List[Row] = []
    total = 0
    others = 0  # lines that are neither blank nor a good row: the start pose, and faulty rows
    for number, line in enumerate(lines, 1):
        row = _parse_row(line, number) if others else None
        if row:
            if total <= MAX_DURATION < total + row.duration:
                limit = MAX_DURATION // NANOSECONDS
                text = f"here the plan exceeds {limit} s; expected a shorter plan"
                faults.append(Fault(path, number, 1, text))
            total += row.duration
            rows.append(row)
            continue
        if not others:
            start = _parse_start(path, line, number)
        faults += _line_faults(path, number, line, is_start=not others)
        others += not _is_blank(line)
        if len(faults) >= MAX_FAULTS:
            text = "too many faults; the rest of the file has not been checked"
            faults.append(Fault(path, number + 1, 1, text))
            break

    if not others:
        faults.append(Fault(path, 1, 1, f"the file is empty; expected {_START_COLUMNS}"))
    elif others == 1 and not rows:
        text = f"no command after the start pose; expected {_ROW_COLUMNS}"
        faults.append(Fault(path, len(lines), 1, text))
    if faults:
        raise PlanError(faults)
    assert start is not None
    return start._replace(rows=tuple(rows))


def _parse_start(path: str, line: str, number: int) -> Optional[Plan]:
    """Return a plan without rows that starts as line `number` says, or None if it is faulty."""
    match = _START.fullmatch(line)
    if not match:
        return None
    start = Pose(*map(float, match.groups()))
    if max(map(abs, start)) > MAX_COORDINATE:
        return None
    return Plan(path, start, (), number, _columns(match))


def _parse_row(line: str, number: int) -> Optional[Row]:
    """Return the row in line `number`, or None if the line is blank or faulty."""
    match = _ROW.fullmatch(line)
    if not match:
        return None
    first, second, third = match.groups()
    speed, steering_angle = float(first), float(second)
    if abs(speed) > MAX_SPEED or abs(steering_angle) > MAX_STEERING_ANGLE:
        return None
    duration = DEFAULT_DURATION
    if third is not None:
        seconds = float(third)
        if not _MIN_SECONDS <= seconds <= _MAX_SECONDS:
            return None
        duration = from_seconds(seconds)
    speed, steering_angle = as_float32(speed), as_float32(steering_angle)
    return Row(speed, steering_angle, duration, number, _columns(match))


def _columns(match: Match[str]) -> Tuple[int, ...]:
    """Return the column of every number in a line, counted from 1."""
    starts = (match.start(group) for group in range(1, match.re.groups + 1))
    return tuple(start + 1 for start in starts if start >= 0)


def _is_blank(line: str) -> bool:
    """Return whether a line is empty but for a comment."""
    return not line.split("#", 1)[0].strip()


def _line_faults(path: str, number: int, line: str, is_start: bool) -> List[Fault]:
    """Return every fault of a line; a blank line has none."""
    undecodable = _IS_UNDECODABLE.search(line)
    if undecodable:
        byte = ord(undecodable.group()) - 0xDC00
        text = f"byte 0x{byte:02x} is not UTF-8; expected a text file in UTF-8 or plain ASCII"
        return [Fault(path, number, undecodable.start() + 1, text)]
    if _is_blank(line):
        return []
    if is_start:
        names, fewest, columns = ("x", "y", "theta"), 3, _START_COLUMNS
    else:
        names, fewest, columns = ("speed", "steering angle", "duration"), 2, _ROW_COLUMNS

    content = line.split("#", 1)[0].rstrip()
    cells = content.split(",", len(names))
    if not fewest <= len(cells) <= len(names):
        count = content.count(",") + 1
        counted = "1 column" if count == 1 else f"{count} columns"
        surplus = cells[-1].lstrip() if count > len(names) else ""
        column = len(content) - len(surplus) + 1
        return [Fault(path, number, column, f"{counted}; expected {columns}")]

    faults = []
    begin = 1  # the column of the first character of a cell
    for name, cell in zip(names, cells):
        text = _number_fault(name, cell.strip())
        if text:
            indent = len(cell) - len(cell.lstrip())
            faults.append(Fault(path, number, begin + indent, text))
        begin += len(cell) + 1
    return faults


def _number_fault(name: str, cell: str) -> str:
    """Return the fault of one number of a plan, or an empty text."""
    if not cell:
        return f"{name} is missing; expected a number"
    shown = repr(cell if len(cell) <= 40 else cell[:37] + "...")
    if not _IS_NUMBER.fullmatch(cell):
        if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            return f"{name} is {shown}; expected a finite number"
        return f"{name} is {shown}, which is not a number; expected one such as 2.0"
    value = float(cell)
    if name == "duration":
        if value < _MIN_SECONDS:
            return f"duration {shown} is not positive; expected seconds, {_MIN_SECONDS:g} or more"
        if value > _MAX_SECONDS:
            return f"duration {shown} is out of range; expected seconds, {_MAX_SECONDS:g} at most"
        return ""
    limit, unit = _LIMITS[name]
    if abs(value) > limit:
        return f"{name} {shown} is out of range; expected {unit}, from -{limit:g} to {limit:g}"
    return ""
