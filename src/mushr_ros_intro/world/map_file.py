"""Read the maps of map_server.

A map is a yaml file beside a picture, PNG or PGM. What each cell becomes is map_server's own rule,
to the cell (map_server's page on the ROS wiki, "Value Interpretation", and the code of its Noetic
release where the page is silent).
"""

import math
import os
import re
import stat
from typing import Any, Dict, List, NamedTuple, Optional, Sequence

import numpy as np
import yaml

from mushr_ros_intro.car.bicycle import ORIGIN, Pose
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.world.grid import (
    LEAST_RESOLUTION,
    MOST_RESOLUTION,
    UNKNOWN,
    Grid,
    as_travelled,
)

MAX_CELLS = 400_000_000
"""A map with more cells is refused before it is decoded; 10000 x 10000 are a quarter of this."""

MAX_YAML_SIZE = 65_536
"""A map's yaml is refused beyond this size [bytes]; it has seven lines."""

MAX_COORDINATE = 1e6
"""An origin further away [m] is refused: nobody means it, and it would cost digits."""

MODES = ("trinary", "scale", "raw")

_BLOCK = 4_000_000  # pixels that are turned into cells at a time


class MapFault(NamedTuple):
    """One thing that is wrong with a map."""

    path: str
    """The yaml file."""
    key: str
    """The key in it that is to blame, or nothing."""
    text: str

    def __str__(self) -> str:
        return ": ".join(part for part in self if part)


class MapError(UserError):
    """A map that cannot be used, with all that is wrong with it in ``faults``, one a line."""

    def __init__(self, faults: Sequence[MapFault]):
        self.faults = tuple(faults)
        super().__init__("\n".join(map(str, self.faults)))


def find_map(name: str, maps: str, folders: Sequence[str] = (".",)) -> str:
    """Find the yaml file that a user means by `name`.

    A bare name is looked up in the folder `maps` first, with or without ``.yaml``; anything else
    is a path, tried as it is and, where it is relative, in each of `folders`.

    Returns:
        The path of a file that exists.

    Raises:
        MapError: nothing of that name is there; the message lists the maps that are.
    """
    candidates = []
    if name and os.sep not in name:
        candidates += [os.path.join(maps, name + ".yaml"), os.path.join(maps, name)]
    candidates += [os.path.join(folder, os.path.expanduser(name)) for folder in folders]
    for exists in (os.path.isfile, os.path.exists):  # read_map says better what is not a file
        for candidate in candidates:
            if name and "\0" not in name and exists(candidate):
                return candidate
    try:
        known = sorted(entry[:-5] for entry in os.listdir(maps) if entry.endswith(".yaml"))
    except OSError:
        known = []
    text = (
        "no such map; expected the path of a yaml file, or the name of one in "
        f"{maps}: {', '.join(known) or '(there are none)'}"
    )
    raise MapError([MapFault(name or "''", "", text)])


def read_map(path: str) -> Grid:
    """Read the map whose yaml file is at `path`.

    Its keys are map_server's: image, resolution, origin, occupied_thresh, free_thresh, negate and,
    if one likes, mode. Keys that map_server does not know are passed over, as it does.

    Raises:
        MapError: a file cannot be read, or is no map; it names every fault of the yaml.
    """
    faults: List[MapFault] = []

    def fault(key: str, text: str) -> None:
        faults.append(MapFault(path, key, text))

    raw = _read_yaml(path)
    resolution = _number(raw, "resolution", "m", LEAST_RESOLUTION, MOST_RESOLUTION, fault)
    occupied = _number(raw, "occupied_thresh", "", 0.0, 1.0, fault)
    free = _number(raw, "free_thresh", "", 0.0, 1.0, fault)
    if free > occupied:
        fault("free_thresh", f"{free:g}; expected not more than occupied_thresh, {occupied:g}")
    origin = _origin(raw, fault)
    negate = raw.get("negate")
    if negate is None or negate not in ("0", "1"):
        fault("negate", f"{_shown(negate)}; expected 0, or 1 where white is a wall")
    mode = raw.get("mode", "trinary")
    if mode not in MODES:
        fault("mode", f"{_shown(mode)}; expected {', '.join(MODES)}, or no such key for trinary")
    image = raw.get("image")
    pixels = None
    if not isinstance(image, str) or not image:
        fault("image", f"{_shown(image)}; expected the path of a PNG or PGM picture")
    else:
        image = os.path.join(os.path.dirname(path), image)
        try:
            # A yaml that is wrong anyhow does not get its picture decoded.
            pixels = _read_image(image, header_only=bool(faults))
        except _ImageError as error:
            fault("image", f"'{image}': {error}")
    if faults:
        raise MapError(faults)
    assert pixels is not None
    cells = _cells(pixels, negate == "1", occupied, free, mode)
    cells.flags.writeable = False
    return Grid(cells, as_travelled(resolution), origin)


