#!/usr/bin/python3
"""Serve a map from a yaml file and a picture, as the node of the same name in ROS does.

Where ROS's own is installed (the package map_server), this becomes that one.
"""

import os
import sys
from typing import Optional

import roslib.packages
import rospkg
import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse

from mushr_ros_intro.parameters import ParameterError, text
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.world.map_file import MapError, find_map, read_map


class MapServer:
    """The map server as a node.

    Publishes ``map`` and ``map_metadata``, both latched, and offers the service ``static_map``.
    """

    def __init__(self, path: str) -> None:
        """Serve the map whose yaml file is at `path`."""
        frame = text("~frame_id", rospy.get_param("~frame_id", conversions.MAP_FRAME))
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
        """Answer with the map."""
        return conversions.map_response(self._msg)


def _find_map() -> str:
    """Return the path of the yaml file that ``~map_file`` names."""
    map_file = rospy.get_param("~map_file", None)
    if map_file is None:
        raise ParameterError(
            "parameter ~map_file is not set; expected the name or the path of a map, "
            "such as _map_file:=sandbox"
        )
    maps = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "maps")
    # roslaunch starts its nodes in ROS_HOME but leaves PWD as its own shell had it.
    folders = [os.environ.get("PWD", "."), "."]
    return find_map(text("~map_file", map_file), maps, folders)


def _find_real_map_server() -> Optional[str]:
    """Return the path of ROS's own map_server, or None where it is not installed."""
    try:
        found = roslib.packages.find_node("map_server", "map_server")
    except rospkg.ResourceNotFound:
        return None
    return found[0] if found else None


def main() -> int:
    """Run the node; return its exit status."""
    init_node("map_server")
    try:
        path = _find_map()
        real = _find_real_map_server()
        if real:
            rospy.loginfo("map %s: served by %s", path, real)
            os.execv(real, [real, path, f"__name:={rospy.get_name().rsplit('/', 1)[-1]}"])
        node = MapServer(path)  # noqa: F841, it lives as long as its topics and its service should
    except (MapError, ParameterError) as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    rospy.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
