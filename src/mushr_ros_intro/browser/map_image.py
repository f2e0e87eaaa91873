"""The map as an image for the page."""

import io

import numpy as np
from PIL import Image

from mushr_ros_intro.world.grid import OCCUPIED_ABOVE, UNKNOWN, Grid

_OCCUPIED, _UNKNOWN, _FREE = 0, 205, 254
"""The grey values, as in the images of ROS's map_saver."""


def png(grid: Grid) -> bytes:
    """Return a map as a PNG image, one pixel per cell; the first row is at the top."""
    pixels = np.full(grid.cells.shape, _FREE, np.uint8)
    pixels[grid.cells == UNKNOWN] = _UNKNOWN
    pixels[grid.cells > OCCUPIED_ABOVE] = _OCCUPIED
    file = io.BytesIO()
    Image.fromarray(pixels[::-1]).save(file, "PNG", compress_level=1)
    return file.getvalue()
