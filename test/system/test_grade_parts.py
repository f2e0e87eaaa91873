"""Grade submissions that are built, in parts; and a machine on which no node can run."""

import csv
import json
import os
import shutil
import tempfile

import pytest

from mushr_ros_intro.replay.judge import CHECK_NAMES
from support import classroom as submissions
from support.grading import ISOLATED, PLAN, PRIVILEGED, WITHOUT_NAMESPACES, assert_status, load

GENERATES = """
find_package(catkin REQUIRED COMPONENTS ackermann_msgs)
if(NOT EXISTS ${ackermann_msgs_INSTALL_PREFIX}/share AND NOT ackermann_msgs_SOURCE_PREFIX)
  message(FATAL_ERROR "ackermann_msgs is not there")
endif()
file(WRITE ${CATKIN_DEVEL_PREFIX}/lib/python3/dist-packages/generated.py "ANSWER = 42\\n")
"""


HOOK = """
catkin_package()
catkin_add_env_hooks(attack SHELLS sh DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/src)
"""
SHADOWS = ("sitecustomize", "usercustomize", "mushr_ros_intro", "rosbag", "rosmaster", "matplotlib")


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Grade two packages that have to be built, in two parts; return their folder.

    The users of the nodes of the first part, which are not isolated, cannot reach the folder.
    """
    folder = tmp_path_factory.mktemp("parts")
    uses = submissions.before("import generated\nassert generated.ANSWER == 42")
    attacked = f"{folder}/attacked"  # by code that runs with the environment of grade.py
    python = f"import os; 'GRADER' in os.environ and open({attacked!r}, 'w').close()"
    package = submissions.write(folder / "class", "builds", uses, cmake=GENERATES + HOOK)
    files = {f"{name}.py": python for name in SHADOWS}
    files["attack.sh"] = f'[ -z "$GRADER" ] || touch {attacked}'
    for name, text in files.items():
        with open(f"{package}/src/{name}", "w", encoding="ascii") as file:
            file.write(f"{text}\n")
    sees = f'if(EXISTS "{folder}/plan.txt")\n  message("sees the plan")\nendif()\n'
    fails = f"{sees}add_custom_target(broken ALL COMMAND false)\n"
    submissions.write(folder / "class", "cannot_build", submissions.RIGHT, cmake=fails)
    (folder / "plan.txt").write_text(PLAN)
    (folder / "points.yaml").write_text("default: {path: 3, map: 1}\n")
    (folder / "private").mkdir(0o700)
    plan = ("--plans", folder / "plan.txt", "--points", folder / "points.yaml")
    environment = {"TMPDIR": str(folder / "private"), "GRADER": "1"}
    command = (folder / "class" / "builds", *plan, "--out", folder / "1")
    assert_status(0, *command, prefix=WITHOUT_NAMESPACES, **environment)
    assert_status(1, folder / "class" / "cannot_build", *plan, "--out", folder / "2")
    return folder


def test_merge(parts):
    command = ("--merge", parts / "1", parts / "2")
    output = assert_status(1, *command, "--out", parts / "all")
    assert "1 of 2 submissions passed" in output
    with open(parts / "all" / "grades.csv", newline="") as file:
        rows = {row["Name"]: row for row in csv.DictReader(file)}
    scores = {name: row["Score"] for name, row in rows.items()}
    assert scores == {"builds": "4", "cannot_build": "0"}
    assert "the package does not build" in rows["cannot_build"]["Error/Fault"]


@ISOLATED
def test_build_sees_no_plan(parts):
    fault = load(parts / "2" / "data" / "cannot_build.json").fault
    assert "does not build" in fault and "sees the plan" not in fault


def test_hooks_and_modules(parts):
    """grade.py sources no environment hook of a submission, and imports no module of it."""
    assert not (parts / "attacked").exists()
    record = load(parts / "1" / "data" / "builds.json")
    assert not record.fault


def test_gradescope(tmp_path):
    """A node gets the plan that is drawn for it."""
    package = submissions.write(tmp_path, "right", submissions.RIGHT)
    path = tmp_path / "results.json"
    plans = ("--plans", "drawn", "--secret", "7", "--out", tmp_path / "out")
    assert_status(0, package, *plans, "--gradescope", path)
    tests = json.loads(path.read_text())["tests"]
    assert sum(test["score"] for test in tests) == len(CHECK_NAMES)


@PRIVILEGED
def test_no_node_can_run(parts, tmp_path):
    """If a fault of the machine would make each submission fail, grade.py judges none."""
    with tempfile.TemporaryDirectory(dir="/var/lib") as name:
        os.chmod(name, 0o755)
        os.mkdir(f"{name}/tmp")
        script = f'mount -t tmpfs -o noexec tmpfs {name}/tmp && exec "$@"'
        command = ("unshare", "--mount", "sh", "-c", script, "sh", *WITHOUT_NAMESPACES)
        package = submissions.write(name, "right", submissions.RIGHT)
        plan = shutil.copy(parts / "plan.txt", name)
        arguments = (package, "--plans", plan, "--out", f"{name}/out")
        output = assert_status(3, *arguments, prefix=command, TMPDIR=f"{name}/tmp")
        assert os.listdir(f"{name}/out") == ["data"]
    assert "nodes cannot run here, so nothing is graded: " in output
    assert "Permission denied" in output and "Set TMPDIR to a folder" in output
