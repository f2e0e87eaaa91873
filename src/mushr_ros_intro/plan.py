"""Read plan files: a start pose, then a speed and a steering angle a line.

    0, 0, 0.785       the start pose: x [m], y [m], theta [rad]
    2.0, 0.09         speed [m/s], steering angle [rad, left positive], for one second
    3.0, -0.15, 0.5   the same with a duration [s]

Comments from ``#`` to the end of the line, blank lines, spaces, CRLF and a byte order mark
are all fine.
"""

import math
import os
import re
import stat
from typing import List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

DEFAULT_DURATION = NANOSECONDS

MAX_FILE_SIZE = 100_000_000
"""A plan file is refused beyond this size [bytes]; a plan of a million rows has twelve million."""

MAX_DURATION = 1_000_000_000 * NANOSECONDS
"""A plan is refused beyond this duration [ns], so that its stamps fit into ROS's 32 bits of seconds."""

MAX_COORDINATE = 1e6
"""A start pose further away [m] is refused: nobody means it, and it would cost digits."""

MAX_SPEED = 3.4028234663852886e38
"""The largest speed [m/s] that an AckermannDrive, whose fields are float32, can carry."""

MAX_STEERING_ANGLE = 1.57
"""The largest steering angle [rad]; at a right angle a bicycle would turn on the spot."""

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_IS_NUMBER = re.compile(_NUMBER)
_ROW = re.compile(rf"\s*({_NUMBER})\s*,\s*({_NUMBER})\s*(?:,\s*({_NUMBER})\s*)?(?:#.*)?")

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
                f"the file has {status.st_size} bytes; expected a plan file of at most {MAX_FILE_SIZE}"
            )
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
    except FileNotFoundError:
        raise refuse("no such file; expected a plan file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(f"the file cannot be read ({reason}); expected a plan file") from None
    return parse_plan(data, path)


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
    for number, line in enumerate(lines, 1):
        match = _ROW.fullmatch(line) if start is not None else None
        if match and match.group(3) is None:
            duration = DEFAULT_DURATION
            row = Row(float(match.group(1)), float(match.group(2)), duration, number)
            good = abs(row.speed) <= MAX_SPEED and abs(row.steering_angle) <= MAX_STEERING_ANGLE
        else:
            good = False
        if not good:
            cells = _split(line)
            if not cells:
                continue
            found = _cell_faults(path, number, line, cells, is_start=start is None)
            faults += found
            if start is None:
                start = (0.0, 0.0, 0.0) if found else tuple(float(cell) for _, cell in cells)
                continue
            if found:
                continue
            values = [float(cell) for _, cell in cells]
            duration = from_seconds(values[2]) if len(values) == 3 else DEFAULT_DURATION
            row = Row(values[0], values[1], duration, number)
        if total <= MAX_DURATION < total + duration:
            limit = MAX_DURATION // NANOSECONDS
            faults.append(
                Fault(path, number, 1, f"here the plan exceeds {limit} s; expected a shorter plan")
            )
        total += duration
        rows.append(row)

    if start is None:
        faults.append(Fault(path, 1, 1, f"the file is empty; expected {_START_COLUMNS}"))
    elif not rows and not faults:
        faults.append(
            Fault(path, len(lines), 1, f"no command after the start pose; expected {_ROW_COLUMNS}")
        )
    if faults:
        raise PlanError(faults)
    assert start is not None
    return Plan(path, start, tuple(rows))


def _split(line: str) -> List[Tuple[int, str]]:
    """Cut a line into (column from 1, cell without the space around it); [] where it is blank."""
    line = line.split("#", 1)[0]
    if not line.strip():
        return []
    cells = []
    column = 0
    for cell in line.split(","):
        content = cell.strip()
        indent = len(cell) - len(cell.lstrip()) if content else 0
        cells.append((column + indent + 1, content))
        column += len(cell) + 1
    return cells


def _cell_faults(
    path: str, number: int, line: str, cells: Sequence[Tuple[int, str]], is_start: bool
) -> List[Fault]:
    """Find every fault in the cells of one line."""
    undecodable = re.search("[\udc80-\udcff]", line)
    if undecodable:
        byte = ord(undecodable.group()) - 0xDC00
        text = f"byte 0x{byte:02x} is not UTF-8; expected a text file in UTF-8 or plain ASCII"
        return [Fault(path, number, undecodable.start() + 1, text)]
    if is_start:
        names, least, columns = ("x", "y", "theta"), 3, _START_COLUMNS
    else:
        names, least, columns = ("speed", "steering angle", "duration"), 2, _ROW_COLUMNS
    if not least <= len(cells) <= len(names):
        column = cells[len(names)][0] if len(cells) > len(names) else len(line.rstrip()) + 1
        count = "1 column" if len(cells) == 1 else f"{len(cells)} columns"
        return [Fault(path, number, column, f"{count}; expected {columns}")]

    faults = []
    for name, (column, cell) in zip(names, cells):
        text = _number_fault(name, cell)
        if text:
            faults.append(Fault(path, number, column, text))
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
    if not math.isfinite(value) or (name in "xy" and abs(value) > MAX_COORDINATE):
        return f"{name} {shown} is too large; expected at most {MAX_COORDINATE:g}"
    if name == "speed" and abs(value) > MAX_SPEED:
        return f"speed {shown} does not fit into a float32; expected m/s"
    if name == "steering angle" and abs(value) > MAX_STEERING_ANGLE:
        limit = MAX_STEERING_ANGLE
        return f"steering angle {shown} is out of range; expected radians, from -{limit} to {limit}"
    if name == "duration" and not value * NANOSECONDS >= 0.5:
        return f"duration {shown} is not positive; expected seconds, 1e-9 or more"
    return ""
