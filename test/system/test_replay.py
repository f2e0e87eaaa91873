"""Check the verdicts of replays of right and wrong nodes."""

import concurrent.futures
import json
import math
import os
import subprocess
import xml.etree.ElementTree as ElementTree

import pytest

PLAN = "1,2,0.5\n1.0,0.1\n2.0,-0.1\n1.5,0.2\n1.0,-0.2\n0.5,0.0\n"

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
LISTING = "mushr_ros_intro listing.py"
WRONG = "mushr_ros_intro wrong_listing.py"

STOPPED = {"node", "commands", "final_pose", "path"}
NEVER_DROVE = STOPPED | {"rate", "rest", "start_pose"}
EVERY_CHECK = NEVER_DROVE | {"collision", "map"}

EXACT = ("position_tolerance:=1e-9", "angle_tolerance:=1e-9", "path_tolerance:=1e-9")
"""[m, rad] Prediction and car differ by the rounding of sums of 1e-16."""
REPORTED = ("report:=report",)
NO_MAP = ("map:=none",)
NO_STOP = "all checks passed\nnote: the node sends no stop at the end"

# Name: the publisher, more arguments, the failed test cases, the report.
REPLAYS = {
    "ours": (
        "mushr_ros_intro path_publisher.py",
        EXACT + REPORTED,
        set(),
        "plan.txt with the car ideal:\nok   node: the node ran without an error\n",
    ),
    "listing": (LISTING, NO_MAP, set(), NO_STOP),
    "remap": (LISTING, NO_MAP + (f"remap:=_control_topic=/cmd /cmd={CONTROL}",), set(), NO_STOP),
    "crash": (
        f"{WRONG} crash",
        NO_MAP,
        STOPPED,
        "FAIL node: the node ended with exit status 1; its last output:",
    ),
    "hang": (
        f"{WRONG} hang",
        NO_MAP + ("patience:=8.0",),
        STOPPED,
        "FAIL node: the node hangs: 20 of 50 commands arrived, and then none for 8 s",
    ),
    "hold_up": (f"{WRONG} hold_up", NO_MAP, set(), NO_STOP),
    "kill_car": (
        f"{WRONG} kill_car",
        NO_MAP + ("patience:=8.0",),
        {"replay"},
        "the replay failed: the simulated car /car/car_sim has died, so the node is not judged",
    ),
    "silent": (
        f"{WRONG} silent",
        NO_MAP + ("patience:=8.0",),
        NEVER_DROVE,
        f"FAIL node: the node runs, but published no command on {CONTROL} for 8 s; it publishes ",
    ),
}


def rostest(folder, name, *arguments):
    """Run a replay; return its exit status, its result and its output."""
    done = subprocess.run(
        ["rostest", "mushr_ros_intro", "replay.test", f"result:={name}", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "ROS_TEST_RESULTS_DIR": str(folder), "PWD": str(folder)},
        timeout=120.0,
    )
    output = done.stdout.decode(errors="replace")
    path = os.path.join(str(folder), "mushr_ros_intro", f"rosunit-replay_{name}.xml")
    assert os.path.exists(path), output
    return done.returncode, ElementTree.parse(path).getroot(), output


@pytest.fixture(scope="module")
def replays(tmp_path_factory):
    """Run every replay, several at a time."""
    folder = tmp_path_factory.mktemp("replays")
    (folder / "plan.txt").write_text(PLAN)

    def run(name):
        publisher, arguments, _, _ = REPLAYS[name]
        return rostest(folder, name, "plan_file:=plan.txt", f"publisher:={publisher}", *arguments)

    with concurrent.futures.ThreadPoolExecutor(5) as pool:
        return folder, dict(zip(REPLAYS, pool.map(run, REPLAYS)))


@pytest.mark.parametrize("name", REPLAYS)
def test_verdict(replays, name):
    _, results = replays
    _, _, failing, verdict = REPLAYS[name]
    status, result, output = results[name]
    failures = {
        case.get("name"): case.find("failure").text
        for case in result.iter("testcase")
        if case.find("failure") is not None
    }
    cases = {case.get("name") for case in result.iter("testcase")}
    assert cases == ({"replay"} if "replay" in failing else EVERY_CHECK)
    # On a busy machine a fault can fail more checks.
    assert set(failures) >= failing and bool(failures) == bool(failing), failures
    assert (status == 0) == (not failing), output
    assert verdict in output  # the student sees it on the terminal
    assert "Traceback" not in output or name == "crash"
    if "node" in failing:
        first_pass = output.find("ok  ")
        assert first_pass < 0 or output.index(verdict) < first_pass, "failures come first"
        assert verdict.split("node: ", 1)[1].split(";")[0] in failures["node"]


def test_a_publisher_that_roslaunch_ignores(tmp_path):
    """With two := the argument does not arrive; no other node may pass in its place."""
    done = subprocess.run(
        ["rostest", "mushr_ros_intro", "replay.test", f"publisher:={LISTING} _loop:=true"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "ROS_TEST_RESULTS_DIR": str(tmp_path)},
        timeout=120.0,
        check=False,
    )
    assert done.returncode != 0
    assert b"requires the 'publisher' arg to be set" in done.stdout


def test_last_output(replays):
    """The output of a node that crashes is quoted without the characters that XML cannot hold."""
    output = replays[1]["crash"][1].findtext("system-out")
    assert "IndexError: list index out of range [0m" in output


def test_files(replays):
    folder = replays[0] / "report"
    for name in ("locations.png", "distances.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG"), name
    said = json.loads((folder / "report.json").read_text())
    assert said["passed"] and said["verdict"][-1] == "all checks passed"
    messages = {check["name"]: check["message"] for check in said["checks"]}
    assert set(messages) == EVERY_CHECK
    assert messages["map"] == "the car stayed on the map of 100 m x 100 m"
    lines = (folder / "trajectory.csv").read_text().splitlines()
    assert lines[0].startswith("time,x,y,theta,predicted_x")
    rows = [tuple(map(float, line.split(","))) for line in lines[1:]]
    assert rows[0][:4] == pytest.approx((0.0, 1.0, 2.0, 0.5), abs=1e-9)
    assert rows[-1][1:4] == pytest.approx(tuple(said["final_pose"].values()), abs=0.0)
    assert [row[0] for row in rows] == pytest.approx([0.02 * i for i in range(251)], abs=1e-9)
    for _, x, y, _, _, _, _, away in rows:
        assert away == pytest.approx(math.hypot(x - 1.0, y - 2.0), abs=1e-9)
