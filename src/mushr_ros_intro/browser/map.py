"""The map for the page of the browser view."""

import asyncio
import io
from typing import Any, Callable, Dict, Optional

import numpy as np
import rospy
from nav_msgs.msg import OccupancyGrid
from PIL import Image

from mushr_ros_intro.browser.bridge import Bridge
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.grid import OCCUPIED_ABOVE, UNKNOWN, Grid

_OCCUPIED, _UNKNOWN, _FREE = 0, 205, 254
"""The grey values, as in the images of ROS's map_saver."""


class WebMap:
    """The newest map on /map, as numbers and as an image."""

    def __init__(self, bridge: Bridge, on_change: Callable[[], None]) -> None:
        """Follow /map; `on_change` is called in the event loop when there is a new map."""
        self._bridge = bridge
        self._on_change = on_change
        self._png = 0, b""
        self.grid: Optional[Grid] = None
        """The map, or None if there is none."""
        self.number = 0
        """Of the map; another map has another number; 0 if there is no map."""
        bridge.listen("/map", self._on_map)

    def _on_map(self, raw: bytes) -> None:
        asyncio.ensure_future(self._use(raw))

    async def _use(self, raw: bytes) -> None:
        def read() -> Grid:
            return conversions.grid_from_msg(OccupancyGrid().deserialize_numpy(raw, np))

        try:
            self.grid = await self._bridge.in_thread(read)
        except conversions.MessageError as error:
            rospy.logwarn("ignored a message on /map: %s", error)
            return
        self.number += 1
        self._on_change()

    async def get_numbers(self) -> Dict[str, Any]:
        """Return the number, the size and the place of the map; raise LookupError without one."""
        grid = self._found()
        return {
            "number": self.number,
            "resolution": grid.resolution,
            "width": grid.width,
            "height": grid.height,
            "origin": grid.origin,
        }

    async def get_png(self) -> bytes:
        """Return the image; raise LookupError without a map."""
        grid, number = self._found(), self.number
        if self._png[0] != number:
            self._png = number, await self._bridge.in_thread(png, grid)
        return self._png[1]

    def _found(self) -> Grid:
        if self.grid is None:
            raise LookupError("there is no map")
        return self.grid


def png(grid: Grid) -> bytes:
    """Return a map as a PNG image, one pixel per cell; the first row is at the top."""
    pixels = np.full(grid.cells.shape, _FREE, np.uint8)
    pixels[grid.cells == UNKNOWN] = _UNKNOWN
    pixels[grid.cells > OCCUPIED_ABOVE] = _OCCUPIED
    file = io.BytesIO()
    Image.fromarray(pixels[::-1]).save(file, "PNG", compress_level=1)
    return file.getvalue()
