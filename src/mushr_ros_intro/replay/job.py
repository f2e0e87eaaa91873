"""Let a node drive a plan on a simulated car of its own, and judge it."""

import contextlib
import os
import re
import shutil
import tempfile
import time
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.isolation.node_process import WAS_KILLED, NodeProcess
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.isolation.workspace import environment_of
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.replay.follow_world import FollowWorld
from mushr_ros_intro.replay.following import judge_drive
from mushr_ros_intro.replay.judge import STILL_SENDS, Judgement
from mushr_ros_intro.replay.mistakes import printed_error
from mushr_ros_intro.replay.own_process import KilledError, in_own_process
from mushr_ros_intro.replay.pace import Pace
from mushr_ros_intro.replay.received import CONTROL
from mushr_ros_intro.replay.recording import Sent, count_leading_stops
from mushr_ros_intro.replay.reference import Exercise, Reference
from mushr_ros_intro.replay.world import CHECK_PERIOD, MAX_SILENCE, ReplayWorld, describe_limits
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

DONE_AFTER = 2.0
"""If no command follows the last one for this time, the node is done [s of simulated time]."""

STOPS_AFTER = 5.0
"""If a node sends only stops for this time after the plan, it is done [s of simulated time]."""

EXIT_TIMEOUT = 5.0
"""Longest wait for the exit of a node that has left ROS [s of wall-clock time]."""

MAX_DURATION = 120.0
"""Time limit of a drive [s, without waits for a processor]; for a long plan, twice its duration."""

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
    timeout: float
    """Longest time without a command [s of wall-clock time]."""
    tolerances: Dict[str, float]
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
    """Run a replay in a process of its own, and return the verdict.

    If this process or the node is killed, perhaps for lack of memory, the replay is repeated once.

    Raises:
        ReplayError: there is no verdict, because the replay itself failed.
    """
    seconds = MAX_SLOWDOWN * _deadline(job) + MAX_OVERHEAD
    with contextlib.suppress(KilledError):
        judgement: Judgement = in_own_process(_run_here, job, seconds=seconds)
        if not judgement.recorded.outcome.startswith(WAS_KILLED):
            return judgement
    return in_own_process(_run_here, job, seconds=seconds)


def _deadline(job: Job) -> float:
    """Return the limit on the duration of a drive [s of wall-clock time]."""
    return max(MAX_DURATION, 2.0 * job.plan.duration / NANOSECONDS)


def _run_here(job: Job) -> Judgement:
    """Run a replay in this process, which can do it only once; return the verdict.

    Raises:
        UserError: the node cannot be started, or a parameter of the car is invalid.
    """
    began, setting, sandbox = time.monotonic(), job.setting, job.setting.sandbox
    car = car_from(Parameters(setting.parameters))
    sandbox.enter()
    world = _world_of(job)
    with tempfile.TemporaryDirectory(dir=sandbox.folder or None) as folder:
        file = world.due_times.file
        process = NodeProcess(sandboxed(job, folder, file), sandbox.has_namespaces, file)
        try:
            outcome = (
                world.watch(process, setting.timeout)
                if isinstance(world, FollowWorld)
                else _watch(process, world, job)
            )
            error = printed_error(process.output)  # the end of the node can print others
        finally:
            process.end()
            sandbox.end_processes()
    world.wait_until_rest(car.command_timeout)
    recorded = world.recording(job.plan, car, outcome)._replace(
        output=process.output, error=error, seconds=time.monotonic() - began
    )
    verb = "follows" if isinstance(job.plan, Reference) else "drives"
    title = f"{job.name} {verb} {job.plan.path} with the car {setting.car}:"
    return judge_drive(recorded, setting.tolerances)._replace(title=title)


def _world_of(job: Job) -> ReplayWorld:
    """Return the world of a replay."""
    values = job.setting.parameters, job.setting.mux, job.setting.grid
    if isinstance(job.plan, Reference):
        return FollowWorld(*values, job.plan)
    return ReplayWorld(*values)


def interpreter_of(path: str) -> List[str]:
    """Return the words in the first line of a Python program; none of another program."""
    with open(path, "rb") as file:
        line = os.fsdecode(file.readline(200))
    words = re.fullmatch(r"#![ \t]*([^ \t]+)[ \t]*(.*?)[ \t]*\n", line)
    is_python = words and "python" in words[0] and os.access(path, os.X_OK)
    return [each for each in words.groups() if each] if words and is_python else []


def sandboxed(job: Job, folder: str, due_file: Optional[int] = None) -> List[str]:
    """Return the command that runs the node; create its plan and its home in an empty folder.

    Args:
        job: the replay.
        folder: the folder.
        due_file: the number of an open pipe for `simulated_time`; None for the real time.
    """
    os.chmod(folder, 0o755)
    plan = os.path.join(folder, os.path.basename(job.plan.path))
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


def _watch(process: NodeProcess, world: ReplayWorld, job: Job) -> str:
    """Wait until the node has driven the plan, or has failed.

    Returns:
        A description of the node's failure; empty if there is none.
    """
    assert isinstance(job.plan, Plan)
    expected, timeout = count_commands(job.plan), job.setting.timeout
    pace = Pace(process.threads)
    count, heard, checked = 0, 0.0, time.monotonic()
    while not process.has_ended:
        commands = world.received.commands
        driven = len(commands) - count_leading_stops(commands, job.plan)
        world.observe(pace, world.time_left if driven <= expected else None)
        if world.count != count:
            count, heard = world.count, pace.seconds
        silence = pace.seconds - heard
        stops = driven > expected and _are_stops(commands[expected - driven :])
        if stops or (driven >= expected and world.silence > DONE_AFTER):
            if not world.is_ending or silence > EXIT_TIMEOUT:
                return ""  # a node that has driven the plan need not end
        elif silence > timeout or world.silence > MAX_SILENCE:
            return _describe_silence(driven, expected, timeout, world)
        if fault := _fault(world, job, pace):
            return fault
        if time.monotonic() > checked + CHECK_PERIOD:
            checked = time.monotonic()
            if excess := process.excess():
                return excess
    return world.describe_end(process)


def _are_stops(commands: Sequence[Sent]) -> bool:
    """Return whether commands stop the car for STOPS_AFTER."""
    is_long = commands[-1].time - commands[0].time > STOPS_AFTER * NANOSECONDS
    return is_long and not any(each.speed for each in commands)


def _fault(world: ReplayWorld, job: Job, pace: Pace) -> str:
    """Return why a running node has failed; empty if it has not failed."""
    if fault := world.fault(pace):
        return fault
    sent, limit = world.received.commands, job.plan.duration * 3 // 2 + 5 * NANOSECONDS
    if sent and sent[-1].time - sent[0].time > limit:
        return (
            f"{STILL_SENDS} {(limit - job.plan.duration) / NANOSECONDS:g} s "
            f"after the end of the plan, which takes {job.plan.duration / NANOSECONDS:g} s"
        )
    if pace.seconds > _deadline(job):
        seconds = f"{_deadline(job):g} s of wall-clock time"
        return f"the node did not drive the plan within {seconds}"
    return ""


def _describe_silence(count: int, expected: int, timeout: float, world: ReplayWorld) -> str:
    """Return a description of the failure of a node that runs, but sends nothing."""
    if count:
        return (
            f"the node hangs: {count} of {expected} commands arrived, and then none for "
            f"{describe_limits(timeout)}, although the node is still running"
        )
    return (
        f"the node runs, but sent no command on {CONTROL} for {describe_limits(timeout)}; "
        f"{world.topic_mistake}"
    )