# The yaml ---------------------------------------------------------------------------------------


class _Loader(yaml.BaseLoader):
    """Reads every scalar as text, as map_server's reader does, and knows no aliases.

    Nothing in a map needs them, and a few lines of them can stand for more than fits in memory.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            raise yaml.MarkedYAMLError(None, None, "found an alias", event.start_mark)
        return super().compose_node(parent, index)


def _read_yaml(path: str) -> Dict[str, Any]:
    """Read the mapping in a yaml file, its scalars as text.

    Raises:
        MapError: it cannot be read, or is not a mapping.
    """

    def refuse(text: str) -> MapError:
        return MapError([MapFault(path, "", text)])

    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            kind = "a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise refuse(f"this is {kind}; expected a map's yaml file")
        with open(path, "rb") as file:
            data = file.read(MAX_YAML_SIZE + 1)
    except (OSError, ValueError) as error:
        if isinstance(error, MapError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(f"the file cannot be read ({reason}); expected a map's yaml file") from None
    if len(data) > MAX_YAML_SIZE:
        raise refuse(f"the file has more than {MAX_YAML_SIZE} bytes; expected a map's yaml file")
    try:
        raw = yaml.load(data, _Loader)  # noqa: S506, it makes nothing but text, lists and dicts
    except RecursionError:
        raise refuse("this is nested too deeply; expected seven keys and their values") from None
    except (yaml.YAMLError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise refuse(f"{where}{problem}; expected yaml") from None
    if not isinstance(raw, dict):
        raise refuse("the file has no keys; expected such as 'image: map.png'")
    return raw


def _shown(value: Any) -> str:
    """Return what was found, as text of a bounded length."""
    if value is None:
        return "is missing"
    text = repr(value)
    return f"is {text if len(text) <= 60 else text[:57] + '...'}"


_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)


def _as_number(value: Any, least: float, most: float) -> Optional[float]:
    """Return the number that a scalar's text stands for, if it does and is in range."""
    if not isinstance(value, str) or len(value) > 1000 or not _DECIMAL.fullmatch(value):
        return None
    number = float(value)
    return number if least <= number <= most else None


def _number(
    raw: Dict[str, Any], key: str, unit: str, least: float, most: float, fault: Any
) -> float:
    """Return the number at `key`; where there is none, report it and return NaN."""
    number = _as_number(raw.get(key), least, most)
    if number is None:
        text = f"{_shown(raw.get(key))}; expected a number from {least:g} to {most:g} {unit}"
        fault(key, text.rstrip())
        return math.nan
    return number


def _origin(raw: Dict[str, Any], fault: Any) -> Pose:
    """Return the pose at 'origin'; where there is none, report it."""
    value = raw.get("origin")
    if isinstance(value, list) and len(value) == 3:
        x, y, yaw = (_as_number(each, -MAX_COORDINATE, MAX_COORDINATE) for each in value)
        if x is not None and y is not None and yaw is not None:
            return Pose(x, y, yaw)
    text = f"expected [x, y, yaw] in m, m, rad, each at most {MAX_COORDINATE:g}"
    fault("origin", f"{_shown(value)}; {text}")
    return ORIGIN


# The picture ------------------------------------------------------------------------------------


class _ImageError(ValueError):
    """A picture that cannot be used."""


class _Pixels(NamedTuple):
    """A picture as map_server's reader hands it over."""

    channels: np.ndarray
    """uint8, (height, width, channels); row 0 is at the top."""
    has_alpha: bool
    """Whether the last channel is the opacity."""


