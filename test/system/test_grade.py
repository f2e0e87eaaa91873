"""Grade a class with right, wrong, broken and dishonest submissions."""

import contextlib
import csv
import glob
import importlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from xml.etree import ElementTree

import pytest
import rosbag
from roslib.packages import find_node

from support import classroom as submissions
from support.helpers import ForkedProcess, Process, wait_for
from support.paths import PACKAGE

PLAN = "0,0,0.5\n1.0,0.1\n2.0,-0.1\n1.5,0.2\n1.0,-0.2\n"
RIGHT = ("right", "spins", "no_stamps", "places_twice")
WRONG = ("sign", "crashes", "hangs", "five_hz", "frame")
_PROBE = ("bwrap", "--unshare-user", "--unshare-pid", "--bind", "/", "/", "--proc", "/proc", "true")
ISOLATED = pytest.mark.skipif(
    subprocess.run(_PROBE, stderr=subprocess.DEVNULL).returncode != 0,
    reason="this system refuses namespaces, so that grade.py cannot isolate nodes",
)
AS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount, or rename a machine")

_FILTER = """
import os, sys
from mushr_ros_intro.isolation.system_calls import make_filter
make_filter().load()
os.execvp(sys.argv[1], sys.argv[1:])
"""
WITHOUT_NAMESPACES = ("/usr/bin/python3", "-c", _FILTER)
"""Runs a command as in a container whose filter of system calls forbids namespaces."""


def grade(*arguments, prefix=(), **environment):
    """Run grade.py, in a fork if there is no prefix; return its exit status and its output."""
    command = (*prefix, find_node("mushr_ros_intro", "grade.py")[0], *arguments)
    kind = Process if prefix else ForkedProcess
    with kind(*map(str, command), **environment) as process:
        return process.wait(300), process.output


def assert_status(expected, *arguments, **options):
    """Run grade.py, and check its exit status; return its output."""
    status, output = grade(*arguments, **options)
    assert status == expected, output + verdicts(arguments)
    return output


def verdicts(arguments):
    """Return the results in the folder after --out."""
    folder = dict(zip(arguments, arguments[1:])).get("--out", "")
    texts = []
    for path in sorted(glob.glob(f"{folder}/data/*.json")):
        texts.append(verdicts_of(load(path)))
    return "\n".join(texts)


def load(path):
    """Return a stored result, with the verdicts on its drives as `plans`."""
    with open(path) as file:
        result = json.load(file)
    return {**result, "plans": [each["grade"] for each in result["drives"].values()]}


def verdicts_of(result):
    """Return a result as text: why there is no verdict, or the verdict on each plan."""
    reasons = (result["name"], result["fault"], result["error"])
    return "\n".join((*reasons, *(plan["verdict"] for plan in result["plans"])))


