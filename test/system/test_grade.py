"""Grade a class with right, wrong, broken and dishonest submissions."""

import contextlib
import csv
import glob
import json
import os
import socket
import subprocess
from xml.etree import ElementTree

import pytest

from support import classroom as submissions
from support.helpers import Process

PLAN = "0,0,0.5\n1.0,0.1\n2.0,-0.1\n1.5,0.2\n1.0,-0.2\n"
RIGHT = ("right", "spins", "no_stamps")
WRONG = ("sign", "crashes", "hangs", "five_hz")
USERS = range(60_000, 65_000)
"""The users of isolated nodes."""

_PROBE = ("unshare", "--net", "--mount", "--pid", "--fork", "--mount-proc", "true")
ISOLATED = pytest.mark.skipif(
    os.geteuid() != 0 or subprocess.run(_PROBE, stderr=subprocess.DEVNULL).returncode != 0,
    reason="this system refuses namespaces, so that grade.py cannot isolate nodes",
)


def grade(*arguments):
    """Run grade.py; return its exit status and its output."""
    with Process("rosrun", "mushr_ros_intro", "grade.py", *map(str, arguments)) as process:
        return process.wait(300), process.output


@pytest.fixture(scope="module")
def server():
    """Return the port of a server on the loopback interface."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]


@pytest.fixture(scope="module")
def graded(tmp_path_factory, server):
    """Grade a class; return the exit status, the output and the folder of the results."""
    folder = tmp_path_factory.mktemp("class")
    classroom, plans = folder / "submissions", folder / "hidden"
    plans.mkdir()
    (plans / "open.txt").write_text(PLAN)
    (plans / "secret.txt").write_text(PLAN)
    for name in RIGHT:
        submissions.write(classroom, name, submissions.CORRECT[name])
    for name in WRONG:
        submissions.write(classroom, name, submissions.WRONG[name][0])
    for name, (source, _) in submissions.BROKEN.items():
        submissions.write(classroom, name, source)
    for name in submissions.CHEATS:
        submissions.write(classroom, f"cheat_{name}", submissions.cheat(name, server))
    out = folder / "results"
    status, output = grade(classroom, "--plans", plans / "open.txt", "--out", out, "--patience", 5)
    return status, output, out


def result_of(graded, name):
    return json.loads((graded[2] / "data" / f"{name}.json").read_text())


def failed_checks(result):
    (plan,) = result["plans"]
    return {check["name"]: check["message"] for check in plan["checks"] if not check["passed"]}


@ISOLATED
@pytest.mark.parametrize("name", RIGHT)
def test_right(graded, name):
    assert failed_checks(result_of(graded, name)) == {}


@ISOLATED
@pytest.mark.parametrize("name", WRONG)
def test_wrong(graded, name):
    assert submissions.WRONG[name][1] in failed_checks(result_of(graded, name))


@ISOLATED
@pytest.mark.parametrize("name", submissions.BROKEN)
def test_broken(graded, name):
    result = result_of(graded, name)
    assert submissions.BROKEN[name][1] in result["fault"]
    assert not result["plans"]


@ISOLATED
@pytest.mark.parametrize("name", submissions.CHEATS)
def test_cheat(graded, name):
    """The cheat fails, and either its message names the action, or it had no effect."""
    result = result_of(graded, f"cheat_{name}")
    (plan,) = result["plans"]
    assert failed_checks(result)
    assert submissions.CHEATS[name][1] in plan["verdict"]
    if name != "says_so":
        assert "ended without publishing" not in plan["verdict"]


@ISOLATED
def test_nothing_is_left(graded):
    """No process of a submission survives, and no file outside of its own folders is written."""
    owners = set()
    for path in glob.glob("/proc/[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended
            owners.add(os.stat(path).st_uid)
    assert owners.isdisjoint(USERS)
    for folder in ("/tmp", "/var/tmp", "/dev/shm", "/mnt", "/run", "/"):
        assert not os.path.exists(f"{folder}/fill0"), folder


@ISOLATED
def test_files(graded):
    status, output, out = graded
    assert status == 1
    with open(out / "grades.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    count = len(RIGHT) + len(WRONG) + len(submissions.BROKEN) + len(submissions.CHEATS)
    assert len(rows) == count
    assert {row["Name"] for row in rows if row["Passed"] == "yes"} == set(RIGHT)
    assert f"{len(RIGHT)} of {count} submissions passed" in output
    suites = ElementTree.parse(out / "results.xml").getroot().findall("testsuite")
    assert len(suites) == count
    index = (out / "index.html").read_text()
    assert index.count("<svg") >= count - len(submissions.BROKEN)
