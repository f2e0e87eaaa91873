"""Read and write plan files: a start pose, then a speed and a steering angle a line.

    0, 0, 0.785       the start pose: x [m], y [m], theta [rad]
    2.0, 0.09         speed [m/s], steering angle [rad, left positive], for one second
    3.0, -0.15, 0.5   the same with a duration [s]

Comments from ``#`` to the end of the line, blank lines, spaces, CRLF and a byte order mark
are all fine.
"""

import itertools
import os
import re
import stat
import struct
from typing import List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

DEFAULT_DURATION = NANOSECONDS

MAX_FILE_SIZE = 100_000_000
"""A plan file is refused beyond this size [bytes]; a plan of a million rows has twelve million."""

MAX_DURATION = 1_000_000_000 * NANOSECONDS
"""A plan beyond this duration [ns] is refused: stamps must fit into ROS's 32 bits of seconds."""

MAX_COORDINATE = 1e6
"""A start pose beyond this [m, rad] is refused: nobody means it, and it would cost digits."""

MAX_SPEED = 1e3
"""A speed beyond this [m/s] is refused, for the same reason."""

MAX_STEERING_ANGLE = 1.57
"""The largest steering angle [rad]; at a right angle a bicycle would turn on the spot."""

MAX_FAULTS = 1000
"""After so many faults the rest of a file is not checked: it is no plan, and may be huge."""

# Unambiguous, so that matching takes time in proportion to the line, whatever stands there.
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


class Row(NamedTuple):
    """One command of a plan and how long it lasts."""

    speed: float
    """Forward speed [m/s], negative in reverse."""
    steering_angle: float
    """Steering angle of the virtual middle front wheel [rad], left positive."""
    duration: int
    """How long the command lasts [ns]."""
    line: int
    """Where it stands in the file, counted from 1."""


class Plan(NamedTuple):
    """A start pose and the commands that follow it."""

    path: str
    """The file that it was read from."""
    start: Tuple[float, float, float]
    """x [m], y [m], theta [rad] in the map frame."""
    rows: Tuple[Row, ...]

    @property
    def duration(self) -> int:
        """How long the whole plan lasts [ns]."""
        return sum(row.duration for row in self.rows)


class Fault(NamedTuple):
    """One thing that is wrong with a plan file."""

    path: str
    line: int
    column: int
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}: {self.text}"


class PlanError(ValueError):
    """A plan file that cannot be driven, with all that is wrong with it in ``faults``."""

    SHOWN = 20

    def __init__(self, faults: Sequence[Fault]):
        self.faults = tuple(faults)
        lines = [str(fault) for fault in self.faults[: self.SHOWN]]
        if len(self.faults) > self.SHOWN:
            lines.append(f"... and {len(self.faults) - self.SHOWN} more faults")
        super().__init__("\n".join(lines))


class WriteError(RuntimeError):
    """A plan that could not be written; says where and why."""


def find_plan(name: str, plans: str, folders: Sequence[str]) -> str:
    """Find the file that a user means by `name`.

    A bare name is looked up in the folder `plans` first, with or without ``.txt``; anything else
    is a path, tried as it is and, where it is relative, in each of `folders`.

    Returns:
        The path of a file that exists.

    Raises:
        PlanError: nothing of that name is there; the message lists the plans that are.
    """
    candidates = []
    if name and os.sep not in name:
        candidates += [os.path.join(plans, name), os.path.join(plans, name + ".txt")]
    candidates += [os.path.join(folder, os.path.expanduser(name)) for folder in folders]
    for candidate in candidates:
        if name and os.path.isfile(candidate):
            return candidate
    for candidate in candidates:
        if name and os.path.exists(candidate):
            return candidate  # not a file, which read_plan says better
    try:
        known = sorted(entry[:-4] for entry in os.listdir(plans) if entry.endswith(".txt"))
    except OSError:
        known = []
    raise PlanError(
        [
            Fault(
                name or "''",
                1,
                1,
                "no such plan file; expected the path of a file, or the name of one in "
                f"{plans}: {', '.join(known) or '(there are none)'}",
            )
        ]
    )


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is no plan; it names every fault of the file.
    """
    return parse_plan(read_bytes(path), path)


def read_bytes(path: str) -> bytes:
    """Return what stands in the plan file at `path`.

    Raises:
        PlanError: it cannot be read, or is too large for a plan.
    """

    def refuse(text: str) -> PlanError:
        return PlanError([Fault(path, 1, 1, text)])

    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise refuse("this is a directory; expected a plan file")
        if not stat.S_ISREG(status.st_mode):
            raise refuse("this is not a regular file; expected a plan file")
        if status.st_size > MAX_FILE_SIZE:
            raise refuse(
                f"the file has {status.st_size} bytes; "
                f"expected a plan file of at most {MAX_FILE_SIZE}"
            )
        with open(path, "rb") as file:
            return file.read(MAX_FILE_SIZE + 1)
    except PlanError:
        raise
    except FileNotFoundError:
        raise refuse("no such file; expected a plan file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(f"the file cannot be read ({reason}); expected a plan file") from None


def parse_plan(data: bytes, path: str) -> Plan:
    """Parse the bytes of a plan file; `path` is the name that faults and the plan carry.

    Raises:
        PlanError: the bytes are no plan; it names every fault, with line and column from 1.
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise PlanError([Fault(path, 1, 1, "the file is UTF-16; expected UTF-8 or plain ASCII")])
    text = data.decode("utf-8-sig", errors="surrogateescape")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")

    faults: List[Fault] = []
    start = None
    rows: List[Row] = []
    total = 0
    others = 0  # lines that are not blank and no good row: the start pose, and faulty rows
    for number, line in enumerate(lines, 1):
        row = _read_row(line, number) if others else None
        if row:
            if total <= MAX_DURATION < total + row.duration:
                limit = MAX_DURATION // NANOSECONDS
                text = f"here the plan exceeds {limit} s; expected a shorter plan"
                faults.append(Fault(path, number, 1, text))
            total += row.duration
            rows.append(row)
            continue
        if not others:
            start = _read_start(line)
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
    return Plan(path, start, tuple(rows))


