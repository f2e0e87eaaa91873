"""Work besides the replays of a class: build a submission, try the sandbox, judge a drive."""

import os
import subprocess
import tempfile
from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.isolation.node_process import SHOWN_LINES
from mushr_ros_intro.isolation.sandbox import LIMITS, Sandbox
from mushr_ros_intro.isolation.workspace import environment_of
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.replay.following import judge_drive, miss_of
from mushr_ros_intro.replay.job import MAX_OVERHEAD, MAX_SLOWDOWN, Job, Setting, sandboxed
from mushr_ros_intro.replay.judge import Judgement
from mushr_ros_intro.replay.own_process import ReplayError, in_own_process
from mushr_ros_intro.replay.recording import Drive, Recorded, matched
from mushr_ros_intro.replay.reference import Exercise, lengths
from mushr_ros_intro.stamps import COMMAND_PERIOD

TIMEOUT = MAX_SLOWDOWN * LIMITS["--cpu"]
"""For the build of one submission, and for the probe [s of wall-clock time].

A process that computes for ever ends before, by its limit.
"""

MAX_POINTS = 500
"""Limit of the number of points of a path in a picture."""

_PROBE = """#!/usr/bin/python3
import os, sys
import ackermann_msgs.msg, geometry_msgs.msg, rospy
for path in (__file__, sys.argv[-1].split(":=")[1]):
    open(path).close()
open(os.path.join(os.environ["HOME"], "probe"), "w").close()
"""


def probe(plan: Exercise, setting: Setting) -> None:
    """Check that a node of a submission can run in the sandbox, and read and write its files.

    Raises:
        ReplayError: it cannot, so a failure of a submission would not be its own fault.
    """
    folder = os.path.join(setting.sandbox.folder, ".probe")
    path = os.path.join(folder, "path_publisher.py")
    os.mkdir(folder)
    os.chmod(folder, 0o755)
    with open(path, "w", encoding="ascii") as file:
        file.write(_PROBE)
    os.chmod(path, 0o755)
    job = Job("probe", (path,), plan, setting, folder)
    fault = in_own_process(_probe_here, job, seconds=TIMEOUT + MAX_OVERHEAD)
    if fault:
        user = "users without a name" if setting.sandbox.is_root else "you"
        raise ReplayError(
            f"nodes cannot run here, so nothing is graded: {fault}\n"
            f"Nodes run as {user} in {setting.sandbox.folder}, and use a copy of the workspaces. "
            "Set TMPDIR to a folder that all users can enter, and in which programs can run. Make "
            "the files in the workspaces readable for all users: chmod -R a+rX FOLDER"
        )


def _probe_here(job: Job) -> str:
    """Run the probe in this process; return the last line of its output if it fails, or ""."""
    sandbox = job.setting.sandbox
    with tempfile.TemporaryDirectory(dir=sandbox.folder) as folder:
        status, lines = _run(sandbox, sandboxed(job, folder))
    return "" if status == 0 else (["it printed nothing", *lines][-1])


def _run(sandbox: Sandbox, command: Sequence[str]) -> Tuple[Optional[int], List[str]]:
    """Run a command that the sandbox has wrapped.

    Returns:
        Its exit status, or None if it did not end in time, and the lines of its output.
    """
    sandbox.enter()
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=TIMEOUT,
            check=False,
        )
        return done.returncode, done.stdout.decode(errors="replace").splitlines()
    except subprocess.TimeoutExpired:
        return None, [f"it did not end within {TIMEOUT:g} s"]
    finally:
        sandbox.end_processes()


def build(submission: Submission, setting: Setting) -> str:
    """Build the package of a submission if necessary; return why it fails, "" if it does not.

    Raises:
        ReplayError: it did not end, perhaps because the machine is busy.
    """
    if submission.fault or not submission.needs_build:
        return ""
    seconds = TIMEOUT + MAX_OVERHEAD
    return in_own_process(_build_here, submission, setting, seconds=seconds)


def _build_here(submission: Submission, setting: Setting) -> str:
    """Build the package of a submission in this process; return and raise as `build`."""
    package = submission.packages[0]
    build = os.path.join(package, ".build")
    os.mkdir(build)
    os.chmod(build, 0o777)
    script = (
        'cmake -S "$1" -B "$1/.build" -DCATKIN_DEVEL_PREFIX="$1/.build/devel" '
        "-DPYTHON_EXECUTABLE=/usr/bin/python3 -DCATKIN_ENABLE_TESTING=OFF "
        '&& make -C "$1/.build"'
    )
    with tempfile.TemporaryDirectory(dir=setting.sandbox.folder) as home:
        os.chmod(home, 0o777)
        command = setting.sandbox.wrap(
            ["sh", "-c", script, "sh", package],
            environment_of(setting.ros, submission.packages),
            home,
            folder=submission.folder,
            writable=True,
        )
        status, lines = _run(setting.sandbox, command)
    os.chmod(build, 0o755)
    if status == 0:
        return ""
    if status is None:
        raise ReplayError(f"the build of the package did not end within {TIMEOUT:g} s")
    last = len(lines) - 1  # "Killed" if it has computed for too long
    first = next((number for number, line in enumerate(lines) if "rror" in line), last)
    error = " ".join(line.strip() for line in lines[first : first + 2])  # CMake's have two lines
    return "\n".join([f"the package does not build: {error}", *lines[-SHOWN_LINES:]])


def judge_and_draw(
    recorded: Recorded, tolerances: Mapping[str, float]
) -> Tuple[Judgement, float, str]:
    """Judge a recorded drive.

    Returns:
        The verdict, the share of the plan or path that was driven right, and a picture as SVG if a
        check failed; "" if none did, or without matplotlib.
    """
    judgement = judge_drive(recorded, tolerances)
    svg = "" if judgement.passed else _draw(judgement.drive)
    return judgement, round(_share(judgement), 2), svg


def _draw(drive: Drive) -> str:
    """Return a picture as SVG with at most MAX_POINTS poses; "" without matplotlib."""
    try:
        # matplotlib is slow to import, and an autograder has none
        from mushr_ros_intro.preview.drawing import as_svg
        from mushr_ros_intro.replay.pictures import picture
    except ImportError:
        return ""
    times, driven, predicted, _ = drive
    rows = np.unique(np.linspace(0, len(times) - 1, MAX_POINTS).astype(int))
    return as_svg(picture(Drive(times[rows], driven[rows], predicted[rows]))).decode()


def _share(judgement: Judgement) -> float:
    """Return which share of a plan was driven right, from its start to the first wrong command.

    Of a path: which share the car has followed when it stops; 1 if that is near enough to its end.
    """
    recorded = judgement.recorded
    if not isinstance(recorded.plan, Plan):
        miss, length = miss_of(judgement), lengths(np.array(recorded.plan.poses)[:, :2])[-1]
        return 1.0 if miss <= judgement.tolerances.position else max(0.0, 1.0 - miss / length)
    if {"commands", "rate"} <= {check.name for check in judgement.checks if check.passed}:
        return 1.0
    rows = [*matched(recorded)]
    if not rows:
        return 0.0
    driven = rows[-1][1][-1].time - recorded.begin + COMMAND_PERIOD
    return min(driven, sum(run.duration for run, _ in rows)) / recorded.plan.duration
