"""Check what the package's view shows in rviz, and where; use its tools."""

import math
import re
import signal
import time

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from PIL import ImageGrab

from support.display import Display, require
from support.geometry import closed_form, planar
from support.helpers import Process, Recording, RosTestCase, wait_for
from support.world import launch

pytestmark = pytest.mark.full

START, ROW = (3.0, 0.0, 0.0), (1.5, 0.2, 2.0)
PLAN = "\n".join(", ".join(map(str, each)) for each in (START, ROW, (0.0, 0.0, 0.1)))
X, Y, THETA = closed_form(START, [ROW])
"""The pose of the car after the plan [m, m, rad]. Its rear axle is in the middle of the view."""

RADIUS = 0.33 / math.tan(ROW[1])
"""The radius of the driven circle [m], whose rightmost point is this far to the right."""

TOLERANCE = 0.15
"""[m] Of a place in the view: half the width of a line, and some pixels."""

COLOURS = {
    "the free map": lambda r, g, b: (r > 240) & (g > 240) & (b > 240),
    "the map's walls": lambda r, g, b: (r < 8) & (g < 8) & (b < 8),
    "the car": lambda r, g, b: (r > 150) & (g < 60) & (b < 60),
    "the odometry": lambda r, g, b: (r < 120) & (g > 140) & (b < 160) & (g > b + 30),
    "the driven path": lambda r, g, b: (r < 60) & (g > 40) & (g < 160) & (b > 170),
    "the predicted path": lambda r, g, b: (r > 230) & (g > 140) & (g < 190) & (b < 40),
    "the laser scan": lambda r, g, b: (r > 180) & (g < 60) & (b > 160),
}
"""The colour of each thing in the view, given arrays."""

NAMES = {
    "an error": lambda r, g, b: (r > 150) & (g < 90) & (b < 90),
    "a warning": lambda r, g, b: (r > 160) & (g > 90) & (g < 170) & (b < 60),
    "no problem": lambda r, g, b: (r < 90) & (b > 150),
}
"""The colours of the names of displays."""

NO_ICONS = "QTreeView { qproperty-iconSize: 1px 1px; }"
"""The style of rviz's panels, whose icons have the colours of an error, too."""

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

SCALE = 50.0
"""Of the first view in rviz/default.rviz [pixel/m]."""

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


def pixels(picture, colour):
    """Return the (x, y) of the pixels of a colour [m], from the middle of a picture."""
    red, green, blue = np.asarray(picture, dtype=int).transpose(2, 1, 0)
    columns, rows = np.nonzero(colour(red, green, blue))
    return columns / SCALE - picture.width / 2 / SCALE, picture.height / 2 / SCALE - rows / SCALE


def lie_on(cells, grid, x, y):
    """Return whether nearly all places (x, y) [m] are in cells of a map, or beside one."""
    columns, rows = (
        np.floor((each - origin) / grid.info.resolution).astype(int)
        for each, origin in ((x, grid.info.origin.position.x), (y, grid.info.origin.position.y))
    )
    steps = range(-2, 3)
    near = [cells[rows + up, columns + right] for up in steps for right in steps]
    return np.any(near, axis=0).mean() > 0.99


def misplaced(scene, grid):
    """Return the names of all things that a picture of the view lacks, or has at a wrong place."""
    found = {name: pixels(scene, colour) for name, colour in COLOURS.items()}
    missing = [name for name, (x, _) in found.items() if not x.size]
    if missing:
        return missing
    cells = np.reshape(grid.data, (grid.info.height, grid.info.width))
    on_map = {"the free map": cells == 0, "the map's walls": cells == 100}
    on_map["the laser scan"] = on_map["the map's walls"]
    wrong = [
        name
        for name, kind in on_map.items()
        if not lie_on(kind, grid, found[name][0] + X, found[name][1] + Y)
    ]
    x, y = map(np.mean, found["the car"])  # half a wheelbase before the rear axle
    if math.dist((x, y), (0.165 * math.cos(THETA), 0.165 * math.sin(THETA))) > TOLERANCE:
        wrong.append("the car")
    x, y = map(np.mean, found["the odometry"])  # an arrow
    if abs(math.atan2(y, x) - THETA) > 0.2:
        wrong.append("the odometry")
    for name in ("the driven path", "the predicted path"):  # the car hides the upper end
        x, y = found[name]
        box = np.array([x.min() + X, x.max() + X, y.min() + Y])
        if abs(box - (START[0], START[0] + RADIUS, START[1])).max() > TOLERANCE:
            wrong.append(name)
    return wrong


def start_world():
    return launch("sim.launch")


class RvizTest(RosTestCase):
    """There is one test only, because rviz takes some seconds to start."""

    def setUp(self):
        super().setUp()
        self.grid = Recording("/map", OccupancyGrid).first(lambda _: True, "the map")
        self.style = self.plan(NO_ICONS, "style.qss")
        require(self, "Xvfb", "rviz", "xdotool")
        self.display = Display()
        self.addCleanup(self.display.end)

    def start(self, name):
        """Start rviz, drive, and wait for the picture; return False if rviz crashed."""
        self.rviz = Process(
            *("rosrun", "mushr_ros_intro", "view.py", "car", f"__name:={name}"),
            *("-stylesheet", self.style),
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

        def is_complete():
            return not self.rviz.running or not misplaced(self.grab(self.view()), self.grid)

        try:
            wait_for(is_complete, "the picture")
        except AssertionError:
            self.assertEqual(misplaced(self.grab(self.view()), self.grid), [], self.rviz.output)
        if self.rviz.running:
            return True
        self.assertEqual(self.rviz.wait(), -signal.SIGSEGV, self.rviz.output)
        odometry.unregister()
        return False

    def view(self):
        """Return the part of the screen with the world [pixel: left, top, right, bottom]."""
        _, second, *_ = self.display.windows("rviz")  # the first one is the whole window
        return second

    def grab(self, box):
        """Return a picture of a part of the screen."""
        return ImageGrab.grab(box, xdisplay=self.display.name).convert("RGB")

    def test_view(self):
        """Every display shows something, none has an error, and the tools publish."""
        if not any(self.start(f"view_{number}") for number in range(STARTS)):
            self.fail(f"rviz crashed {STARTS} times as it started: {self.rviz.output}")
        left, top, _, bottom = self.view()
        panels = self.grab((0, top, left, bottom))
        found = {name: pixels(panels, colour)[0].size for name, colour in NAMES.items()}
        self.assertGreater(found["no problem"], 0, "the panels beside the view have no names")
        self.assertEqual((found["an error"], found["a warning"]), (0, 0), found)

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
        left, top, right, bottom = self.view()
        middle = ((left + right) // 2, (top + bottom) // 2)
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