def _read_image(path: str, header_only: bool) -> Optional[_Pixels]:
    """Read a PNG or PGM picture, or only see whether it could be read.

    Raises:
        _ImageError: it could not.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise _ImageError("this is not a regular file; expected a PNG or PGM picture")
        with open(path, "rb") as file:
            head = file.read(24)
            file.seek(0)
            if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) == 24:
                width = int.from_bytes(head[16:20], "big")
                _check_size(width, int.from_bytes(head[20:24], "big"))
                return None if header_only else _read_png(file)
            if head[:2] in (b"P2", b"P5"):
                return _read_pgm(file, header_only)
    except (OSError, ValueError) as error:
        if isinstance(error, _ImageError):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise _ImageError(f"it cannot be read ({reason}); expected a picture") from None
    raise _ImageError("this is neither PNG nor PGM (P2 or P5); expected one of the two")


def _check_size(width: int, height: int) -> None:
    """Refuse a picture that is empty or too large."""
    if not 0 < width * height <= MAX_CELLS:
        raise _ImageError(
            f"it has {width} x {height} pixels; expected at least 1 and at most {MAX_CELLS:g}"
        )


def _read_png(file: Any) -> _Pixels:
    """Decode a PNG picture into the channels that map_server would see.

    These are its channels as they are, with two exceptions: grey with opacity becomes RGBA, and an
    indexed picture is its indices, not its colours, unless it has shades of opacity.
    """
    from PIL.PngImagePlugin import PngImageFile  # only who reads a picture pays for this

    try:
        image = PngImageFile(file)
        image.load()
        transparency = image.info.get("transparency")
        if image.mode == "P":
            if isinstance(transparency, bytes) and transparency.strip(b"\xff"):
                image = image.convert("RGBA")
        elif image.mode == "LA":
            image = image.convert("RGBA")
        elif image.mode not in ("RGB", "RGBA") and transparency is not None:
            raise _ImageError("it is grey with a transparent shade; expected one without")
        elif image.mode == "1":
            image = image.convert("L")
        channels = np.asarray(image)
    except _ImageError:
        raise
    except Exception as error:  # whatever a decoder makes of a broken file
        text = f"it cannot be decoded ({type(error).__name__}: {error}); expected a PNG picture"
        raise _ImageError(text) from None
    if channels.dtype != np.uint8:
        channels = (channels.astype(np.uint16) >> 8).astype(np.uint8)
    return _Pixels(np.atleast_3d(channels), image.mode == "RGBA")


def _read_pgm(file: Any, header_only: bool) -> Optional[_Pixels]:
    """Decode a PGM picture, plain (P2) or raw (P5), with shades up to 255.

    Fewer shades are stretched to 255 with integer division, as map_server's reader does.
    """
    gap = rb"(?:[ \t\r\n\v\f]|#[^\r\n]*[\r\n])*"
    data = file.read(10_000)
    header = re.match(rb"P[25]" + (gap + rb"([0-9]{1,9})") * 3 + rb"[ \t\r\n\v\f]", data)
    if header is None:
        raise _ImageError("its header is broken; expected width, height and the whitest shade")
    width, height, whitest = map(int, header.groups())
    _check_size(width, height)
    if not 0 < whitest <= 255:
        raise _ImageError(f"its whitest shade is {whitest}; expected 1 to 255")
    if header_only:
        return None
    count = width * height
    file.seek(header.end())
    if data.startswith(b"P5"):
        shades = np.frombuffer(file.read(count), np.uint8)
    else:
        text = re.sub(rb"#[^\r\n]*", b"", file.read(20 * count + 10_000))
        words = text.split(None, count)[:count]
        if not all(word.isdigit() and len(word) <= 9 for word in words):
            raise _ImageError("a shade in it is not a number; expected digits")
        shades = np.array(words, np.int64).astype(np.uint8)
    if len(shades) < count:
        raise _ImageError(f"it ends after {len(shades)} of {count} pixels; expected all of them")
    stretched = (np.arange(256) * 255 // whitest).astype(np.uint8)
    return _Pixels(stretched[shades].reshape(height, width, 1), False)


def _cells(pixels: _Pixels, negate: bool, occupied: float, free: float, mode: str) -> np.ndarray:
    """Turn a picture into the values of cells, (height, width), row 0 at the bottom.

    The shade is the mean of the channels; in trinary mode opacity counts as one of them, because
    map_server has it so. In scale mode a last channel of 0 makes a cell unknown, and what lies
    between the thresholds is cut down, not rounded, to a whole number.
    """
    height, width, channels = pixels.channels.shape
    counted = channels - 1 if pixels.has_alpha and mode != "trinary" else channels

    # What a cell becomes depends on the sum of its channels alone, and that is a small number.
    shade = np.arange(255 * counted + 1) / counted
    if negate:
        shade = 255.0 - shade
    darkness = (255.0 - shade) / 255.0
    if mode == "raw":
        between = shade.astype(np.uint8).astype(np.int8)
        values = between
    else:
        between = np.full(shade.shape, UNKNOWN, np.int8)
        if mode == "scale" and occupied > free:
            inside = (darkness >= free) & (darkness <= occupied)
            ratio = (darkness[inside] - free) / (occupied - free)
            between[inside] = (1 + 98 * ratio).astype(np.int8)
        values = np.where(darkness < free, 0, between)
        values = np.where(darkness > occupied, 100, values).astype(np.int8)

    cells = np.empty((height, width), np.int8)
    rows = max(1, _BLOCK // width)
    for top in range(0, height, rows):
        block = pixels.channels[top : top + rows]
        sums = block[..., 0]
        if counted > 1:
            sums = block[..., :counted].sum(axis=2, dtype=np.uint16)
        block_cells = values[sums]
        if mode == "scale" and channels > 1:
            unclear = (darkness >= free) & (darkness <= occupied)
            block_cells[unclear[sums] & (block[..., -1] == 0)] = UNKNOWN
        cells[height - top - len(block) : height - top] = block_cells[::-1]
    return cells
