"""Check that the example of a course's package passes right solutions and fails wrong ones."""

import concurrent.futures
import os
import subprocess
import xml.etree.ElementTree as ElementTree

from mushr_ros_intro.replay.judge import CHECK_NAMES
from support.geometry import angle_between, closed_form
from support.helpers import failures_in, rostest_results
from support.paths import PACKAGE, copy_package

COURSE = os.path.join(PACKAGE, "examples", "example_course")
PARKING = os.path.join(COURSE, "plans", "parking.txt")


def rostest(folder, name, *arguments):
    """Run a test of the copied course; return its exit status, and its failures by case."""
    packages = os.pathsep.join((f"{folder}/example_course", os.environ["ROS_PACKAGE_PATH"]))
    path = f"{folder}/{name}/example_course/rosunit-*.xml"
    command = ("example_course", name, *arguments)
    process, result = rostest_results(path, *command, ROS_PACKAGE_PATH=packages)
    return process.wait(), failures_in(result)


def test_verdicts(tmp_path):
    """The student's node passes, and a plan that parks on the wrong side fails."""
    with open(PARKING) as file:
        start, straight, left, right, end = file
    copy_package(COURSE, f"{tmp_path}/example_course")
    (tmp_path / "wrong.txt").write_text("".join((start, straight, right, left, end)))
    with concurrent.futures.ThreadPoolExecutor() as pool:
        node = pool.submit(rostest, tmp_path, "solution.test.xml")
        plan = pool.submit(rostest, tmp_path, "plan.test.xml", f"plan_file:={tmp_path}/wrong.txt")
    status, cases = node.result()
    assert cases.keys() == {*CHECK_NAMES}
    assert [message for message in cases.values() if message] == []
    assert status == 0
    status, cases = plan.result()
    assert "-0.8707 m, 0.0000 rad), 1.74 m" in str(cases["test_pose"])
    assert status != 0


def test_right_plan():
    with open(PARKING) as file:
        start, *rows = (tuple(map(float, line.split(","))) for line in file)
    x, y, theta = closed_form(start, [(*row, 1.0) for row in rows])
    test = ElementTree.parse(os.path.join(COURSE, "plan.test.xml")).getroot()
    space = {param.get("name"): param.get("value") for param in test.find("test").iter("param")}
    off = abs(complex(x, y) - complex(float(space["x"]), float(space["y"])))
    assert off < float(space["position_tolerance"])
    assert angle_between(theta, float(space["theta"])) < float(space["angle_tolerance"])


def test_ros_does_not_find_the_example_inside_the_package():
    """ROS does not search inside a package, so the example needs no CATKIN_IGNORE."""
    path = os.environ["ROS_PACKAGE_PATH"]
    listed = subprocess.run(["rospack", "list-names"], stdout=subprocess.PIPE, check=True)
    assert "mushr_ros_intro" in listed.stdout.decode().split(), path
    assert "example_course" not in listed.stdout.decode().split(), path
