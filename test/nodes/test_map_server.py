"""Check the topics, the service and the errors of map_server."""

import os

import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap

from support.geometry import yaw_of
from support.helpers import PATIENCE, Recording, RosTestCase, node, wait_for
from support.paths import FIXTURES

CELLS = (100, 100, 0, -1, 0, 100, 0, 0, 0, 0, 0, 0, 100, 0, -1)
"""The cells of test/fixtures/maps/asymmetric.png, row by row from the bottom."""

ROUNDING = 1e-12
"""[m, rad] Of a pose that goes through a quaternion."""


def start_world():
    path = os.path.join(FIXTURES, "maps", "asymmetric.yaml")
    return [node("map_server.py", f"_map_file:={path}", "_frame_id:=hall")]


class TestMapServer(RosTestCase):
    def assert_is_the_map(self, msg):
        self.assertEqual(msg.header.frame_id, "hall")
        self.assertEqual(tuple(msg.data), CELLS)
        self.assert_is_the_metadata(msg.info)

    def assert_is_the_metadata(self, info):
        self.assertEqual((info.width, info.height, info.resolution), (5, 3, 0.5))
        self.assertEqual((info.origin.position.x, info.origin.position.y), (-1.0, 2.0))
        self.assertLess(abs(yaw_of(info.origin.orientation) - 0.3), ROUNDING)
        self.assertGreater(info.map_load_time.to_sec(), 0.0)

    def test_subscribers(self):
        """A late subscriber receives the map, too, and only once."""
        stamps = set()
        for _ in range(3):
            maps = Recording("/map", OccupancyGrid)
            metadata = Recording("/map_metadata", MapMetaData)
            self.assert_is_the_map(wait_for(lambda m=maps: m.last, "a map"))
            self.assert_is_the_metadata(wait_for(lambda m=metadata: m.last, "metadata"))
            self.assertEqual(len(maps.messages), 1)
            stamps.add(maps.last.header.stamp.to_nsec())
            maps.subscriber.unregister()  # the next one gets a new connection
            metadata.subscriber.unregister()
        self.assertEqual(len(stamps), 1)

    def test_clients(self):
        rospy.wait_for_service("/static_map", PATIENCE)
        ask = rospy.ServiceProxy("/static_map", GetMap)
        for _ in range(2):
            self.assert_is_the_map(ask().map)

    def test_relative_paths(self):
        """The argument of ROS's map_server, and a path relative to the user's directory."""
        with node("map_server.py", "__ns:=file", os.path.join(FIXTURES, "maps", "asymmetric.yaml")):
            by_file = Recording("/file/map", OccupancyGrid)
            self.assertEqual(tuple(wait_for(lambda: by_file.last, "the map").data), CELLS)
        by_path = ("__ns:=third", "_map_file:=maps/asymmetric.yaml")
        with node("map_server.py", *by_path, PWD=FIXTURES):
            third = Recording("/third/map", OccupancyGrid)
            self.assertEqual(tuple(wait_for(lambda: third.last, "the map").data), CELLS)

    def test_a_misspelt_name_does_not_end_the_map_server_that_runs(self):
        with node("map_server.py", "__ns:=fourth", "_map_file:=rooms", "_map_fil:=x") as running:
            wait_for(lambda: "rooms.yaml" in running.output, "the map")
            unknown = "~map_fil is not known, and has no effect; did you mean ~map_file?"
            wait_for(lambda: unknown in running.output, "a warning")
            with node("map_server.py", "__ns:=fourth", "_map_file:=roomz") as second:
                self.assertEqual(second.wait(), 1)
            self.assertIn("did you mean rooms?", second.output)
            self.assertTrue(running.running)
