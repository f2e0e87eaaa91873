#!/usr/bin/python3
"""Look at the package's view in rviz, on a display of its own, and click in it."""

import math
import re
import signal
import tempfile
import time
import unittest

import rospy
import rostest
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from PIL import ImageGrab

from support.display import Display, require
from support.helpers import PATIENCE, Process, Recording, node, planar, wait_for

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

PIXEL = 2.0 / SCALE
"""How far two clicks may be off [m]: a pixel each."""

ANGLE = 0.02
"""How far the angle of a drag over 120 pixels may be off [rad]: a pixel and a half."""

ROUNDING = 1e-6
"""Of a pose on its way through a message to the car [m, rad]."""

CRASH = -signal.SIGSEGV
STARTS = 3
"""How often rviz may start: on a busy machine one start in about fifty ends in Qt, as it paints its
window for the first time (rviz 1.14.19, Qt 5.15.8; QWidgetPrivate::getOpaqueChildren)."""

AGAIN = 3.0
"""When to try an action again [s], in case rviz was not ready for it."""

HAND = ("sleep", "0.1")
"""What xdotool does between two movements, as a hand does: rviz looks once a frame."""


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

    def start(self, name):
        """Start rviz, drive, and wait for the picture; say whether it is there.

        It is not where rviz has crashed, which must have been at its start.
        """
        self.rviz = Process(
            "rosrun",
            "mushr_ros_intro",
            "view.py",
            "car",
            f"__name:={name}",
            DISPLAY=self.display.name,
            LIBGL_ALWAYS_SOFTWARE="1",
        )
        self.addCleanup(self.rviz.end)
        # A second publisher of that topic learns whether rviz listens, and says nothing itself.
        odometry = rospy.Publisher("/car/odom", Odometry, queue_size=1)
        self.addCleanup(odometry.unregister)

        def listens():
            return odometry.get_num_connections() or not self.rviz.running

        wait_for(listens, "rviz to listen to the odometry")
        self.drive()

        def missing():
            scene = self.grab(SCENE)
            return [what for what, colour in COLOURS.items() if not shows(scene, colour)]

        try:
            wait_for(lambda: not missing() or not self.rviz.running, "the picture")
        except AssertionError:
            self.assertEqual(missing(), [], self.rviz.output)
        if self.rviz.running:
            return True
        self.assertEqual(self.rviz.wait(), CRASH, self.rviz.output)
        odometry.unregister()
        return False

    def grab(self, box):
        return ImageGrab.grab(box, xdisplay=self.display.name).convert("RGB")

    def drive(self):
        """Drive the plan to its end."""
        with tempfile.NamedTemporaryFile(suffix=".txt") as plan:
            plan.write(PLAN)
            plan.flush()
            with node("path_publisher.py", f"_plan_file:={plan.name}") as publisher:
                self.assertEqual(publisher.wait(), 0, publisher.output)

    def test_view(self):
        """Every display has something to show, none complains, and the tools publish."""
        for number in range(STARTS):
            if self.start(f"view_{number}"):
                break
            print(f"rviz crashed as it started, as it does now and then: {self.rviz.output}")
        else:
            self.fail(f"rviz crashed {STARTS} times as it started")
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
        middle = ((SCENE[0] + SCENE[2]) // 2, (SCENE[1] + SCENE[3]) // 2)
        one, other, third = (
            (middle[0] + right, middle[1] - up) for right, up in ((120, 90), (-100, -60), (90, -50))
        )

        # Escape first: the key of the tool that is in use would put it away.
        def point(pixel):
            self.display.xdotool(
                "mousemove", *map(str, pixel), *HAND, "key", "Escape", "c", *HAND, "click", "1"
            )

        def drag():
            up = [("mousemove", str(third[0]), str(third[1] - dy), *HAND) for dy in (60, 120)]
            self.display.xdotool("mousemove", *map(str, third), *HAND, "key", "Escape", "p", *HAND)
            self.display.xdotool("mousedown", "1", *HAND, *up[0], *up[1], "mouseup", "1")

        first = self.answer(clicked, lambda: point(one), lambda _: True, "a clicked point")
        self.assertEqual(first.header.frame_id, "map")

        def is_at(pixel, x, y):
            return (
                abs(first.point.x - x - (one[0] - pixel[0]) / SCALE) < PIXEL
                and abs(first.point.y - y - (pixel[1] - one[1]) / SCALE) < PIXEL
            )

        self.answer(
            clicked,
            lambda: point(other),
            lambda msg: is_at(other, msg.point.x, msg.point.y),
            "another clicked point, as far from the first as the pixels are",
        )
        self.answer(
            placed,
            drag,
            lambda msg: is_at(third, *planar(msg.pose.pose)[:2])
            and abs(planar(msg.pose.pose)[2] - math.pi / 2) < ANGLE,
            "a pose estimate there, looking up",
        )

        def has_obeyed():
            wanted, got = planar(placed.last.pose.pose), planar(car_pose.last.pose)
            return math.dist(wanted, got) < ROUNDING

        wait_for(has_obeyed, "the car to be where it was placed")

    def answer(self, recording, act, is_right, what):
        """Act in rviz, again where nothing comes of it in a while; return the right message."""
        deadline = time.monotonic() + PATIENCE
        while True:
            act()
            again = time.monotonic() + AGAIN

            def result(again=again):
                found = [message for message in recording.messages if is_right(message)]
                return found or time.monotonic() > again

            found = wait_for(result, what)
            if found is not True:
                return found[0]
            if time.monotonic() > deadline:
                raise AssertionError(f"waited {PATIENCE:g} s for {what}")


if __name__ == "__main__":
    rospy.init_node("rviz_test")
    rostest.rosrun("mushr_ros_intro", "rviz", RvizTest)
