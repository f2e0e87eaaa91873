#!/usr/bin/python3
"""Serve a map from a YAML file and an image, like ROS's own map_server."""

import sys
from functools import lru_cache
from typing import Tuple

import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse

from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.map_file import read_map


class MapServer:
    """The map server as a node.

    Publishes ``map`` and ``map_metadata``, both latched, and offers the service ``static_map``.
    Replaces the map server that is running.

    Example: ``rosrun mushr_ros_intro map_server.py _map_file:=rooms``
    """

    def __init__(self) -> None:
        with node.parameters() as parameters:
            expected = "the name or the path of a map, such as _map_file:=sandbox"
            found = parameters.loaded("map_file", expected, read)
            frame = parameters.text("frame_id", conversions.MAP_FRAME, meaning="frame of the map")
        path, grid = found
        self._msg = conversions.grid_to_msg(grid, ros_time.now(), frame)
        # First, because nodes of courses call the service without waiting for it.
        self._service = rospy.Service("static_map", GetMap, self._on_request)

        self._metadata_pub = rospy.Publisher("map_metadata", MapMetaData, queue_size=1, latch=True)
        self._map_pub = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        self._metadata_pub.publish(self._msg.info)
        self._map_pub.publish(self._msg)
        cells = f"{grid.width} x {grid.height} cells of {grid.resolution:g} m"
        rospy.loginfo(f"map {path}: {cells}, in the frame {frame}")

    def run(self) -> None:
        """Serve the map until the node is shut down."""
        rospy.spin()

    def _on_request(self, _: GetMapRequest) -> GetMapResponse:
        return GetMapResponse(map=self._msg)


@lru_cache(maxsize=1)  # to check the map before the node registers, and to serve it
def read(name: str) -> Tuple[str, Grid]:
    """Return the path and the grid of a map, which is given by its name or path.

    Raises:
        UserError: there is no such map, or it is not valid.
    """
    path = find_file(name, package_folder("maps"), ".yaml")
    return path, read_map(path)


if __name__ == "__main__":
    sys.argv[1:] = [  # FILE, as with ROS's map_server, means _map_file:=FILE
        each if ":=" in each or each.startswith("-") else f"_map_file:={each}"
        for each in sys.argv[1:]
    ]
    node.main("map_server", MapServer)
