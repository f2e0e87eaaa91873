"""Let a node drive a plan on a simulated car of its own, and judge it."""

import contextlib
import os
import re
import shutil
import sys
import tempfile
import time
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.isolation.node_process import WAS_KILLED, NodeProcess
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.isolation.workspace import environment_of, search_path
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.program_file import searches_python
from mushr_ros_intro.replay.following import judge_drive
from mushr_ros_intro.replay.judge import Judgement
from mushr_ros_intro.replay.mistakes import printed_error
from mushr_ros_intro.replay.own_process import KilledError, in_own_process
from mushr_ros_intro.replay.recording import Recorded
from mushr_ros_intro.replay.reference import Exercise, Reference
from mushr_ros_intro.replay.watch import deadline, watch
from mushr_ros_intro.replay.world import ReplayWorld
from mushr_ros_intro.world.grid import Grid

MAX_OVERHEAD = 60.0
"""Longest time of a replay before and after the drive [s of wall-clock time]."""

MAX_SLOWDOWN = 5.0
"""A replay that takes so many times longer than its limit has no verdict: the machine is busy."""

SIMULATED_TIME = os.path.join(os.path.dirname(__file__), "simulated_time.py")
"""The program that runs a controller in simulated time."""


class Setting(NamedTuple):
    """What several replays have in common."""

    car: str
    """The name of the car."""
    parameters: Dict[str, Any]
    """Of the simulated car."""
    mux: Dict[str, Any]
    """The configuration of the mux."""
    grid: Optional[Grid]
    """The map, or None."""
    remap: Tuple[str, ...]
    """Remappings and parameters for the nodes, as FROM:=TO."""
    tolerances: Mapping[str, float]
    """Those that differ from the defaults, by the names in `Tolerances`."""
    sandbox: Sandbox
    """How the nodes are isolated."""
    ros: Dict[str, str]
    """The environment variables for ROS of the nodes."""


class Job(NamedTuple):
    """One replay: a node drives a plan, or follows a path."""

    name: str
    """Of the node, for the verdict."""
    command: Tuple[str, ...]
    """The path of the node's executable, and its arguments."""
    plan: Exercise
    setting: Setting
    folder: str = ""
    """The folder that the node may read besides the system; "" if there is none."""
    packages: Tuple[str, ...] = ()
    """Paths in which rospack finds the packages of the node."""


def run_job(job: Job) -> Judgement:
    """Run a replay, and return the verdict; errors as in `record`."""
    verb = "follows" if isinstance(job.plan, Reference) else "drives"
    title = f"{job.name} {verb} {job.plan.path} with the car {job.setting.car}:"
    return judge_drive(record(job), job.setting.tolerances)._replace(title=title)


def record(job: Job) -> Recorded:
    """Run a replay in a process of its own, and return what was recorded.

    If this process or the node is killed, perhaps for lack of memory, the replay is repeated once.

    Raises:
        ReplayError: the replay itself failed.
    """
    seconds = MAX_SLOWDOWN * deadline(job.plan) + MAX_OVERHEAD
    with contextlib.suppress(KilledError):
        recorded: Recorded = in_own_process(_run_here, job, seconds=seconds)
        if not recorded.outcome.startswith(WAS_KILLED):
            return recorded
    return in_own_process(_run_here, job, seconds=seconds)


def _run_here(job: Job) -> Recorded:
    """Run a replay in this process, which can do it only once; return what was recorded.

    Raises:
        UserError: the node cannot be started, or a parameter of the car is invalid.
    """
    began, setting, sandbox = time.monotonic(), job.setting, job.setting.sandbox
    car = car_from(Parameters(setting.parameters))
    sandbox.enter()
    world = ReplayWorld(car, setting.parameters, setting.mux, setting.grid, job.plan)
    with tempfile.TemporaryDirectory(dir=sandbox.folder or None) as folder:
        file = world.due_times.file
        process = NodeProcess(sandboxed(job, folder, file), sandbox.has_namespaces, file)
        try:
            outcome = watch(process, world, job.plan)
            error = printed_error(process.output)  # the end of the node can print others
        finally:
            process.end()
            sandbox.end_processes()
    world.wait_until_rest()
    return world.recording(outcome)._replace(
        output=process.output, error=error, seconds=time.monotonic() - began
    )


def interpreter_of(path: str) -> List[str]:
    """Return the words in the first line of a Python program; none of another program.

    A `python` that the node cannot see, as in the home directory, is replaced by this Python.
    """
    with open(path, "rb") as file:
        line = os.fsdecode(file.readline(200))
    words = re.fullmatch(r"#![ \t]*([^ \t]+)[ \t]*(.*?)[ \t]*\n", line)
    is_python = words and "python" in words[0] and os.access(path, os.X_OK)
    found = [each for each in words.groups() if each] if words and is_python else []
    is_hidden = found and searches_python(os.fsencode(line[2:-1]), search_path())
    return [sys.executable] if is_hidden else found


def sandboxed(job: Job, folder: str, due_file: Optional[int] = None) -> List[str]:
    """Return the command that runs the node; create its plan and its home in an empty folder.

    Args:
        job: the replay.
        folder: the folder.
        due_file: the number of an open pipe for `simulated_time`; None for the real time.
    """
    os.chmod(folder, 0o755)
    # rospy reads the value of an argument as YAML, in which ": " and " #" have a meaning.
    plan = os.path.join(folder, re.sub(r"[^\w.-]", "_", os.path.basename(job.plan.path)))
    shutil.copyfile(job.plan.path, plan)
    os.chmod(plan, 0o644)
    home = os.path.join(folder, "home")
    os.mkdir(home)
    os.chmod(home, 0o777)
    command = [*job.command, *job.setting.remap, f"_plan_file:={plan}"]
    environment = environment_of(job.setting.ros, job.packages)
    if due_file is not None and (interpreter := interpreter_of(job.command[0])):
        environment["PYTHONHASHSEED"] = "0"
        with open(SIMULATED_TIME, encoding="ascii") as file:
            command = [*interpreter, "-c", file.read(), str(due_file), *command]
    return job.setting.sandbox.wrap(command, environment, home, plan, job.folder)
