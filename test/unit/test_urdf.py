"""The car's model: sound, of the car's size, with MuSHR's joints."""

import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree

import pytest

from mushr_ros_intro.car.model import Car
from support.paths import PACKAGE

URDF = os.path.join(PACKAGE, "urdf", "mushr_car.urdf")

SIDES = ("left", "right")
STEER = {f"front_{side}_wheel_steer": "0 0 1" for side in SIDES}
THROTTLE = {f"{end}_{side}_wheel_throttle": "0 1 0" for end in ("front", "back") for side in SIDES}

ROUNDING = 1e-9
"""Of sums of the model's decimal numbers [m]."""


@pytest.fixture(scope="module", name="robot")
def _robot():
    return ElementTree.parse(URDF).getroot()


def position(robot, link):
    """Return where the link's origin is in base_footprint [m]; no joint on the way may turn it."""
    total = [0.0, 0.0, 0.0]
    while link != "base_footprint":
        joint = next(j for j in robot.iter("joint") if j.find("child").get("link") == link)
        origin = joint.find("origin")
        if origin is not None:
            assert origin.get("rpy") is None
            total = [a + float(b) for a, b in zip(total, origin.get("xyz").split())]
        link = joint.find("parent").get("link")
    return total


def test_check_urdf():
    """urdfdom's own checker accepts the model, with base_footprint as its root."""
    if not shutil.which("check_urdf"):
        pytest.skip("there is no check_urdf; it is in Debian's liburdfdom-tools")
    done = subprocess.run(["check_urdf", URDF], stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0, done.stdout
    assert "root Link: base_footprint" in done.stdout


def test_joints(robot):
    """The joints that move are MuSHR's six, about the right axes."""
    moving = {
        joint.get("name"): joint.find("axis").get("xyz")
        for joint in robot.iter("joint")
        if joint.get("type") != "fixed"
    }
    assert moving == {**STEER, **THROTTLE}


def test_size(robot):
    """The wheels are where the kinematics has them, on the ground; the laser is as MuSHR's."""
    car = Car()
    for end, x in (("front", car.wheelbase), ("back", 0.0)):
        for side, y in (("left", 0.5 * car.track), ("right", -0.5 * car.track)):
            link = f"{end}_{side}_wheel_link"
            assert position(robot, link) == pytest.approx([x, y, car.wheel_radius], abs=ROUNDING)
            radius = robot.find(f"link[@name='{link}']//cylinder").get("radius")
            assert float(radius) == car.wheel_radius
    assert position(robot, "base_link") == pytest.approx([0.158, 0.0, 0.0947], abs=ROUNDING)
    laser = [0.158 - 0.0353, 0.0, 0.0947 + 0.1078]
    assert position(robot, "laser_link") == pytest.approx(laser, abs=ROUNDING)


def test_prefix():
    """What the launch file's sed looks for is before every name of a link, and nowhere else."""
    with open(URDF, encoding="ascii") as file:
        text = file.read()
    root = ElementTree.fromstring(re.sub("link( name)?=.", r"\g<0>car/", text))
    names = [link.get("name") for link in root.iter("link")]
    names += [end.get("link") for tag in ("parent", "child") for end in root.iter(tag)]
    assert len(names) == 25 and all(name.startswith("car/") for name in names)
    assert not any("/" in joint.get("name") for joint in root.iter("joint"))
