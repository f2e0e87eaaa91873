#!/usr/bin/python3
"""Look at the package's view in rviz, on a display of its own, and click in it."""

import re
import tempfile
import unittest

import rospy
import rostest
from display import Display, require
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from PIL import ImageGrab

from helpers import Process, Recording, planar, wait_for

PLAN = b"44.0, 44.0, 0.0\n1.5, 0.2, 2.0\n0.0, 0.0, 0.1\n"
"""Near a corner of the default map, so that walls and what the laser sees are in the picture."""

SCENE = (365, 65, 1260, 805)
"""Where the window shows the world [pixel: left, top, right, bottom]."""

NAMES = (40, 125, 185, 258)
"""Where it shows the names of the displays, without the pictures beside them [likewise]."""

COLOURS = {
    "the free map": (lambda r, g, b: min(r, g, b) > 240, 100000),
    "the map's walls": (lambda r, g, b: max(r, g, b) < 8, 2000),
    "the car": (lambda r, g, b: r > 150 and g < 60 and b < 60, 60),
    "the odometry": (lambda r, g, b: r < 120 and g > 140 and b < 160 and g > b + 30, 8),
    "the driven path": (lambda r, g, b: r < 60 and 40 < g < 160 and b > 170, 200),
    "the predicted path": (lambda r, g, b: r > 230 and 140 < g < 190 and b < 40, 200),
    "the laser scan": (lambda r, g, b: r > 180 and g < 60 and b > 160, 50),
}
"""What has to be in the scene, by its colour, and on how many pixels at least."""

RED = (lambda r, g, b: r > 150 and g < 90 and b < 90, 1)
ORANGE = (lambda r, g, b: r > 160 and 90 < g < 170 and b < 60, 1)
BLUE = (lambda r, g, b: r < 90 and b > 150, 200)
"""How rviz writes the names of displays in error, of those with a warning, and of the others."""

KNOWN = (
    # Of the Map display's shader, before it gets its textures; then Mesa draws it well.
    r"\[ERROR\] \[[\d.]+\]: rviz/glsl120/indexed_8bit_image\.vert\n"
    r"rviz/glsl120/indexed_8bit_image\.frag\n GLSL link result : *\n"
    r"active samplers with a different type refer to the same texture image unit\n",
    # Debian has no package media_export, where rviz looks for the meshes of plugins.
    r"\[rospack\] Error: no such package media_export\n"
    r"\[librospack\]: error while executing command\n",
)
"""What rviz says of itself with a map in any view, on Debian."""

SCALE = 50.0
"""Of the view that follows the car [pixel/m]."""

PIXEL = 1.5 / SCALE
"""How far a click may be off [m]: a pixel, and half a one from its corner to its middle."""


def shows(picture, colour):
    """Say whether a picture has enough pixels of a colour."""
    test, least = colour
    counts = ((count, rgb) for count, rgb in picture.getcolors(picture.width * picture.height))
    return sum(count for count, rgb in counts if test(*rgb)) >= least


class RvizTest(unittest.TestCase):
    """One rviz for all that is to be seen: it takes seconds to start."""

    def setUp(self):
        require(self, "Xvfb", "rviz", "xdotool")
        self.display = Display()
        self.addCleanup(self.display.end)
        self.rviz = Process(
            "rosrun",
            "mushr_ros_intro",
            "view.py",
            "car",
            "__name:=view",
            DISPLAY=self.display.name,
            LIBGL_ALWAYS_SOFTWARE="1",
        )
        self.addCleanup(self.rviz.end)
        self.odometry = rospy.Publisher("/car/odom", Odometry, queue_size=1)

    def grab(self, box):
        return ImageGrab.grab(box, xdisplay=self.display.name).convert("RGB")

    def drive(self):
        """Drive the plan to its end."""
        with tempfile.NamedTemporaryFile(suffix=".txt") as plan:
            plan.write(PLAN)
            plan.flush()
            node = ("rosrun", "mushr_ros_intro", "path_publisher.py", f"_plan_file:={plan.name}")
            with Process(*node) as publisher:
                self.assertEqual(publisher.wait(), 0, publisher.output)

    def test_view(self):
        """Every display has something to show, none complains, and the tools publish."""
        # A second publisher of that topic learns whether rviz listens, and says nothing itself.
        wait_for(self.odometry.get_num_connections, "rviz to listen to the odometry")
        self.drive()

        def missing():
            scene = self.grab(SCENE)
            return [what for what, colour in COLOURS.items() if not shows(scene, colour)]

        wait_for(lambda: not missing(), f"the picture to show {missing()}")
        names = self.grab(NAMES)
        self.assertTrue(shows(names, BLUE), "the names of the displays are not where expected")
        self.assertFalse(shows(names, RED), "a display is in error")
        self.assertFalse(shows(names, ORANGE), "a display has a warning")

        self.click()
        self.assertTrue(self.rviz.running, self.rviz.output)
        said = re.sub("\x1b\\[\\d*m", "", self.rviz.output).replace("\r", "")
        for known in KNOWN:
            said = re.sub(known, "", said)
        self.assertIsNone(re.search("ERROR|WARN|FATAL|[Ee]rror", said), said)

    def click(self):
        """Publish a point, and place the car, with rviz's tools."""
        window = wait_for(lambda: self.display.xdotool("search", "--name", "RViz$"), "rviz")[-1]
        wait_for(lambda: self.display.focus(window), "rviz to have the keys")
        car_pose = Recording("/car/car_pose", PoseStamped).connected()
        clicked = Recording("/clicked_point", PointStamped).connected()
        placed = Recording("/initialpose", PoseWithCovarianceStamped).connected()
        x, y, _ = planar(wait_for(lambda: car_pose.last, "the car's pose").pose)
        middle = ((SCENE[0] + SCENE[2]) // 2, (SCENE[1] + SCENE[3]) // 2)
        right, up = 120, -90

        def point():
            self.display.xdotool("mousemove", str(middle[0] + right), str(middle[1] + up))
            self.display.xdotool("key", "c", "click", "1")
            return clicked.last

        first = wait_for(point, "a clicked point")
        self.assertEqual(first.header.frame_id, "map")
        right, up = -100, 60
        clicked.clear()
        second = wait_for(point, "another clicked point")
        self.assertAlmostEqual(first.point.x - second.point.x, 220 / SCALE, delta=PIXEL)
        self.assertAlmostEqual(first.point.y - second.point.y, 150 / SCALE, delta=PIXEL)

        def place():
            where = [str(number) for number in (middle[0] - 100, middle[1] + 60)]
            ahead = [str(number) for number in (middle[0] - 100, middle[1] - 60)]
            self.display.xdotool("key", "p", "mousemove", *where, "mousedown", "1")
            self.display.xdotool("mousemove", *ahead, "mouseup", "1")
            return placed.last

        pose = planar(wait_for(place, "a pose estimate").pose.pose)
        self.assertAlmostEqual(pose[0], second.point.x, delta=PIXEL)
        self.assertAlmostEqual(pose[1], second.point.y, delta=PIXEL)
        self.assertAlmostEqual(pose[2], 1.5707963, delta=0.01)
        self.assertAlmostEqual(pose[0], x - 100 / SCALE, delta=0.3)
        wait_for(
            lambda: max(abs(a - b) for a, b in zip(planar(car_pose.last.pose), pose)) < 1e-6,
            f"the car to be at {pose}",
        )


if __name__ == "__main__":
    rospy.init_node("rviz_test")
    rostest.rosrun("mushr_ros_intro", "rviz", RvizTest)
