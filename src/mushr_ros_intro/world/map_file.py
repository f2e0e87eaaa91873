"""Read maps in map_server's format: a YAML file and a PNG or PGM image.

The values of the cells are exactly those of map_server (see "Value Interpretation" on its page in
the ROS wiki, and the source code of its Noetic release for what the page leaves open).
"""

import math
import os
import re
import stat
from typing import Any, BinaryIO, Dict, List, NamedTuple, Optional, Sequence

import numpy as np

from mushr_ros_intro.car.bicycle import ORIGIN, Pose
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import user_path
from mushr_ros_intro.world.grid import (
    MAX_RESOLUTION,
    MIN_RESOLUTION,
    UNKNOWN,
    Grid,
    as_travelled,
)
from mushr_ros_intro.yaml_file import read_mapping

MAX_CELLS = 400_000_000
"""Larger images are refused before they are decoded."""

MAX_COORDINATE = 1e6
"""The largest coordinate of an origin [m]; a larger one would cost digits."""

MODES = ("trinary", "scale", "raw")


class MapError(UserError):
    """A map that cannot be used. The message has one line per fault."""


def find_map(name: str, maps: str) -> str:
    """Return the path of the YAML file of a map.

    Args:
        name: the name of a map in `maps`, with or without ``.yaml``, or a path; see `user_path`.
        maps: the folder of the package's maps.

    Raises:
        MapError: there is no such map; the message lists those in `maps`.
    """
    candidates = [user_path(name)]
    if os.sep not in name:
        candidates = [os.path.join(maps, name + ".yaml"), os.path.join(maps, name), *candidates]
    for candidate in candidates:
        if name and os.path.exists(candidate):
            return candidate
    known = sorted(entry[:-5] for entry in os.listdir(maps) if entry.endswith(".yaml"))
    raise MapError(
        f"{name or repr(name)}: no such map; expected the path of a yaml file, or the name of one "
        f"in {maps}: {', '.join(known)}"
    )


def read_map(path: str) -> Grid:
    """Read the map with the YAML file `path`.

    The keys are map_server's: image, resolution, origin, occupied_thresh, free_thresh, negate and
    optionally mode. Other keys are ignored.

    Raises:
        MapError: a file cannot be read, or keys are wrong; the message lists all faults.
    """
    expected = "a map's yaml file, with keys such as 'image: map.png'"
    keys = _Keys(path, read_mapping(path, expected, MapError, as_text=True))
    resolution = keys.number("resolution", "m", MIN_RESOLUTION, MAX_RESOLUTION)
    occupied = keys.number("occupied_thresh", "", 0.0, 1.0)
    free = keys.number("free_thresh", "", 0.0, 1.0)
    if free > occupied:
        keys.fault("free_thresh", f"{free:g}; expected at most occupied_thresh, {occupied:g}")
    origin = keys.origin()
    negate = keys.choice("negate", ("0", "1"), None, "0, or 1 if white is a wall")
    mode = keys.choice("mode", MODES, "trinary", f"one of {', '.join(MODES)}")
    image = keys.image()
    if keys.faults or image is None:
        raise MapError("\n".join(keys.faults))
    cells = _cells(image, negate == "1", occupied, free, mode)
    return Grid(cells, as_travelled(resolution), origin)


# The YAML file ----------------------------------------------------------------------------------

_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)


def _as_number(value: Any, low: float, high: float) -> Optional[float]:
    """Return the number that a text stands for, or None if it is no number from low to high."""
    if not isinstance(value, str) or len(value) > 1000 or not _DECIMAL.fullmatch(value):
        return None
    number = float(value)
    return number if low <= number <= high else None


class _Keys:
    """Check the keys of a map and collect all faults. After a fault the value is arbitrary."""

    def __init__(self, path: str, values: Dict[str, Any]) -> None:
        self._path = path
        self._values = values
        self.faults: List[str] = []

    def fault(self, key: str, text: str) -> None:
        """Add a fault."""
        self.faults.append(f"{self._path}: {key}: {text}")

    def number(self, key: str, unit: str, low: float, high: float) -> float:
        """Return a number from `low` to `high`."""
        number = _as_number(self._values.get(key), low, high)
        if number is None:
            self._unexpected(key, f"a number from {low:g} to {high:g} {unit}".rstrip())
            return math.nan
        return number

    def origin(self) -> Pose:
        """Return the pose of the lower left corner of the map, in the map frame."""
        value = self._values.get("origin")
        if isinstance(value, list) and len(value) == 3:
            x, y, yaw = (_as_number(each, -MAX_COORDINATE, MAX_COORDINATE) for each in value)
            if x is not None and y is not None and yaw is not None:
                return Pose(x, y, yaw)
        self._unexpected("origin", f"[x, y, yaw] in m, m, rad, each at most {MAX_COORDINATE:g}")
        return ORIGIN

    def choice(
        self, key: str, options: Sequence[str], default: Optional[str], expected: str
    ) -> str:
        """Return one of `options`."""
        value = self._values.get(key, default)
        if value not in options:
            self._unexpected(key, expected)
        return str(value)

    def image(self) -> "Optional[_Image]":
        """Return the image, whose path is relative to the YAML file."""
        name = self._values.get("image")
        if not isinstance(name, str) or not name:
            self._unexpected("image", "the path of a PNG or PGM image")
            return None
        path = os.path.join(os.path.dirname(self._path), name)
        try:
            return _read_image(path)
        except _ImageError as error:
            self.fault("image", f"'{path}': {error}")
            return None

    def _unexpected(self, key: str, expected: str) -> None:
        """Add the fault that a key is missing or has an unexpected value."""
        shown = repr(self._values.get(key))
        shown = f"is {shown if len(shown) <= 60 else shown[:57] + '...'}"
        self.fault(key, f"{shown if key in self._values else 'is missing'}; expected {expected}")