def write_plan(folder: str, name: str, start: Sequence[float], rows: Sequence[Row]) -> str:
    """Write a plan into a new file.

    No file is overwritten: where there is one of that name, the new one gets a number. Nothing
    stays of a file that cannot be written to its end.

    Args:
        folder: the folder that the file goes into.
        name: of the file.
        start: x [m], y [m], theta [rad] in the map frame.
        rows: the commands; the lines that they name do not matter.

    Returns:
        The path of the file.

    Raises:
        WriteError: it cannot be written, or read_plan would not take it.
    """
    data = plan_text(start, rows).encode()
    try:
        parse_plan(data, name)
    except PlanError as error:
        raise WriteError(f"this is no plan that can be driven: {error}") from None
    stem, ending = os.path.splitext(name)
    for number in itertools.count(1):
        path = os.path.join(folder, name if number == 1 else f"{stem}_{number}{ending}")
        try:
            with open(path, "xb") as file:
                try:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                except BaseException:
                    os.unlink(path)
                    raise
        except FileExistsError:
            continue
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise WriteError(f"{path} cannot be written ({reason})") from None
        return path
    raise AssertionError("there is always another number")


def plan_text(start: Sequence[float], rows: Sequence[Row]) -> str:
    """Return the text of a plan file.

    The start pose and the durations are exact. Speeds and steering angles have the digits that
    they keep as float32, as which they travel.

    Args:
        start: x [m], y [m], theta [rad] in the map frame.
        rows: the commands; the lines that they name do not matter.
    """
    lines = ["# x [m], y [m], theta [rad]", ", ".join(repr(float(value)) for value in start)]
    lines.append("# speed [m/s], steering angle [rad], duration [s]")
    for row in rows:
        seconds, rest = divmod(row.duration, NANOSECONDS)
        duration = f"{seconds}.{rest:09d}".rstrip("0") + ("" if rest else "0")
        lines.append(f"{_as_float32(row.speed)}, {_as_float32(row.steering_angle)}, {duration}")
    return "\n".join(lines) + "\n"


def _as_float32(value: float) -> str:
    """Return the shortest number that is the same as `value` when both travel as float32."""
    travelling = struct.pack("<f", value + 0.0)  # no negative zero
    (value,) = struct.unpack("<f", travelling)  # of which nine digits are enough
    texts = (f"{value:.{digits}g}" for digits in range(1, 10))
    return next(repr(float(t)) for t in texts if struct.pack("<f", float(t)) == travelling)


def _read_start(line: str) -> Optional[Tuple[float, float, float]]:
    """Return the start pose that stands in a line, or None where there is no good one."""
    match = _START.fullmatch(line)
    if not match:
        return None
    x, y, theta = map(float, match.groups())
    return (x, y, theta) if max(abs(x), abs(y), abs(theta)) <= MAX_COORDINATE else None


def _read_row(line: str, number: int) -> Optional[Row]:
    """Return the row that stands in line `number`, or None where there is no good one."""
    match = _ROW.fullmatch(line)
    if not match:
        return None
    first, second, third = match.groups()
    speed, steering_angle = float(first), float(second)
    if abs(speed) > MAX_SPEED or abs(steering_angle) > MAX_STEERING_ANGLE:
        return None
    if third is None:
        return Row(speed, steering_angle, DEFAULT_DURATION, number)
    seconds = float(third)
    if not _MIN_SECONDS <= seconds <= _MAX_SECONDS:
        return None
    return Row(speed, steering_angle, from_seconds(seconds), number)


def _is_blank(line: str) -> bool:
    """Say whether a line holds nothing but a comment."""
    return not line.split("#", 1)[0].strip()


def _line_faults(path: str, number: int, line: str, is_start: bool) -> List[Fault]:
    """Find every fault of a line; there is none in a blank one."""
    undecodable = _IS_UNDECODABLE.search(line)
    if undecodable:
        byte = ord(undecodable.group()) - 0xDC00
        text = f"byte 0x{byte:02x} is not UTF-8; expected a text file in UTF-8 or plain ASCII"
        return [Fault(path, number, undecodable.start() + 1, text)]
    if _is_blank(line):
        return []
    if is_start:
        names, least, columns = ("x", "y", "theta"), 3, _START_COLUMNS
    else:
        names, least, columns = ("speed", "steering angle", "duration"), 2, _ROW_COLUMNS

    content = line.split("#", 1)[0].rstrip()
    cells = content.split(",", len(names))
    if not least <= len(cells) <= len(names):
        count = content.count(",") + 1
        counted = "1 column" if count == 1 else f"{count} columns"
        surplus = cells[-1].lstrip() if count > len(names) else ""
        column = len(content) - len(surplus) + 1
        return [Fault(path, number, column, f"{counted}; expected {columns}")]

    faults = []
    begin = 1  # the column in which a cell begins
    for name, cell in zip(names, cells):
        text = _number_fault(name, cell.strip())
        if text:
            indent = len(cell) - len(cell.lstrip())
            faults.append(Fault(path, number, begin + indent, text))
        begin += len(cell) + 1
    return faults


def _number_fault(name: str, cell: str) -> str:
    """Say what is wrong with one number of a plan, or nothing."""
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
