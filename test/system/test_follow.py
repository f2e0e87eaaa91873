"""Grade controllers that follow a path: equal drives under any load, and the verdicts."""

import csv
import glob
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from roslib.packages import find_node

from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.isolation.workspace import inherited
from mushr_ros_intro.replay.job import Job, run_job
from mushr_ros_intro.replay.reference import read_references
from mushr_ros_intro.replay.setting import read_setting
from support.helpers import Process
from support.paths import CHECKOUT, PACKAGE

CONTROLLERS = f"{CHECKOUT}/test/fixtures/controllers"
STYLES = [
    "three_threads",
    *(
        pytest.param(name, marks=pytest.mark.full)
        for name in ("loop", "answer", "timer", "explorer")
    ),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the controllers; rosrun must not find those of the fixtures."""
    place = tmp_path_factory.mktemp("controllers")
    for path in glob.glob(f"{CONTROLLERS}/*.py"):
        shutil.copy(path, place)
        os.chmod(place / os.path.basename(path), 0o755)
    return str(place)


(WAVE,) = read_references(["wave"], f"{CHECKOUT}/plans").values()


def follow(name, folder, *remap):
    """Return the judgement on a controller."""
    setting = read_setting(
        *(PACKAGE, "ideal", "none", None),
        remap=remap,
        timeout=15.0,
        tolerances={},
        sandbox=Sandbox(),
        ros=inherited(),
    )
    return run_job(Job(name, (os.path.join(folder, f"{name}.py"),), WAVE, setting))


@pytest.mark.parametrize("name", STYLES)
def test_equal_drives(folder, name):
    """Alone, and three at the same time beside two busy processes."""
    alone = follow(name, folder)
    assert alone.passed, alone.verdict
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        with ThreadPoolExecutor(3) as pool:
            others = list(pool.map(follow, 3 * [name], 3 * [folder]))
    finally:
        for each in busy:
            each.kill()
    for each in others:
        assert each.drive.driven.tobytes() == alone.drive.driven.tobytes()
        assert each.verdict == alone.verdict


def test_a_node_that_waits_in_wall_clock_time(tmp_path):
    """A lock with a timeout cannot wait in simulated time."""
    shutil.copy(f"{CONTROLLERS}/pursuit.py", tmp_path)
    with open(f"{CONTROLLERS}/loop.py", encoding="ascii") as file:
        text = file.read().replace("rate.sleep()", "threading.Event().wait(0.05)")
    path = tmp_path / "loop.py"
    path.write_text(text.replace("import rospy\n", "import threading\n\nimport rospy\n", 1))
    path.chmod(0o755)
    (check, *_) = follow("loop", str(tmp_path)).checks
    assert not check.passed
    assert check.message.startswith("the node sends commands while the simulated clock stands, so")


def test_a_controller_that_steers_the_wrong_way(folder):
    judgement = follow("loop", folder, "_gain:=-1.0")
    failed = {each.name for each in judgement.checks if not each.passed}
    assert failed >= {"path", "cross_track", "final_pose"} and "topics" not in failed


def test_a_class(tmp_path):
    """Isolated, with points in proportion; the same command again drives nothing."""
    for name, style in (("ann", "loop"), ("bob", "three_threads"), ("cleo", "loop")):
        (tmp_path / name).mkdir()
        shutil.copy(f"{CONTROLLERS}/pursuit.py", tmp_path / name)
        shutil.copy(f"{CONTROLLERS}/{style}.py", tmp_path / name / "controller.py")
    for name in ("ann", "bob"):
        (tmp_path / name / "gains.yaml").write_text("gain: 1.0")
    points = tmp_path / "points.yaml"
    points.write_text("default: {cross_track: 3, final_pose: 1, in_proportion: true}")
    command = (
        find_node("mushr_ros_intro", "grade.py")[0],
        *(tmp_path / name for name in ("ann", "bob", "cleo")),
        *("--follow", "wave", "--file", "controller.py", "--points", points),
        *("--params", "gains.yaml"),
        *("--cross-track-tolerance", "0.035", "--out", tmp_path / "out"),
    )
    for _ in range(2):
        with Process(*map(str, command)) as process:
            assert process.wait(300) == 1, process.output
        with open(tmp_path / "out" / "grades.csv", encoding="utf-8") as file:
            ann, bob, cleo = csv.DictReader(file)
    assert 1.0 < float(ann["Score"]) < 4.0, ann
    assert float(bob["Score"]) == 1.0, bob
    assert cleo["Error/Fault"].startswith("gains.yaml: the file cannot be read"), cleo
