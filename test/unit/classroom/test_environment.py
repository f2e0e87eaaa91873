"""Check the table of attacks in docs/grading.md; test/system/test_grade_class.py tries them."""

import glob
import importlib
import os
import pathlib
import re
import socket
import subprocess
import sys

import pytest

from mushr_ros_intro.classroom.attacks import ATTACKS, REPEATED, Targets
from support import classroom
from support.paths import CHECKOUT

CHEATS = {
    "publish the pose of the car": "pose",
    "publish the clock": "clock",
    "publish the output of the mux": "output",
    "drive by another input of the mux": "teleop",
    "place the car again after a command": "again",
    "call a service of the car": "service",
    "offer a service of the car": "offers",
    "change a parameter of the car": "parameter",
    "delete the parameters of the car": "parameters",
    "end the simulated time": "sim_time",
    "use the name of the car": "name",
    "shut down the master": "master",
    "shut down the car": "kill_node",
    "name a wrong publisher to the car": "publisher",
    "signal the grader": "signals",
    "read files, memory, a port; call a service past the master": "reads",
    "write files, leave a process": "writes",
    "fork without end": "fork_bomb",
    "allocate 10 GB": "memory",
    "ignore signals, leave the session": "survivor",
    "print without end": "flood",
    'print "all checks passed"': "says_so",
}
"""The cheats of support/classroom.py, by their names in the documentation."""


FILES = {
    "a zip that writes outside of its folder, or is too large": "test_zips_that_are_not_safe",
    "links out of the submission, devices, pipes": "test_links_and_special_files",
    "an endless folder": "test_large_folder",
    "read plans with commands in CMakeLists.txt": "test_build_sees_no_plan",
    "environment hooks of catkin, modules with the names of those that grade.py imports": (
        "test_hooks_and_modules"
    ),
    "HTML, control characters or formulas in names and output": (
        "test_text_of_a_submission_is_escaped"
    ),
}
"""The tests of attacks on grade.py itself, by their names in the documentation."""


def test_documentation():
    """It names all attacks that are tried, and no others."""
    with open(os.path.join(CHECKOUT, "docs", "grading.md"), encoding="utf-8") as file:
        text = file.read()
    section = text[text.index("### Cheating") : text.index("## Gradescope")]
    rows = re.findall(r"^\| ([^|]+) \|", section, re.MULTILINE)
    assert [each for each in rows if each != "attack"] == [*ATTACKS, *REPEATED, *CHEATS, *FILES]


def test_all_cheats_are_documented():
    misuses, cheats = set(classroom.MISUSES), set(classroom.CHEATS) - {"misuses"}
    assert set(CHEATS.values()) == misuses | cheats


@pytest.mark.parametrize("name", FILES.values())
def test_the_tests_exist(name):
    folders = ("unit/classroom/", "system/test_grade")
    files = (path for each in folders for path in glob.glob(f"{CHECKOUT}/test/{each}*.py"))
    texts = (pathlib.Path(path).read_text(encoding="utf-8") for path in files)
    assert any(f"\ndef {name}(" in text for text in texts)


def test_a_package_that_the_sandbox_has_hidden(tmp_path, monkeypatch):
    """Its folder is there, but empty."""
    (tmp_path / "mushr_ros_intro").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, "mushr_ros_intro")
    find = ATTACKS["read or import the solution"]
    assert find(Targets("", f"{tmp_path}/mushr_ros_intro", 0, 0, "", 0)) == []
    (tmp_path / "mushr_ros_intro" / "__init__.py").touch()
    importlib.invalidate_caches()
    assert find(Targets("", "", 0, 0, "", 0)) == "import mushr_ros_intro"


def test_progress_is_written_line_by_line():
    """No other process writes into a line: each one is a datagram of its own."""
    reader, writer = socket.socketpair(type=socket.SOCK_DGRAM)
    code = "from mushr_ros_intro.classroom.attacks import _report; _report('50 processes')"
    with reader, writer:
        subprocess.run([sys.executable, "-u", "-c", code], stdout=writer, check=True)
        assert reader.recv(100) == b"50 processes\n"
