"""Make autograders with wrong arguments and files; see also test/system/test_autograder.py."""

import json
import os
import pathlib
import re
import runpy
import shutil
import signal
import subprocess
import sys
import zipfile

import pytest

from mushr_ros_intro.classroom import autograders
from mushr_ros_intro.classroom.arguments import parse_arguments
from support.paths import CHECKOUT, PACKAGE


def parse(words):
    """Return the options of grade.py."""
    return vars(parse_arguments(["submission", *words, "--out", "out"], ""))


@pytest.fixture
def make(monkeypatch, capsys):
    """Return a function that runs grade.py --autograder; it returns exit status and output."""
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    main = runpy.run_path(os.path.join(PACKAGE, "src", "grade.py"))["main"]

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["grade.py", "--autograder", "autograder.zip", *arguments])
        try:
            status = main()
        except SystemExit as ended:  # of argparse
            status = ended.code
        return status, "".join(capsys.readouterr())

    return run


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with plans and points, in which programs are started."""
    monkeypatch.chdir(tmp_path)
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
        (["--plans", "open.txt", "--car", "bus"], "car is 'bus'"),
        (["--plans", "open.txt", "--map", "moon"], "moon: no such file"),
        (["--plans", "slalom", "--map", "rooms"], "slalom.txt:5:1: the car hits a wall"),
        (["--plans", "open.txt", "--remap", "a=b"], "found --remap 'a=b'"),
        (["--plans", "open.txt", "--file", "src/a.py"], "found --file 'src/a.py'"),
        (["--plans", "open.txt", "--follow", "wave"], "expected --follow or --plans"),
        ([], "--plans PLAN... or --follow PATH..."),
        (["class", "--plans", "open.txt"], "expected --autograder FILE, and --plans"),
        (["--follow", "missing"], "no such file"),
        (["--follow", "line", "--map", "rooms"], "line.csv: a car on the path hits a wall after "),
        (["--follow", "wave", "--points", "points.yaml"], "unknown key secret"),
    ],
)
def test_fault(make, folder, arguments, reason):
    status, output = make(*arguments)
    assert status == 2 and reason in output.splitlines()[-1], output
    assert (folder / "autograder.zip").read_text() == "an older one"
    assert not [each for each in os.listdir(folder) if each.startswith(".")]


@pytest.mark.parametrize(
    "options, sources, summary, map_name",
    [
        (
            "--plans secret.txt open.txt drawn --secret 7",
            ["secret", "open", "drawn"],
            "3 plans, 1 hidden; 9 points",
            "sandbox",
        ),
        (
            "--plans open.txt --map hall.yaml --car mushr_sim --file a.py",
            ["open"],
            "1 plan, 0 hidden; 3 points",
            "hall",
        ),
        (
            "--follow wave line saw --file controller.py --params config/gains.yaml "
            "--remap __ns:=/car _type:=pid",
            ["wave", "line", "saw"],
            "3 paths, 1 hidden; 9 points",
            "none",
        ),
    ],
)
def test_options_of_grade(make, folder, options, sources, summary, map_name):
    """The autograder gives grade.py the options, and copies of the files."""
    shutil.copy(folder / "open.txt", folder / "secret.txt")
    shutil.copy(f"{CHECKOUT}/maps/rooms.yaml", folder / "hall.yaml")
    shutil.copy(f"{CHECKOUT}/maps/rooms.png", folder)
    hidden = "secret" if "secret" in options else "wave" if "wave" in options else ""
    points = {"plans": {hidden: {"hidden": True}}} if hidden else {}
    check = "cross_track" if "--follow" in options else "path"
    (folder / "points.yaml").write_text(json.dumps({"default": {check: 3}, **points}))
    words = [*options.split(), "--points", "points.yaml"]
    status, output = make(*words)
    assert status == 0, output
    assert summary in output
    with zipfile.ZipFile(folder / "autograder.zip") as archive:
        given = archive.read("arguments").decode().splitlines()
        archive.extractall(folder / "source")
    found = parse(given)
    kind = "plans" if found["plans"] else "follow"
    files = [each.replace(autograders.SOURCE, f"{folder}/source") for each in found.pop(kind)]
    assert [pathlib.Path(each).stem for each in files] == sources
    assert all(os.path.isfile(each) for each in files if each != "drawn")
    assert found.pop("map") == map_name
    map_file = folder / f"source/mushr_ros_intro/maps/{map_name}.yaml"
    assert map_file.exists() == (map_name != "none")
    assert found.pop("points") == f"{autograders.SOURCE}/points.yaml"
    expected = parse(words)
    del found["settings"]
    assert found == {name: expected[name] for name in found}


def test_drawn_plans_alone(make, folder):
    """They are drawn from test_drive, which the zip contains; a secret may look like an option."""
    status, output = make("--plans", "drawn", "--secret=-7")
    assert status == 0, output
    with zipfile.ZipFile(folder / "autograder.zip") as archive:
        archive.extractall(folder / "source")
    words = (folder / "source" / "arguments").read_text().splitlines()
    program = "import sys\nfrom mushr_ros_intro.classroom import arguments, assignment\n"
    program += "found = arguments.parse_arguments(sys.argv[1:], '')\n"
    program += "print(assignment.Plans(found).names, found.secret)"
    python = [sys.executable, "-c", program, "submission", *words, "--out", "out"]
    path = f"{folder}/source/mushr_ros_intro/src:{os.environ['PYTHONPATH']}"
    environment = {**os.environ, "PYTHONPATH": path}
    assert subprocess.check_output(python, env=environment, text=True) == "['drawn'] -7\n"


def test_no_solution(make, folder):
    """The zip contains no node that drives, and the programs that CMakeLists.txt names."""
    assert make("--plans", "open.txt")[0] == 0
    with zipfile.ZipFile(folder / "autograder.zip") as archive:
        files = {each for each in archive.namelist() if not each.endswith("/")}
        build = archive.read("mushr_ros_intro/CMakeLists.txt").decode()
    nodes = {each for each in files if re.fullmatch(r"mushr_ros_intro/src/\w+\.py", each)}
    assert {f"mushr_ros_intro/{each}" for each in re.findall(r"src/\w+\.py", build)} == nodes
    assert nodes == {"mushr_ros_intro/src/grade.py"}
    assert "mushr_ros_intro/urdf/mushr_car.urdf" in files  # a replay reads it
    names = r"path_publisher|listing|examples|test_\w+\.py|/drive/|/authoring/|/browser/"
    assert not [each for each in files if re.search(names, each)]
