#!/usr/bin/python3
"""Check the topics, the service and the errors of map_server."""

import os
import shutil
import tempfile
import unittest

import rospkg
import rospy
import rostest
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap

from support.helpers import PATIENCE, Process, Recording, node, wait_for, yaw_of

PACKAGE = rospkg.RosPack().get_path("mushr_ros_intro")

CELLS = (100, 100, 0, -1, 0, 100, 0, 0, 0, 0, 0, 0, 100, 0, -1)
"""The cells of test/fixtures/maps/asymmetric.png, row by row from the bottom."""

ROUNDING = 1e-12
"""[m, rad] Of a pose that goes through a quaternion."""


class TestMapServer(unittest.TestCase):
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

    def test_names_and_relative_paths(self):
        """A map's name, and a path relative to the user's directory."""
        with node("map_server.py", "__name:=by_name", "_map_file:=sandbox", "__ns:=other") as other:
            sandbox = Recording("/other/map", OccupancyGrid)
            msg = wait_for(lambda: sandbox.last, "the sandbox")
            self.assertEqual((msg.info.width, msg.info.height), (1000, 1000))
            self.assertEqual(msg.header.frame_id, "map")
            self.assertTrue(other.running)
        folder = os.path.join(PACKAGE, "test", "fixtures")
        command = "rosrun mushr_ros_intro map_server.py __name:=by_path __ns:=third"
        with Process("bash", "-c", f"cd '{folder}' && {command} _map_file:=maps/asymmetric.yaml"):
            third = Recording("/third/map", OccupancyGrid)
            self.assertEqual(tuple(wait_for(lambda: third.last, "the map").data), CELLS)

    def refusal(self, *arguments):
        """Check that the server ends with one fatal message; return its output."""
        self.refusals += 1  # for a new name, because the master keeps parameters
        name = f"bad_{self.refusals}"
        with node("map_server.py", f"__name:={name}", *arguments) as server:
            self.assertEqual(server.wait(), 1, server.output)
            fatal = [line for line in server.output.splitlines() if "[FATAL]" in line]
            self.assertEqual(len(fatal), 1, server.output)
            self.assertNotIn("Traceback", server.output)
            self.assertIn(f"/{name}: ", fatal[0])
            return server.output

    def test_bad_maps_and_parameters(self):
        self.refusals = 0
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        path = os.path.join(folder, "broken.yaml")
        with open(path, "w") as file:
            file.write("image: none.png\nresolution: .nan\n")
        output = self.refusal(f"_map_file:={path}")
        self.assertIn(f"{path}: resolution is nan; expected a number", output)
        self.assertIn("(Is a directory)", self.refusal(f"_map_file:={folder}"))
        output = self.refusal("_map_file:=no_such_map")
        self.assertIn("no such file; expected the path of a file, or the name of one in", output)
        self.assertIn("race_loop, rooms, sandbox", output)
        self.assertIn("parameter ~map_file is not set", self.refusal())
        self.assertIn(
            "parameter ~map_file is 7; expected the name or", self.refusal("_map_file:=7")
        )
        output = self.refusal("_map_file:=sandbox", "_frame_id:=''")
        self.assertIn("parameter ~frame_id is ''; expected text", output)


if __name__ == "__main__":
    rospy.init_node("map_server_test")
    rostest.rosrun("mushr_ros_intro", "test_map_server", TestMapServer)
