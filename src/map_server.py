#!/usr/bin/python3
"""Serve a map from a YAML file and an image, like ROS's own map_server.

If the package map_server is installed, this program replaces itself by ROS's own.
"""

import os
import sys
from typing import Optional

import roslib.packages
import rospkg
import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.world.map_file import find_map, read_map


class MapServer:
    """The map server as a node.

    Publishes ``map`` and ``map_metadata``, both latched, and offers the service ``static_map``.
    """

    def __init__(self, path: str, parameters: Parameters) -> None:
        """Serve the map with the YAML file `path`."""
        frame = parameters.text("frame_id", conversions.MAP_FRAME)
        grid = read_map(path)
        self._msg = conversions.grid_to_msg(grid, rospy.get_rostime().to_nsec(), frame)

        self._metadata_pub = rospy.Publisher("map_metadata", MapMetaData, queue_size=1, latch=True)
        self._map_pub = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        self._metadata_pub.publish(self._msg.info)
        self._map_pub.publish(self._msg)
        self._service = rospy.Service("static_map", GetMap, self._on_request)
        rospy.loginfo(
            "map %s: %d x %d cells of %g m, in the frame %s",
            path,
            grid.width,
            grid.height,
            grid.resolution,
            frame,
        )

    def _on_request(self, _: GetMapRequest) -> GetMapResponse:
        """Return the map."""
        return conversions.map_response(self._msg)


def find_real_map_server() -> Optional[str]:
    """Return the path of ROS's own map_server, or None if it is not installed."""
    try:
        found = roslib.packages.find_node("map_server", "map_server")
    except rospkg.ResourceNotFound:
        return None
    return found[0] if found else None


def main() -> int:
    """Run the node; return its exit status."""
    init_node("map_server")
    try:
        parameters = Parameters(rospy.get_param("~", {}))
        expected = "the name or the path of a map, such as _map_file:=sandbox"
        maps = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "maps")
        path = find_map(parameters.text("map_file", expected=expected), maps)
        real = find_real_map_server()
        if real:
            rospy.loginfo("map %s: served by %s", path, real)
            os.execv(real, [real, path, f"__name:={rospy.get_name().rsplit('/', 1)[-1]}"])
        node = MapServer(path, parameters)  # noqa: F841, keeps its topics and its service alive
    except UserError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    rospy.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