@pytest.fixture(scope="module")
def server():
    """Return the port of a server on the loopback interface."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield listening.getsockname()[1]


@pytest.fixture(scope="module")
def graded(server, tmp_path_factory):
    """Grade a class; return the exit status, the output and the folder of the results."""
    return grade_class(tmp_path_factory.mktemp("course"), server)


def grade_class(folder, server):
    """Grade a class in a folder; return the exit status, the output and the folder of results."""
    classroom = folder / "submissions"
    (folder / "open.txt").write_text(PLAN)
    (folder / "writable.json").touch()
    (folder / "writable.json").chmod(0o666)  # so that only the sandbox protects it
    for name in RIGHT:
        submissions.write(classroom, name, submissions.CORRECT[name])
    for name in WRONG:
        submissions.write(classroom, name, submissions.WRONG[name][0])
    for name, (source, _) in submissions.BROKEN.items():
        submissions.write(classroom, name, source)
    for name in submissions.CHEATS:
        submissions.write(classroom, f"cheat_{name}", submissions.cheat(name, server, folder))
    out = folder / "results"
    out.mkdir()  # readable for all users, so that only the sandbox hides it
    arguments = (classroom, "--plans", folder / "open.txt", "--out", out, "--timeout", 5)
    return *grade(*arguments), out


def result_of(graded, name):
    path = graded[2] / "data" / f"{name}.json"
    assert path.exists(), graded[1]
    return load(path)


def failed_checks(result):
    assert len(result["plans"]) == 1, verdicts_of(result)
    (plan,) = result["plans"]
    return {check["name"]: check["message"] for check in plan["checks"] if not check["passed"]}


@ISOLATED
@pytest.mark.parametrize("name", RIGHT)
def test_right(graded, name):
    result = result_of(graded, name)
    assert failed_checks(result) == {}, verdicts_of(result)


@ISOLATED
@pytest.mark.parametrize("name", WRONG)
def test_wrong(graded, name):
    result = result_of(graded, name)
    assert submissions.WRONG[name][1] in failed_checks(result), verdicts_of(result)
    if name == "frame":
        note = "note: the car ignored a message on /initialpose: pose is in the frame 'odom'"
        assert note in result["plans"][0]["verdict"]


@ISOLATED
@pytest.mark.parametrize("name", submissions.BROKEN)
def test_broken(graded, name):
    result = result_of(graded, name)
    assert submissions.BROKEN[name][1] in result["fault"], verdicts_of(result)
    assert not result["plans"]


@ISOLATED
@pytest.mark.parametrize("name", submissions.CHEATS)
def test_cheat(graded, name):
    """The cheat fails, and either its message names the action, or it had no effect."""
    result = result_of(graded, f"cheat_{name}")
    (plan,) = result["plans"]
    assert failed_checks(result), plan["verdict"]
    assert submissions.CHEATS[name][1] in plan["verdict"]
    if name != "says_so":
        assert "ended without publishing" not in plan["verdict"]


@ISOLATED
@pytest.mark.parametrize("name", submissions.MISUSES)
def test_misuse(graded, name):
    message = failed_checks(result_of(graded, "cheat_misuses"))["topics"]
    assert f"{submissions.MISUSES[name][1]}, " in message.replace("; expected", ", ")


@ISOLATED
def test_nothing_is_left(graded):
    """No process of a submission survives, and no file outside of its own folders is written."""
    for path in glob.glob("/proc/[0-9]*/cmdline"):
        with contextlib.suppress(OSError), open(path, "rb") as file:  # it has ended
            assert b"/cheat_survivor" not in file.read()
    assert (graded[2].parent / "writable.json").read_text() == ""
    for folder in ("/tmp", "/var/tmp", "/dev/shm", "/mnt", "/run", "/"):
        assert not os.path.exists(f"{folder}/fill0"), folder


@ISOLATED
def test_files(graded):
    status, output, out = graded
    assert status == 1, output
    with open(out / "grades.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    count = len(RIGHT) + len(WRONG) + len(submissions.BROKEN) + len(submissions.CHEATS)
    assert len(rows) == count
    assert {row["Name"] for row in rows if row["Passed"] == "yes"} == set(RIGHT)
    assert f"{len(RIGHT)} of {count} submissions passed" in output
    suites = ElementTree.parse(out / "results.xml").getroot().findall("testsuite")
    assert len(suites) == count
    index = (out / "index.html").read_text()
    assert index.count("<img") >= count - len(submissions.BROKEN)


AS_USER = ("setpriv", "--reuid", "1000", "--regid", "1000", "--clear-groups") * (os.geteuid() == 0)


def check_environment(status, prefix):
    """Run --check-environment, and check its exit status; return its output."""
    with tempfile.TemporaryDirectory(dir="/tmp") as home:
        os.chmod(home, 0o777)
        arguments = {"prefix": prefix, "HOME": home, "TMPDIR": home}
        return assert_status(status, "--check-environment", **arguments)


@ISOLATED
def test_environment():
    """A user without root is isolated. What is said to be stopped has been tried."""
    assert "20 of 20 attacks stopped" in check_environment(0, AS_USER)


@ISOLATED
@pytest.mark.full
def test_environment_of_root():
    assert "20 of 20 attacks stopped" in check_environment(0, ())


@pytest.mark.full
def test_environment_without_namespaces():
    output = check_environment(1, WITHOUT_NAMESPACES)
    assert "isolated: the system refuses namespaces" in output
    assert "NOT STOPPED  reach the network of the machine: " in output


GENERATES = """
find_package(catkin REQUIRED COMPONENTS ackermann_msgs)
if(NOT EXISTS ${ackermann_msgs_INSTALL_PREFIX}/share AND NOT ackermann_msgs_SOURCE_PREFIX)
  message(FATAL_ERROR "ackermann_msgs is not there")
