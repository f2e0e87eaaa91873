"""Run an autograder as Gradescope does: as root, in its folders.

If debootstrap is installed, its root file system is a bare one of this release in which setup.sh
has installed the packages; it is kept in build/.bare. Otherwise it is a copy-on-write view of this
machine, so nothing is installed. BARE_RELEASE names another release, such as
"jammy http://archive.ubuntu.com/ubuntu"; if it is empty, the view is used.
"""

import json
import os
import shutil
import subprocess

import pytest

from support import classroom as submissions
from support import gradescope
from support.controllers import CONTROLLERS
from support.paths import CHECKOUT
from support.scripts import needs_workspace

PLAN = "0,0,0.5\n1.0,0.1\n-2.0,-0.1\n"
SECRET = "0,0,0.5\n1.0,0.1\n0.8125,0.0625\n"
POINTS = "default: {node: 1, path: 2}\nplans: {secret: {node: 1, path: 4, hidden: true}}\n"
SPY = submissions.before(
    """
    import os
    for folder in ("", "/source", "/source/plans", "/results"):
        folder = "/autograder" + folder
        names = ("arguments", "points.yaml", "secret.txt", "results.json")
        for name in (*names, "submission_metadata.json"):
            try:
                print(open(os.path.join(folder, name)).read(), flush=True)
                open(os.path.join(folder, name), "a").close()
            except OSError:
                pass
    os._exit(4 if os.access("/opt/mushr_ros_intro", os.R_OK) else 3)
    """
)
ALL = {"open: node": 1, "open: path": 2, "secret: node": 1, "secret: path": 4}
"""The points of the checks that give some."""

pytestmark = [pytest.mark.full, needs_workspace]


def release():
    """Return the name of this release, such as bookworm; "" if debootstrap is not installed."""
    if not shutil.which("debootstrap"):
        return ""
    with open("/etc/os-release") as file:
        return dict(line.rstrip().split("=", 1) for line in file)["VERSION_CODENAME"]


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """Make an autograder, and grade; return the contents of results.json by submission."""
    folder, given = tmp_path_factory.mktemp("course"), tmp_path_factory.mktemp("given")
    arguments = ("--plans", "secret.txt", "open.txt", "--points", "points.yaml")
    for name, text in (("open.txt", PLAN), ("secret.txt", SECRET), ("points.yaml", POINTS)):
        (folder / name).write_text(text)

    right, wrong = submissions.RIGHT, submissions.WRONG["sign"][0]
    silent = submissions.WRONG["silent"][0]
    nodes = {"right": right, "wrong": wrong, "spy": SPY, "slow": silent, "unset": right}
    for name, source in {**nodes, "uploaded": right, "broken": "print("}.items():
        submissions.write(given, name, source)
    (given / "uploaded" / "src" / "path_publisher.py").chmod(0o644)
    (given / "files").mkdir()
    for name, source in (("path_publisher.py", right), ("helper.py", "")):
        (given / "files" / name).write_text(source)
    (given / "nothing").mkdir()
    return grade(folder, arguments, given, tmp_path_factory.mktemp("machine"))


def grade(folder, arguments, given, machine):
    """Make an autograder in a folder, and grade what is given; return results.json by name."""
    make = (f"{CHECKOUT}/scripts/grade", "--autograder", "autograder.zip", *arguments)
    subprocess.run(make, cwd=folder, check=True)
    gradescope.unpack(folder / "autograder.zip", folder / "source")
    bare = os.environ.get("BARE_RELEASE", release())
    found, log = gradescope.run(folder / "source", given, machine, bare)
    print(log)
    return found


def scores(report):
    """Return the scores of the checks of a report by their names, without those of 0 points."""
    tests = [test for test in report["tests"] if test["max_score"]]
    return {test["name"].replace(" (not judged)", ""): test["score"] for test in tests}


def text_of(report):
    """Return all of a report as text."""
    return json.dumps(report, indent=1).replace("\\n", "\n")


def test_fields(reports):
    for name, report in reports.items():
        gradescope.check_fields(report, gradescope.REPORT)
        assert ("tests" in report or "score" in report) != (name == "unset"), text_of(report)
        tests = report.get("tests", [])
        for test in tests:
            gradescope.check_fields(test, gradescope.TEST)
            assert 0 <= test["score"] <= test["max_score"]
            hidden = test["name"].startswith("secret")
            assert test["visibility"] == ("after_published" if hidden else "visible")
        assert not tests or sum(test["max_score"] for test in tests) == sum(ALL.values()), name


@pytest.mark.parametrize("name", ["right", "files", "uploaded"])
def test_right(reports, name):
    assert scores(reports[name]) == ALL, text_of(reports[name])


def test_wrong(reports):
    for name in ("wrong", "spy"):
        assert scores(reports[name]) == dict.fromkeys(ALL, 0), text_of(reports[name])


@pytest.mark.parametrize(
    "name, reason", [("broken", "#!"), ("nothing", "path_publisher.py"), ("slow", "more than 1 s")]
)
def test_not_graded(reports, name, reason):
    report = reports[name]
    texts = [report["output"], *(test["output"] for test in report.get("tests", []))]
    assert any(reason in text for text in texts), text_of(report)
    assert report.get("score", 0) == 0, text_of(report)
    assert not any(scores({"tests": [], **report}).values()), text_of(report)


def test_hidden_plan(reports):
    """What students see names no number of the hidden plan, nor the plan."""
    for name, report in reports.items():
        shown = [test for test in report.get("tests", []) if test["visibility"] == "visible"]
        text = json.dumps({**report, "tests": shown})
        for secret in ("0.8125", "0.0625", "secret", "ann@x.edu"):
            assert secret not in text, name
        assert "score" in report or name == "unset" or shown
    assert "exit status 3" in reports["spy"]["tests"][0]["output"], text_of(reports["spy"])


def test_controllers(tmp_path):
    """Controllers follow paths, with parameters."""
    course, given, machine = (tmp_path / name for name in ("course", "given", "machine"))
    for each in (course, given, machine):
        each.mkdir()
    points = "default: {cross_track: 4, topics: 1}\ntolerances: {cross_track: 0.2}"
    (course / "points.yaml").write_text(points)
    for name, gains in (("right", "gain: 1.0"), ("wrong", "gain: -1.0")):
        (given / name).mkdir()
        shutil.copy(f"{CONTROLLERS}/pursuit.py", given / name)
        shutil.copy(f"{CONTROLLERS}/loop.py", given / name / "controller.py")
        (given / name / "gains.yaml").write_text(gains)
    options = "--follow wave --file controller.py --params gains.yaml"
    options += " --points points.yaml"
    reports = grade(course, options.split(), given, machine)
    right, wrong = (scores(reports[name]) for name in ("right", "wrong"))
    assert right["wave: cross_track"] == 4.0, text_of(reports["right"])
    assert wrong["wave: cross_track"] == 0.0 < right["wave: topics"], text_of(reports["wrong"])
