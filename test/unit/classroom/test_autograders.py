"""Make autograders with wrong arguments and files; see also test/system/test_autograder.py."""

import os
import re
import subprocess
import zipfile

import pytest

from support.paths import CHECKOUT


def make(folder, *arguments):
    """Run make_autograder in a folder, without the environment of the workspace."""
    command = ["env", "-i", "-C", folder, f"{CHECKOUT}/scripts/make_autograder", *arguments]
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.fixture
def folder(tmp_path):
    """Return a folder with plans and points."""
    (tmp_path / "open.txt").write_text("0,0,0.5\n1.0,0.1\n")
    (tmp_path / "wrong.txt").write_text("0,0,0.5\n1.0,nan\n")
    (tmp_path / "points.yaml").write_text("plans: {secret: {path: 4}}\n")
    (tmp_path / "autograder.zip").write_text("an older one")
    return tmp_path


@pytest.mark.parametrize(
    "arguments, reason",
    [
        (["--plans", "missing"], "no such file"),
        (["--plans", "wrong.txt"], "wrong.txt:2"),
        (["--plans", "open.txt", "open.txt"], "two plans with the name 'open'"),
        (["--plans", "open.txt", "--points", "points.yaml"], "unknown key secret"),
        (["--plans", "open.txt", "--car", "bus"], "--car is 'bus'"),
        (["--plans", "open.txt", "--map", "moon"], "moon: no such file"),
        (["--plans", "slalom", "--map", "rooms"], "slalom.txt:5:1: the car hits a wall"),
        (["--plans", "open.txt", "--remap", "a=b"], "--remap is 'a=b'"),
        (["--plans", "open.txt", "--file", "src/a.py"], "--file is 'src/a.py'"),
    ],
)
def test_fault(folder, arguments, reason):
    done = make(folder, *arguments)
    assert (done.returncode, done.stdout.count("\n")) == (2, 1), done.stdout
    assert reason in done.stdout
    assert (folder / "autograder.zip").read_text() == "an older one"
    assert not [each for each in os.listdir(folder) if each.startswith(".")]


def test_no_solution(folder):
    """The zip contains no node that drives, and the programs that CMakeLists.txt names."""
    done = make(folder, "--plans", "open.txt")
    assert done.returncode == 0, done.stdout
    with zipfile.ZipFile(folder / "autograder.zip") as archive:
        files = {each for each in archive.namelist() if not each.endswith("/")}
        build = archive.read("mushr_ros_intro/CMakeLists.txt").decode()
    nodes = {each for each in files if re.fullmatch(r"mushr_ros_intro/src/\w+\.py", each)}
    assert {f"mushr_ros_intro/{each}" for each in re.findall(r"src/\w+\.py", build)} == nodes
    assert nodes == {"mushr_ros_intro/src/grade.py"}
    names = "path_publisher|listing|examples|test_|/drive/|/authoring/|/browser/"
    assert not [each for each in files if re.search(names, each)]