endif()
file(WRITE ${CATKIN_DEVEL_PREFIX}/lib/python3/dist-packages/generated.py "ANSWER = 42\\n")
"""


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Grade a zip and two packages that have to be built, in two parts; return their folder.

    The users of the nodes of the first part, which are not isolated, cannot reach the folder.
    """
    folder = tmp_path_factory.mktemp("parts")
    package = submissions.write(folder, "zipped", submissions.RIGHT)
    shutil.make_archive(str(folder / "class" / "zipped"), "zip", package)
    uses = submissions.before("import generated\nassert generated.ANSWER == 42")
    submissions.write(folder / "class", "builds", uses, cmake=GENERATES)
    sees = f'if(EXISTS "{folder}/plan.txt")\n  message("sees the plan")\nendif()\n'
    fails = f"{sees}add_custom_target(broken ALL COMMAND false)\n"
    submissions.write(folder / "class", "cannot_build", submissions.RIGHT, cmake=fails)
    (folder / "plan.txt").write_text(PLAN)
    (folder / "points.yaml").write_text("default: {path: 3, rest: 1}\n")
    (folder / "private").mkdir(0o700)
    plan = ("--plans", folder / "plan.txt", "--points", folder / "points.yaml")
    command = (folder / "class", *plan, "--shard")
    first = (*command, "1/2", "--out", folder / "1", "--bag")
    assert_status(0, *first, prefix=WITHOUT_NAMESPACES, TMPDIR=str(folder / "private"))
    assert_status(1, *command, "2/2", "--out", folder / "2")
    return folder


def test_merge(parts):
    command = ("--merge", parts / "1", parts / "2", "--points", parts / "points.yaml")
    output = assert_status(1, *command, "--out", parts / "all")
    assert "2 of 3 submissions passed" in output
    with open(parts / "all" / "grades.csv", newline="") as file:
        rows = {row["Name"]: row for row in csv.DictReader(file)}
    assert {name: row["Score"] for name, row in rows.items()} == {
        "builds": "4",
        "cannot_build": "0",
        "zipped": "4",
    }
    assert "the package does not build" in rows["cannot_build"]["Error/Fault"]


@ISOLATED
def test_build_sees_no_plan(parts):
    fault = load(parts / "2" / "data" / "cannot_build.json")["fault"]
    assert "does not build" in fault and "sees the plan" not in fault


def test_bag(parts):
    with rosbag.Bag(str(parts / "1" / "bags" / "builds.plan.bag")) as bag:
        counts = {
            name: info.message_count for name, info in bag.get_type_and_topic_info()[1].items()
        }
    assert counts["/car/mux/ackermann_cmd_mux/input/navigation"] == 41
    assert counts["/car/car_pose"] > 200
    assert counts["/car/driven_path"] == counts["/car/predicted_path"] == 1


@pytest.mark.full
def test_interrupted(tmp_path):
    """Ctrl-C keeps what is graded; then the same command grades the rest."""
    submissions.write(tmp_path / "class", "right", submissions.RIGHT)
    submissions.write(tmp_path / "class", "silent", submissions.WRONG["silent"][0])
    (tmp_path / "plan.txt").write_text(PLAN)
    plan = ("--plans", tmp_path / "plan.txt", "--out", tmp_path / "out", "--timeout", 8)
    command = (find_node("mushr_ros_intro", "grade.py")[0], tmp_path / "class", *plan)
    with Process(*map(str, command)) as process:
        wait_for(lambda: "right " in process.output, "the first result")
        process.send_signal(signal.SIGINT)
        assert process.wait() == 3, process.output
        assert "interrupted: 1 of 2 submissions graded; the same command" in process.output
    assert "? not graded" in (tmp_path / "out" / "submissions" / "silent.html").read_text()
    output = assert_status(1, tmp_path / "class", *plan)
    assert "1 result is unchanged" in output and "silent " in output


