"""Check the command line of grade.py, and what it needs of the machine."""

import importlib
import os
import signal
import sys

import pytest
from roslib.packages import find_node

from support import classroom as submissions
from support.cars import CARS
from support.grading import PLAN, PRIVILEGED, assert_status
from support.helpers import Process, wait_for
from support.paths import PACKAGE


@pytest.mark.full
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_interrupted(tmp_path, ending):
    """Ctrl-C or SIGTERM keeps what is graded; then the same command grades the rest."""
    submissions.write(tmp_path / "class", "right", submissions.RIGHT)
    silent = "#!/usr/bin/python3\nimport signal\nsignal.pause()\n"
    submissions.write(tmp_path / "class", "silent", silent)
    (tmp_path / "plan.txt").write_text(PLAN)
    plan = ("--plans", tmp_path / "plan.txt", "--out", tmp_path / "out")
    plan += ("--jobs", 1)  # the silent node begins after the first result
    command = (find_node("mushr_ros_intro", "grade.py")[0], tmp_path / "class", *plan)
    with Process(*map(str, command)) as process:
        wait_for(lambda: "right " in process.output, "the first result")
        process.send_signal(ending)
        assert process.wait() == 3, process.output
        assert "interrupted: 1 of 2 submissions graded; the same command" in process.output
    assert "not graded" in (tmp_path / "out" / "submissions" / "silent.html").read_text()
    output = assert_status(1, tmp_path / "class", *plan)
    assert "earlier run used: 1 submission" in output and "silent " in output


@pytest.mark.full
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of files")
def test_a_report_belongs_to_the_user_of_sudo(tmp_path):
    node = ("--node", "mushr_ros_intro", "path_publisher.py")
    user = {"SUDO_UID": "1234", "SUDO_GID": "1235"}
    assert_status(0, "test_drive", *node, "--out", tmp_path / "out", **user)
    files = [tmp_path / "out", *(tmp_path / "out").rglob("*")]
    assert len(files) == 4
    assert {(each.stat().st_uid, each.stat().st_gid) for each in files} == {(1234, 1235)}


def test_other_files_stay(tmp_path):
    """grade.py does not write to a folder with other files."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "mine.json").write_text("{}")
    output = assert_status(2, PACKAGE, "--plans", "figure_8", "--out", tmp_path)
    assert "expected a new or empty folder" in output
    assert os.listdir(tmp_path) == ["data"] and os.listdir(tmp_path / "data") == ["mine.json"]


def test_a_plan_of_a_submission_is_not_used(tmp_path):
    """A student cannot replace figure_8, whose name means a file in the current directory first."""
    plan = tmp_path / "figure_8.txt"
    plan.write_text("0,0,0\n1.0,0.0\n")
    arguments = (tmp_path, "--plans", "figure_8", "--out", tmp_path / "out")
    output = assert_status(2, *arguments, PWD=str(tmp_path))
    assert f"{plan}: this plan is in a submission" in output
    assert not (tmp_path / "out").exists()


@PRIVILEGED
@pytest.mark.full
def test_the_name_of_the_machine_does_not_resolve(tmp_path):
    """Debian's packages set no ROS_HOSTNAME."""
    (tmp_path / "plan.txt").write_text(PLAN)
    rename = "echo nowhere >/proc/sys/kernel/hostname"
    command = f"env -u ROS_HOSTNAME -u LD_PRELOAD {find_node('mushr_ros_intro', 'grade.py')[0]}"
    arguments = f"{tmp_path}/plan.txt --node mushr_ros_intro path_publisher.py"
    script = f"{rename} && exec {command} {arguments}"
    with Process("unshare", "--uts", "sh", "-c", script) as process:
        assert process.wait() == 0, process.output


NODE = ("--node", "mushr_ros_intro", "path_publisher.py")
FOLLOW = (PACKAGE, "--follow", "wave", "--out", "/nowhere/out")


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("figure_8", *NODE[:2], "nothing.py"), 2, "there is no node 'nothing.py'"),
        (("figure_8", *NODE[:2], "path_publisher"), 2, "did you mean path_publisher.py"),
        (("figure_8", "--node", "mushr_ros_into", "a.py"), 2, "; did you mean mushr_ros_intro?"),
        (("figure_8", *NODE, "--jobs", "1"), 2, "--jobs needs submissions"),
        (("figure_8", *NODE, "--points", "/nowhere.yaml"), 2, "/nowhere.yaml"),
        (("figure_8",), 2, "expected PLAN... --node PACKAGE FILE, or"),
        (("figure_8", *NODE, "--car", "nano"), 2, f"{max(CARS)}; did you mean mushr_nano?"),
        (("--merge", "/nowhere", "--out", "/nowhere"), 2, "/nowhere: not the output of grade.py"),
        (("/nowhere", "--plans", "figure_8", "--out", "/proc/x"), 3, "/proc/x"),
        ((PACKAGE, "--plans", "figure_8", "--out", f"{PACKAGE}/new"), 2, "which is graded; exp"),
        (("figure_8", *NODE, "--out", "/dev/null"), 2, "--out: /dev/null is not a folder"),
        (("/nowhere", "--out", "out"), 2, "or SUBMISSION... --plans PLAN... --out FOLDER"),
        ((*FOLLOW, "--params", "/a.yaml"), 2, "found --params '/a.yaml'; expected the path of a"),
        ((*FOLLOW, "--params", "a/../../a.yaml"), 2, "expected the path of a file in a submission"),
    ],
)
def test_usage(monkeypatch, capsys, arguments, status, message):
    """In this process, because the start of grade.py takes most of its time."""
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    monkeypatch.setattr(sys, "argv", ["grade.py", *arguments])
    monkeypatch.syspath_prepend(os.path.join(PACKAGE, "src"))
    main = importlib.import_module("grade").main
    try:
        found = main()
    except SystemExit as error:  # of argparse
        found = error.code
    output = capsys.readouterr().err
    assert found == status and message in output, output
