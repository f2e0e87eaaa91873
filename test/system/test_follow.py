"""Grade controllers that follow a path."""

import csv
import math
import shutil

import numpy as np
import pytest

from mushr_ros_intro.stamps import NANOSECONDS
from support.controllers import CONTROLLERS, WAVE, replay
from support.helpers import node

FINDS = """#!/usr/bin/python3
import rospy
import tf2_ros
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetMap

rospy.init_node("controller")
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
for _ in range(2):
    path = rospy.wait_for_message("/car/reference_path", Path)
seconds = (path.poses[-1].header.stamp - path.header.stamp).to_sec()
print(len(path.poses), path.header.frame_id, f"{seconds:.3f}")
for base in ("base_footprint", "car/base_footprint"):
    found = buffer.lookup_transform("map", base, rospy.Time(0), rospy.Duration(1.0)).transform
    print(f"{found.rotation.z:.3f}")
for frame in ("base_link", "laser_link"):
    found = buffer.lookup_transform("car/base_footprint", f"car/{frame}", rospy.Time(0)).transform
    print(f"{found.translation.x:.4f} {found.translation.z:.4f}")
grid = rospy.ServiceProxy("/static_map", GetMap)().map
print(grid.info.width, grid.info.height)
places = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1)
rospy.sleep(0.5)
places.publish(PoseWithCovarianceStamped())
rospy.sleep(0.5)
"""


def test_what_a_controller_finds(tmp_path):
    """The path, latched, and with stamps; frames with and without a prefix, also fixed ones; a map.

    The car stands at the start of the path, and the controller must not place it.
    """
    path = tmp_path / "finds.py"
    path.write_text(FINDS)
    path.chmod(0o755)
    judgement = replay(path, WAVE, map_name="sandbox")
    turn = f"{math.sin(WAVE.start.theta / 2.0):.3f}"
    duration = f"{WAVE.duration / NANOSECONDS:.3f}"
    links = ["0.1580 0.0947", "0.1227 0.2025"]  # as in the URDF
    said = [f"{len(WAVE.poses)} map {duration}", turn, turn, *links, "1000 1000"]
    assert judgement.recorded.output.split("\n")[:6] == said, judgement.recorded.output
    topics = judgement.checks[1]
    assert topics.message.startswith("the node places the car again, at "), topics.message


@pytest.mark.full
def test_a_controller_that_waits_for_another_node(tmp_path):
    path = tmp_path / "waits.py"
    path.write_text(FINDS.replace("/car/reference_path", "/car/particle_filter/path"))
    path.chmod(0o755)
    (check, *_) = replay(path, WAVE).checks
    assert "waits for messages on /car/particle_filter/path, where nobody" in check.message


def test_a_class(tmp_path):
    """Isolated, with parameters."""
    for name in ("ann", "cleo"):
        (tmp_path / name).mkdir()
        shutil.copy(f"{CONTROLLERS}/pursuit.py", tmp_path / name)
        shutil.copy(f"{CONTROLLERS}/loop.py", tmp_path / name / "controller.py")
    (tmp_path / "ann" / "gains.yaml").write_text("gain: 1.0")
    path = tmp_path / "wave.csv"
    np.savetxt(path, [(*pose, WAVE.speed) for pose in WAVE.poses], delimiter=",")
    points = tmp_path / "points.yaml"
    points.write_text("default: {cross_track: 3, final_pose: 1}\ntolerances: {cross_track: 0.035}")
    words = ("--follow", path, "--file", "controller.py", "--points", points)
    words += ("--params", "gains.yaml", "--out", tmp_path / "out")
    with node("grade.py", *map(str, (tmp_path / "ann", tmp_path / "cleo", *words))) as process:
        assert process.wait(300) == 1, process.output
    with open(tmp_path / "out" / "grades.csv", encoding="utf-8") as file:
        ann, cleo = csv.DictReader(file)
    assert float(ann["Score"]) == 1.0, ann
    assert cleo["Error/Fault"].startswith("gains.yaml: the file cannot be read"), cleo