def test_noise():
    """A correct node passes with any seed: the noise is predicted, too."""
    node = ("--node", "mushr_ros_intro", "path_publisher.py", "--car", "mushr_nano")
    output = assert_status(0, "straight_line", *node, "--seed", 1)
    assert "all checks passed" in output


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


def test_empty_part(parts, tmp_path):
    """A part without a submission is no failure."""
    plan = ("--plans", parts / "plan.txt", "--out", tmp_path)
    assert_status(0, parts / "class" / "zipped.zip", *plan, "--shard", "2/2")


def test_gradescope(parts, tmp_path):
    path = tmp_path / "results.json"
    command = (parts / "zipped", "--plans", parts / "plan.txt", "--out", tmp_path)
    assert_status(0, *command, "--gradescope", path)
    assert sum(test["score"] for test in json.loads(path.read_text())["tests"]) == 9


@AS_ROOT
def test_no_node_can_run(parts, tmp_path):
    """If a fault of the machine would make each submission fail, grade.py judges none."""
    folders = ("/tmp", "/var/tmp")
    mount = " && ".join(f"mount -t tmpfs -o noexec tmpfs {folder}" for folder in folders)
    command = ("unshare", "--mount", "sh", "-c", f'{mount} && exec "$@"', "sh", *WITHOUT_NAMESPACES)
    with tempfile.TemporaryDirectory(dir="/var/lib") as name:
        package = submissions.write(name, "right", submissions.RIGHT)
        plan = shutil.copy(parts / "plan.txt", name)
        arguments = (package, "--plans", plan, "--out", f"{name}/out")
        output = assert_status(3, *arguments, prefix=command, TMPDIR="/tmp")
        assert os.listdir(f"{name}/out") == ["data"]
    assert "nodes cannot run here, so nothing is graded: " in output
    assert "Permission denied" in output and "Set TMPDIR to a folder" in output


@AS_ROOT
def test_the_name_of_the_machine_does_not_resolve():
    """Debian's packages set no ROS_HOSTNAME."""
    rename = "echo nowhere >/proc/sys/kernel/hostname"
    command = "env -u ROS_HOSTNAME -u LD_PRELOAD rosrun mushr_ros_intro grade.py"
    arguments = "circle --node mushr_ros_intro path_publisher.py"
    script = f"{rename} && exec {command} {arguments}"
    with Process("unshare", "--uts", "sh", "-c", script) as process:
        assert process.wait() == 0, process.output


NODE = ("--node", "mushr_ros_intro", "path_publisher.py")


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("figure_8", *NODE, "--remap", "control"), 2, "expected --remap FROM:=TO"),
        (("figure_9", *NODE), 2, "did you mean figure_8?"),
        (
            ("figure_8", "--node", "mushr_ros_intro", "nothing.py"),
            2,
            "there is no node 'nothing.py'",
        ),
        (
            ("figure_8", "--node", "mushr_ros_intro", "path_publisher"),
            2,
            "no node 'path_publisher' in the package 'mushr_ros_intro'; did you mean path_publ",
        ),
        (
            ("figure_8", "--node", "mushr_ros_into", "path_publisher.py"),
            2,
            "; did you mean mushr_ros_intro? Is its workspace sourced",
        ),
        (("figure_8", *NODE, "--seed", "-1"), 2, "car ideal: seed is -1; expected"),
        (("figure_8", *NODE, "--points", "p.yaml"), 2, "--points needs submissions"),
        (
            ("figure_8", *NODE, "--path-tolerance", "nan"),
            2,
            "--path-tolerance: 'nan'; expected a number of at least 0",
        ),
        (("figure_8",), 2, "expected PLAN... --node PACKAGE FILE, or"),
        (("figure_8", *NODE, "--car", "fiat"), 2, "car is 'fiat'; expected one of ideal"),
        (("--merge", "/nowhere", "--out", "/nowhere"), 2, "/nowhere: not the output of grade.py"),
        (("/nowhere", "--plans", "figure_8", "--out", "/proc/x"), 3, "/proc/x"),
        (("/nowhere", "--out", "out"), 2, "or SUBMISSION... --plans PLAN... --out FOLDER"),
        ((PACKAGE, "--plans", "figure_8", "--out", "/tmp/x", "--shard", "3/2"), 2, "expected I/N"),
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
