"""Check the package's view in rviz by its pixels, and click in it."""

import math
import re
import signal
import time

import pytest
import rospy
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from PIL import ImageGrab

from support.display import Display, require
from support.geometry import planar
from support.helpers import Process, Recording, RosTestCase, wait_for
from support.world import launch

pytestmark = pytest.mark.full

PLAN = "0.0, 0.0, 0.0\n1.5, 0.2, 2.0\n0.0, 0.0, 0.1\n"

SCENE = (365, 65, 1260, 805)
"""The part of the window that shows the world [pixel: left, top, right, bottom]."""

NAMES = (40, 125, 185, 258)
"""The part that shows the names of the displays, without their icons [likewise]."""

COLOURS = {
    "the free map": (lambda r, g, b: min(r, g, b) > 240, 100000),
    "the map's walls": (lambda r, g, b: max(r, g, b) < 8, 2000),
    "the car": (lambda r, g, b: r > 150 and g < 60 and b < 60, 60),
    "the odometry": (lambda r, g, b: r < 120 and g > 140 and b < 160 and g > b + 30, 8),
    "the driven path": (lambda r, g, b: r < 60 and 40 < g < 160 and b > 170, 200),
    "the predicted path": (lambda r, g, b: r > 230 and 140 < g < 190 and b < 40, 200),
    "the laser scan": (lambda r, g, b: r > 180 and g < 60 and b > 160, 50),
}
"""The colour of each thing in the scene, and its lowest number of pixels."""

RED = (lambda r, g, b: r > 150 and g < 90 and b < 90, 1)
ORANGE = (lambda r, g, b: r > 160 and 90 < g < 170 and b < 60, 1)
BLUE = (lambda r, g, b: r < 90 and b > 150, 200)
"""Colours of the names of displays: with an error, with a warning, and without a problem."""

KNOWN = (
    # The Map display's shader, before it gets its textures; then Mesa draws it well.
    r"\[ERROR\] \[[\d.]+\]: rviz/glsl120/indexed_8bit_image\.vert\n"
    r"rviz/glsl120/indexed_8bit_image\.frag\n GLSL link result : *\n"
    r"active samplers with a different type refer to the same texture image unit\n",
    # Debian has no package media_export, in which rviz looks for the meshes of plugins.
    r"\[rospack\] Error: no such package media_export\n"
    r"\[librospack\]: error while executing command\n",
)
"""Harmless messages of rviz on Debian, with a map in any view."""

SCALE = 39.0
"""Of the first view [pixel/m]."""

PIXEL = 2.0 / SCALE
"""The largest error of the distance between two clicks [m]: one pixel for each click."""

ANGLE = 0.02
"""The largest error of the angle of a drag over 120 pixels [rad]: a pixel and a half."""

STARTS = 3
"""Attempts to start rviz. On a busy machine, about 2 % of the attempts crash in Qt when rviz paints
its window for the first time (rviz 1.14.19, Qt 5.15.8; QWidgetPrivate::getOpaqueChildren)."""

RETRY = 3.0
"""[s] The test repeats an action after this time, because rviz may not have been ready."""

PAUSE = ("sleep", "0.1")
"""Between two movements of the mouse: rviz reads it once per frame."""


def shows(picture, colour):
    """Return whether a picture has enough pixels of a colour."""
    test, low = colour
    counts = ((count, rgb) for count, rgb in picture.getcolors(picture.width * picture.height))
    return sum(count for count, rgb in counts if test(*rgb)) >= low


def start_world():
    return launch("sim.launch")