# The image --------------------------------------------------------------------------------------


class _ImageError(ValueError):
    """An image that cannot be used."""


class _Image(NamedTuple):
    """An image as map_server's reader decodes it."""

    channels: np.ndarray
    """uint8, (height, width, channels); row 0 is at the top."""
    has_alpha: bool
    """Whether the last channel is the opacity."""


def _read_image(path: str) -> _Image:
    """Read a PNG or PGM image.

    Raises:
        _ImageError: the image cannot be read.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise _ImageError("this is not a regular file; expected a PNG or PGM image")
        with open(path, "rb") as file:
            magic = file.read(8)
            file.seek(0)
            if magic == b"\x89PNG\r\n\x1a\n":
                return _read_png(file)
            if magic[:2] in (b"P2", b"P5"):
                return _read_pgm(file.read())
    except _ImageError:
        raise
    except Exception as error:  # Pillow's decoder raises errors of many classes
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise _ImageError(f"it cannot be read ({reason}); expected a PNG or PGM image") from None
    raise _ImageError("this is neither PNG nor PGM (P2 or P5); expected one of the two")


def _check_size(width: int, height: int) -> None:
    """Raise an error if an image is empty or too large."""
    if not 0 < width * height <= MAX_CELLS:
        raise _ImageError(
            f"it has {width} x {height} pixels; expected at least 1 and at most {MAX_CELLS:g}"
        )


def _read_png(file: BinaryIO) -> _Image:
    """Decode a PNG image into the channels that map_server uses.

    These are the channels of the file with two exceptions: grey with opacity becomes RGBA, and
    indexed colours stay indices unless the palette has degrees of opacity.
    """
    from PIL.PngImagePlugin import PngImageFile  # slow to import, and few programs read maps

    image = PngImageFile(file)
    _check_size(*image.size)
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
    if channels.dtype != np.uint8:
        channels = (channels.astype(np.uint16) >> 8).astype(np.uint8)
    return _Image(np.atleast_3d(channels), image.mode == "RGBA")


def _read_pgm(data: bytes) -> _Image:
    """Decode a PGM image, plain (P2) or raw (P5), with a maximum shade of at most 255.

    Smaller maxima are scaled to 255 with integer division, as map_server's reader does.
    """
    gap = rb"(?:[ \t\r\n\v\f]|#[^\r\n]*[\r\n])*"
    header = re.match(rb"P[25]" + (gap + rb"([0-9]{1,9})") * 3 + rb"[ \t\r\n\v\f]", data)
    if header is None:
        raise _ImageError("its header is broken; expected width, height and maximum shade")
    width, height, maximum = map(int, header.groups())
    _check_size(width, height)
    if not 0 < maximum <= 255:
        raise _ImageError(f"its maximum shade is {maximum}; expected 1 to 255")
    count = width * height
    if data.startswith(b"P5"):
        shades = np.frombuffer(data[header.end() : header.end() + count], np.uint8)
    else:
        words = re.sub(rb"#[^\r\n]*", b"", data[header.end() :]).split()[:count]
        if not all(word.isdigit() and len(word) <= 9 for word in words):
            raise _ImageError("a shade in it is not a number; expected digits")
        shades = np.array(words, np.int64).astype(np.uint8)
    if len(shades) < count:
        raise _ImageError(f"it ends after {len(shades)} of {count} pixels; expected all of them")
    scaled = (np.arange(256) * 255 // maximum).astype(np.uint8)
    return _Image(scaled[shades].reshape(height, width, 1), False)


def _cells(image: _Image, negate: bool, occupied: float, free: float, mode: str) -> np.ndarray:
    """Return the values of the cells of an image, (height, width), row 0 at the bottom.

    The shade of a pixel is the mean of its channels; in trinary mode map_server counts opacity as
    one of them. In scale mode, cells between the thresholds are scaled and rounded down, and
    unknown if the last channel is 0.
    """
    channels = image.channels.shape[2]
    counted = channels - 1 if image.has_alpha and mode != "trinary" else channels
    sums = image.channels[..., :counted].sum(axis=2, dtype=np.uint16)[::-1]

    # The value of each possible sum, which is faster than the value of each pixel.
    shade = np.arange(255 * counted + 1) / counted
    if negate:
        shade = 255.0 - shade
    if mode == "raw":
        return shade.astype(np.uint8).astype(np.int8)[sums]
    darkness = (255.0 - shade) / 255.0
    values = np.full(shade.shape, UNKNOWN, np.int8)
    is_between = (darkness >= free) & (darkness <= occupied)
    if mode == "scale" and occupied > free:
        ratio = (darkness[is_between] - free) / (occupied - free)
        values[is_between] = (1 + 98 * ratio).astype(np.int8)
    values[darkness < free] = 0
    values[darkness > occupied] = 100
    cells = values[sums]
    if mode == "scale" and channels > 1:
        cells[is_between[sums] & (image.channels[::-1, :, -1] == 0)] = UNKNOWN
    return cells
