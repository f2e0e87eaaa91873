#!/usr/bin/python3
"""Serve a map from a YAML file and an image, like ROS's own map_server."""

import sys
from typing import Tuple

import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse

from mushr_ros_intro.parameters import Values, loaded, text
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.map_file import read_map

MAP = "the name or the path of a map, such as _map_file:=sandbox"


def read(name: str) -> Tuple[str, Grid]:
    """Return the path and the grid of a map, which is given by its name or path.

    Raises:
        UserError: there is no such map, or it is not valid.
    """
    path = find_file(name, package_folder("maps"), ".yaml")
    return path, read_map(path)


class MapServer:
    """The map server as a node.

    Publishes ``map`` and ``map_metadata``, both latched, and offers the service ``static_map``.
    Replaces the map server that is running.

    Example: ``rosrun mushr_ros_intro map_server.py _map_file:=rooms``
    """

    PARAMETERS = (
        loaded("map_file", read, expected=MAP),
        text("frame_id", conversions.MAP_FRAME, "frame of the map"),
    )

    def __init__(self, values: Values) -> None:
        (path, grid), frame = values["map_file"], values["frame_id"]
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


if __name__ == "__main__":
    sys.argv[1:] = [  # FILE, as with ROS's map_server, means _map_file:=FILE
        each if ":=" in each or each.startswith("-") else f"_map_file:={each}"
        for each in sys.argv[1:]
    ]
    node.main("map_server", MapServer)