class RvizTest(RosTestCase):
    """There is one test only, because rviz takes some seconds to start."""

    def setUp(self):
        super().setUp()
        require(self, "Xvfb", "rviz", "xdotool")
        self.display = Display()
        self.addCleanup(self.display.end)

    def start(self, name):
        """Start rviz, drive, and wait for the picture; return False if rviz crashed."""
        self.rviz = Process(
            *("rosrun", "mushr_ros_intro", "view.py", "car", f"__name:={name}"),
            DISPLAY=self.display.name,
            LIBGL_ALWAYS_SOFTWARE="1",
        )
        self.addCleanup(self.rviz.end)
        # This silent publisher is connected when rviz subscribes.
        odometry = rospy.Publisher("/car/odom", Odometry, queue_size=1)
        self.addCleanup(odometry.unregister)
        wait_for(
            lambda: odometry.get_num_connections() or not self.rviz.running,
            "rviz to subscribe to the odometry",
        )
        self.drive_plan(self.plan(PLAN))

        def missing():
            scene = self.grab(SCENE)
            return [name for name, colour in COLOURS.items() if not shows(scene, colour)]

        try:
            wait_for(lambda: not missing() or not self.rviz.running, "the picture")
        except AssertionError:
            self.assertEqual(missing(), [], self.rviz.output)
        if self.rviz.running:
            return True
        self.assertEqual(self.rviz.wait(), -signal.SIGSEGV, self.rviz.output)
        odometry.unregister()
        return False

    def grab(self, box):
        return ImageGrab.grab(box, xdisplay=self.display.name).convert("RGB")

    def test_view(self):
        """Every display shows something, none has an error, and the tools publish."""
        if not any(self.start(f"view_{number}") for number in range(STARTS)):
            self.fail(f"rviz crashed {STARTS} times as it started: {self.rviz.output}")
        names = self.grab(NAMES)
        self.assertTrue(shows(names, BLUE), "the names of the displays are not where expected")
        self.assertFalse(shows(names, RED), "a display is in error")
        self.assertFalse(shows(names, ORANGE), "a display has a warning")

        self.click()
        self.assertTrue(self.rviz.running, self.rviz.output)
        output = re.sub("\x1b\\[\\d*m", "", self.rviz.output).replace("\r", "")
        for known in KNOWN:
            output = re.sub(known, "", output)
        self.assertIsNone(re.search("ERROR|WARN|FATAL|[Ee]rror", output), output)

    def click(self):
        """Publish points and place the car with rviz's tools."""
        self.display.focus_on("RViz$")
        car_pose = Recording("/car/car_pose", PoseStamped).connected()
        clicked = Recording("/clicked_point", PointStamped).connected()
        placed = Recording("/initialpose", PoseWithCovarianceStamped).connected()
        middle = ((SCENE[0] + SCENE[2]) // 2, (SCENE[1] + SCENE[3]) // 2)
        one, other, third = (
            (middle[0] + right, middle[1] - up) for right, up in ((120, 90), (-100, -60), (90, -50))
        )

        # Escape first: the key of the active tool deactivates it.
        def select(pixel, tool):
            move = ("mousemove", *map(str, pixel), *PAUSE)
            self.display.xdotool(*move, "key", "Escape", tool, *PAUSE)

        def point(pixel):
            select(pixel, "c")
            self.display.xdotool("click", "1")

        def drag():
            select(third, "p")
            up = [("mousemove", str(third[0]), str(third[1] - dy), *PAUSE) for dy in (60, 120)]
            self.display.xdotool("mousedown", "1", *PAUSE, *up[0], *up[1], "mouseup", "1")

        first = self.publishes(clicked, lambda: point(one), lambda _: True, "a clicked point")
        self.assertEqual(first.header.frame_id, "map")

        def is_at(pixel, x, y):
            right = first.point.x - x - (one[0] - pixel[0]) / SCALE
            up = first.point.y - y - (pixel[1] - one[1]) / SCALE
            return max(abs(right), abs(up)) < PIXEL

        def is_placed(msg):
            x, y, theta = planar(msg.pose.pose)
            return is_at(third, x, y) and abs(theta - math.pi / 2) < ANGLE

        self.publishes(
            clicked,
            lambda: point(other),
            lambda msg: is_at(other, msg.point.x, msg.point.y),
            "another clicked point, as far from the first as the pixels are",
        )
        self.publishes(placed, drag, is_placed, "a pose estimate there, facing up")
        car_pose.shows(planar(placed.last.pose.pose), placed.last.header.stamp)

    def publishes(self, recording, act, is_right, what):
        """Call `act` until a right message arrives; return this message."""
        retry = 0.0

        def result():
            nonlocal retry
            if time.monotonic() > retry:
                act()
                retry = time.monotonic() + RETRY
            return next(filter(is_right, recording.messages), None)

        return wait_for(result, what)
