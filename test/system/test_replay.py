"""Check the verdicts of replays of right and wrong nodes."""

import functools
import os

import pytest

from mushr_ros_intro.replay.judge import CHECK_NAMES
from support.helpers import ForkedProcess, failures_in, master, node, rostest_results
from support.paths import PACKAGE, copy_package

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
PLAN = "1,2,0.5\n1.0,0.1\n2.0,-0.1\n1.5,0.2\n1.0,-0.2\n0.5,0.0\n"


def publisher(node, *arguments):
    """Return the arguments of a replay of a node of test/support/, without a map."""
    return (f"publisher:=support {node}", "map:=none", *arguments)


# Name: the arguments, the failed test cases, the report.
REPLAYS = {
    "remap": (
        publisher("listing.py", f"remap:=_control_topic=/cmd /cmd={CONTROL}"),
        set(),
        "all checks passed\nnote: the node sends no stop at the end",
    ),
    "crash": (
        publisher("wrong_listing.py crash", "position_tolerance:=0.125", "report:=report"),
        {"node", "commands", "final_pose", "path"},
        "FAIL node: the node ended with exit status 1; its last output:",
    ),
    "kill_replay": (
        publisher("wrong_listing.py kill_replay"),
        {"replay"},
        "the replay failed: its process was killed, or has run out of memory",
    ),
}


FULL = ("remap", "kill_replay")
EACH_REPLAY = ["crash", *(pytest.param(each, marks=pytest.mark.full) for each in FULL)]
"""test_grade_class.py grades nodes with other faults, and test_example_course.py a right one."""


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    """Return a function that replays by name, each name once.

    It returns the process and the results. Other files are in its attribute `folder`.
    """
    folder = tmp_path_factory.mktemp("replays")
    (folder / "plan.txt").write_text(PLAN)
    package = copy_package(f"{PACKAGE}/test/support", f"{folder}/support")
    with open(f"{package}/package.xml", "w") as file:
        file.write("<package><name>support</name></package>")
    packages = os.pathsep.join((package, os.environ["ROS_PACKAGE_PATH"]))

    @functools.lru_cache(maxsize=None)
    def run(name):
        arguments = (*REPLAYS[name][0], "plan_file:=plan.txt")
        command = ("mushr_ros_intro", "replay.test", *arguments)
        results = f"{folder}/{name}/mushr_ros_intro/rosunit-replay_*.xml"
        return rostest_results(results, *command, PWD=str(folder), ROS_PACKAGE_PATH=packages)

    run.folder = folder
    return run


@pytest.mark.parametrize("name", EACH_REPLAY)
def test_verdict(replay, name):
    _, failing, verdict = REPLAYS[name]
    process, result = replay(name)
    output = process.output
    cases = failures_in(result)
    assert all(float(case.get("time")) >= 0.0 for case in result.iter("testcase"))  # for rosunit
    failures = {case: text for case, text in cases.items() if text is not None}
    assert set(cases) == ({"replay"} if "replay" in failing else set(CHECK_NAMES)), output
    # On a busy machine a fault can fail more checks.
    assert set(failures) >= failing and bool(failures) == bool(failing), output
    assert (process.wait() == 0) == (not failing), output
    assert verdict in output
    assert "Traceback" not in output or name == "crash"
    if "node" in failing:
        first_pass = output.find("ok  ")
        assert first_pass < 0 or output.index(verdict) < first_pass, f"failures first: {output}"
        assert verdict.split("node: ", 1)[1].split(";")[0] in failures["node"]


def test_a_publisher_that_roslaunch_ignores():
    """With two := the argument does not arrive; no other node may pass in its place."""
    arguments = ("plan_file:=slalom", "publisher:=my_package node.py _loop:=true")
    with ForkedProcess("rostest", "mushr_ros_intro", "replay.test", *arguments) as process:
        assert process.wait() != 0, process.output
    assert "requires the 'publisher' arg to be set" in process.output


def test_without_a_file_for_the_results():
    with master("/test_replay") as (_, proxy):
        arguments = ("_plan_file:=circle", "_publisher:=nowhere nothing.py", "_car:=ideal")
        with node(
            "replay_check.py", *arguments, "_map:=none", ROS_MASTER_URI=proxy.master_uri
        ) as process:
            assert process.wait() == 1, process.output
    assert process.output.startswith("there is no package 'nowhere'"), process.output


def test_last_output(replay):
    """The result contains the output of a crashed node, without invalid characters."""
    output = replay("crash")[1].findtext("system-out")
    assert "IndexError: list index out of range [0m" in output


def test_arguments(replay):
    """The tolerance, and the folder for the report."""
    process, _ = replay("crash")
    assert "tolerances 0.125 m" in process.output
    files = sorted(os.listdir(replay.folder / "report"))
    assert files == ["picture.png", "trajectory.csv"]
