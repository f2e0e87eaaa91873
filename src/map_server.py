#!/usr/bin/python3
"""Serve a map from a YAML file and an image, like ROS's own map_server."""

import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse

from mushr_ros_intro.parameters import find_file, package_folder
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.world.map_file import read_map


class MapServer:
    """The map server as a node.

    Publishes ``map`` and ``map_metadata``, both latched, and offers the service ``static_map``.
    """

    def __init__(self) -> None:
        parameters = node.parameters()
        expected = "the name or the path of a map, such as _map_file:=sandbox"
        maps = package_folder("maps")
        path = find_file(parameters.text("map_file", expected=expected), maps, ".yaml")
        frame = parameters.text("frame_id", conversions.MAP_FRAME)
        grid = read_map(path)
        self._msg = conversions.grid_to_msg(grid, ros_time.now(), frame)

        self._metadata_pub = rospy.Publisher("map_metadata", MapMetaData, queue_size=1, latch=True)
        self._map_pub = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        self._metadata_pub.publish(self._msg.info)
        self._map_pub.publish(self._msg)
        self._service = rospy.Service("static_map", GetMap, self._on_request)
        cells = f"{grid.width} x {grid.height} cells of {grid.resolution:g} m"
        rospy.loginfo(f"map {path}: {cells}, in the frame {frame}")

    def run(self) -> None:
        """Serve the map until the node is shut down."""
        rospy.spin()

    def _on_request(self, _: GetMapRequest) -> GetMapResponse:
        """Return the map."""
        return GetMapResponse(map=self._msg)


if __name__ == "__main__":
    node.main("map_server", MapServer)
