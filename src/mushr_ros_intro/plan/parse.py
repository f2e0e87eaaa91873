"""Read plan files: a start pose, then a speed and a steering angle per line.

    0, 0, 0.785       the start pose: x [m], y [m], theta [rad]
    2.0, 0.09         speed [m/s], steering angle [rad, left positive], for one second
    3.0, -0.15, 0.5   the same with a duration [s]

Comments from ``#`` to the end of the line, blank lines, spaces, CRLF and a byte order mark
are allowed.
"""

import os
import re
from typing import List, Optional, Tuple

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.errors import counted
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

MAX_FILE_SIZE = 100_000_000
"""Larger plan files are refused [bytes]; a plan of a million rows has twelve million."""

MAX_FAULTS = 1000
"""After so many faults the rest of a file is not checked: it is not a plan, and may be huge."""

# Unambiguous, so that matching takes time in proportion to the length of any line.
_NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"

_IS_NUMBER = re.compile(_NUMBER)

_IS_UNDECODABLE = re.compile("[\udc80-\udcff]")

_LIMITS = {
    "x": (-MAX_COORDINATE, MAX_COORDINATE, "metres"),
    "y": (-MAX_COORDINATE, MAX_COORDINATE, "metres"),
    "theta": (-MAX_COORDINATE, MAX_COORDINATE, "radians"),
    "speed": (-MAX_SPEED, MAX_SPEED, "m/s"),
    "steering angle": (-MAX_STEERING_ANGLE, MAX_STEERING_ANGLE, "radians"),
    "duration": (1.0 / NANOSECONDS, MAX_DURATION / NANOSECONDS, "seconds"),
}

_START_COLUMNS = "a start pose 'x, y, theta' in m, m, rad"

_ROW_COLUMNS = "'speed, steering angle' or 'speed, steering angle, duration' in m/s, rad, s"


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is not a plan; it lists every fault of the file.
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise ValueError("this is not a regular file")  # reading a FIFO may take forever
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
        if len(data) > MAX_FILE_SIZE:
            raise ValueError(f"it has more than {MAX_FILE_SIZE} bytes")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        text = f"the file cannot be read ({reason}); expected a plan file"
        raise PlanError([Fault(path, 0, 0, text)]) from None
    return parse_plan(data, path)


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
    count = 0  # of the lines that are not blank: the start pose and the rows
    for number, line in enumerate(lines, 1):
        values, columns, found = _parse_line(line, is_start=not count)
        faults += [Fault(path, number, column, text) for column, text in found]
        if values and not count:
            start = Plan(path, Pose(*values), (), number, columns)
        elif values:
            duration = from_seconds(values[2]) if len(values) > 2 else DEFAULT_DURATION
            command = as_float32(values[0]), as_float32(values[1])
            rows.append(Row(*command, duration, number, columns))
            before, total = total, total + duration
            if before <= MAX_DURATION < total:
                limit = MAX_DURATION // NANOSECONDS
                text = f"here the plan exceeds {limit} s; expected a shorter plan"
                faults.append(Fault(path, number, 1, text))
        count += bool(line.split("#", 1)[0].strip())
        if len(faults) >= MAX_FAULTS:
            text = "too many faults; the rest of the file has not been checked"
            faults.append(Fault(path, number + 1, 1, text))
            break

    if not count:
        faults.append(Fault(path, 1, 1, f"the file is empty; expected {_START_COLUMNS}"))
    elif count == 1:
        text = f"no command after the start pose; expected {_ROW_COLUMNS}"
        faults.append(Fault(path, len(lines), 1, text))
    if faults:
        raise PlanError(faults)
    assert start is not None
    return start._replace(rows=tuple(rows))


def _parse_line(
    line: str, is_start: bool
) -> Tuple[List[float], Tuple[int, ...], List[Tuple[int, str]]]:
    """Return the numbers of a line, their columns from 1, and each fault's column and text.

    There are no numbers if the line is blank or has a fault.
    """
    undecodable = _IS_UNDECODABLE.search(line)
    if undecodable:
        byte = ord(undecodable.group()) - 0xDC00
        text = f"byte 0x{byte:02x} is not UTF-8; expected a text file in UTF-8 or plain ASCII"
        return [], (), [(undecodable.start() + 1, text)]
    content = line.split("#", 1)[0].rstrip()
    if not content:
        return [], (), []
    if is_start:
        names, fewest, expected = ("x", "y", "theta"), 3, _START_COLUMNS
    else:
        names, fewest, expected = ("speed", "steering angle", "duration"), 2, _ROW_COLUMNS
    cells = content.split(",", len(names))
    if not fewest <= len(cells) <= len(names):
        count = content.count(",") + 1
        surplus = cells[-1].lstrip() if count > len(names) else ""
        text = f"{counted(count, 'column')}; expected {expected}"
        return [], (), [(len(content) - len(surplus) + 1, text)]

    columns, faults = [], []
    begin = 1  # the column of the first character of a cell
    for name, cell in zip(names, cells):
        columns.append(begin + len(cell) - len(cell.lstrip()))
        begin += len(cell) + 1
        text = _number_fault(name, cell.strip())
        if text:
            faults.append((columns[-1], text))
    return [] if faults else [float(cell) for cell in cells], tuple(columns), faults


def _number_fault(name: str, cell: str) -> str:
    """Return the fault of one number of a plan, or an empty text."""
    if not cell:
        return f"{name} is missing; expected a number"
    shown = repr(cell if len(cell) <= 40 else cell[:37] + "...")
    if not _IS_NUMBER.fullmatch(cell):
        if cell.lower().lstrip("+-") in ("nan", "inf", "infinity"):
            return f"{name} is {shown}; expected a finite number"
        return f"{name} is {shown}, which is not a number; expected one such as 2.0"
    low, high, unit = _LIMITS[name]
    if not low <= float(cell) <= high:
        return f"{name} {shown} is out of range; expected {unit}, from {low:g} to {high:g}"
    return ""
