"""Read maps in map_server's format: a YAML file and a PNG or PGM image.

The values of the cells are exactly those of map_server in its default mode, trinary (see "Value
Interpretation" on its page in the ROS wiki, and the source code of its Noetic release for what the
page leaves open).
"""

import os
import warnings
from typing import Any, List

import numpy as np
from PIL import Image

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import MAX_COORDINATE, Pose
from mushr_ros_intro.parameters import (
    REQUIRED,
    Parameter,
    Parameters,
    RefusedError,
    choice,
    integer,
    number,
    text,
)
from mushr_ros_intro.world.grid import (
    MAX_RESOLUTION,
    MIN_RESOLUTION,
    UNKNOWN,
    Grid,
    as_travelled,
)
from mushr_ros_intro.yaml_file import read_mapping

_FORMATS = ("PNG", "PPM")  # Pillow's name for PGM is PPM

_CHANNELS = {"1": "L", "L": "L", "LA": "RGBA", "RGB": "RGB", "RGBA": "RGBA"}
"""The channels that map_server's reader decodes from Pillow's image modes."""


def _origin(value: Any) -> List[Any]:
    if not isinstance(value, list) or len(value) != 3:
        raise RefusedError
    return value


_KEYS = (
    number("resolution", REQUIRED, "m", MIN_RESOLUTION, MAX_RESOLUTION),
    number("occupied_thresh", REQUIRED, "", 0.0, 1.0),
    number("free_thresh", REQUIRED, "", 0.0, 1.0),
    integer("negate", REQUIRED, 0, 1),
    choice("mode", ["trinary"], "trinary"),
    Parameter("origin", REQUIRED, "[x, y, yaw] in m, m, rad", _origin),
    text("image", REQUIRED, expected="the path of a PNG or PGM image"),
)

_ORIGIN = (
    number("x", REQUIRED, "m", -MAX_COORDINATE, MAX_COORDINATE),
    number("y", REQUIRED, "m", -MAX_COORDINATE, MAX_COORDINATE),
    number("yaw", REQUIRED, "rad", -MAX_COORDINATE, MAX_COORDINATE),
)


def read_map(path: str) -> Grid:
    """Read the map with the YAML file `path`.

    The keys are map_server's: image, resolution, origin, occupied_thresh, free_thresh, negate and
    optionally mode. Other keys are ignored.

    Raises:
        UserError: a file cannot be read, or a key is wrong.
    """
    values = read_mapping(
        path, "a map's yaml file, with keys such as 'image: map.png'", is_map=True
    )
    keys = Parameters(values, f"{path}: ")
    read = keys.read(_KEYS)
    occupied, free = read["occupied_thresh"], read["free_thresh"]
    if free > occupied:
        raise keys.error("free_thresh", f"a number from 0 to {occupied:g}")
    origin = dict(zip(("x", "y", "yaw"), read["origin"]))
    corner = Pose(*Parameters(origin, f"{path}: origin: ").read(_ORIGIN).values())
    image = os.path.join(os.path.dirname(path), read["image"])
    try:
        channels = _read_channels(image)
    except Exception as error:  # Pillow raises errors of many classes
        reason = getattr(error, "strerror", None) or error
        raise UserError(
            f"{path}: image: '{image}': {reason}; expected a PNG or PGM image, grey or RGB with 8 "
            "bits per channel, without a colour table or a transparent colour"
        ) from None
    cells = _cells(channels, bool(read["negate"]), occupied, free)
    return Grid(cells, as_travelled(read["resolution"]), corner)


def _read_channels(path: str) -> np.ndarray:
    """Return the channels of an image, uint8, (height, width, channels); row 0 is at the top."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # a large map is no attack
        image = Image.open(path)
    with image:
        is_known = image.format in _FORMATS and image.mode in _CHANNELS
        is_known = is_known and (image.format, image.mode) != ("PPM", "1")  # PBM: read inverted
        if not is_known or "transparency" in image.info:
            raise ValueError(f"this is a {image.format} image of Pillow's mode {image.mode}")
        return np.atleast_3d(np.asarray(image.convert(_CHANNELS[image.mode])))


def _cells(channels: np.ndarray, negate: bool, occupied: float, free: float) -> np.ndarray:
    """Return the values of the cells of an image, (height, width), row 0 at the bottom.

    The shade of a pixel is the mean of its channels; map_server counts opacity as one of them.
    """
    number = channels.shape[2]
    # The value of each possible sum, which is faster than the value of each pixel.
    shade = np.arange(255 * number + 1) / number
    if negate:
        shade = 255.0 - shade
    darkness = (255.0 - shade) / 255.0
    values = np.select([darkness > occupied, darkness < free], [100, 0], UNKNOWN).astype(np.int8)
    return values[channels.sum(axis=2, dtype=np.uint16)[::-1]]
