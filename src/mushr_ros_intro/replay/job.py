"""Let a node drive a plan on a simulated car of its own, and judge it."""

import ctypes
import multiprocessing
import multiprocessing.popen_forkserver  # threads that first import it together may fail
import os
import resource
import shutil
import signal
import tempfile
import time
import traceback
from multiprocessing.connection import Connection
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple, TypeVar

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.replay.bag import write_bag
from mushr_ros_intro.replay.judge import Judgement, default_tolerances, judge
from mushr_ros_intro.replay.node_process import NodeProcess
from mushr_ros_intro.replay.recording import Recorded
from mushr_ros_intro.replay.sandbox import Sandbox
from mushr_ros_intro.replay.workspace import environment_of
from mushr_ros_intro.replay.world import CAR, CONTROL, ReplayWorld
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

T = TypeVar("T")

QUIET_AFTER = 0.5
"""If no command follows the last one for this time, the clock is stepped [s of wall-clock time]."""

DONE_AFTER = 2.0
"""If no command follows the last one for this time, the node is done [s of simulated time]."""

MAX_QUIET = 5.0
"""The same limit in wall-clock time [s], in case that the simulated time does not advance."""

MAX_DURATION = 120.0
"""Time limit of a drive [s of wall-clock time]; for a long plan, it is twice the duration."""

MAX_DELAY = 3.0
"""The time for which a node waits for a processor does not count as silence, up to this limit.

The limit is a multiple of the patience. A node that starts hundreds of processes waits for itself.
"""

MAX_MEMORY = 2_000_000_000
"""Limit on the memory of a replay's own process, which receives what a node sends [bytes]."""

MAX_OVERHEAD = 60.0
"""Longest time of a replay before and after the drive [s of wall-clock time]."""

_PR_SET_PDEATHSIG = 1
"""See prctl(2): the signal to this process if the parent process dies."""


class ReplayError(UserError):
    """A replay has no verdict."""


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
    patience: float
    """Longest time without a command [s of wall-clock time]."""
    tolerances: Dict[str, float]
    """Those that differ from the defaults, by the names in `Tolerances`."""
    sandbox: Sandbox
    """How the nodes are isolated."""
    ros: Dict[str, str]
    """The environment variables for ROS of the nodes."""


class Job(NamedTuple):
    """One replay: a node drives a plan."""

    name: str
    """Of the node, for the verdict."""
    command: Tuple[str, ...]
    """The path of the node's executable, and its arguments."""
    plan: Plan
    setting: Setting
    folder: str = ""
    """The folder that the node may read besides the system; "" if there is none."""
    packages: Tuple[str, ...] = ()
    """Paths in which rospack finds the packages of the node."""
    bag: str = ""
    """The path of the bag of the drive; "" for none."""


_processes = multiprocessing.get_context("forkserver")
# A new process for each replay has the modules already, and no state of another replay.
_processes.set_forkserver_preload(["mushr_ros_intro.replay.job"])


def run_job(job: Job) -> Judgement:
    """Run a replay in a process of its own, and return the verdict.

    Raises:
        ReplayError: there is no verdict, because the replay itself failed.
    """
    report: Judgement = in_own_process(_run_here, job, seconds=_deadline(job) + MAX_OVERHEAD)
    return report


def _deadline(job: Job) -> float:
    """Return the limit on the duration of a drive [s of wall-clock time]."""
    return max(MAX_DURATION, 2.0 * job.plan.duration / NANOSECONDS)


def in_own_process(function: Callable[..., T], *arguments: Any, seconds: float) -> T:
    """Call a function in a new process, which ends together with this one; return its result.

    Args:
        function: the function; it may start processes of a submission in a sandbox.
        arguments: of the function.
        seconds: timeout [s of wall-clock time].

    Raises:
        ReplayError: the function failed, did not return in time, or its process died.
    """
    # The namespace of the simulated car. The first call here starts the prepared process, where
    # rospy reads it.
    os.environ["ROS_NAMESPACE"] = "/car"
    receiver, sender = _processes.Pipe(duplex=False)
    call = (function, arguments, sender)
    process = _processes.Process(target=_call_and_send, args=call, daemon=True)
    process.start()
    sender.close()
    error = f"its process did not end within {seconds:g} s"
    try:
        if receiver.poll(seconds):
            result, error = receiver.recv()
            if not error:
                return result
    except EOFError:
        error = "its process ended without a result"
    finally:
        process.kill()
        process.join()
    raise ReplayError(f"the replay failed: {error}")


def _call_and_send(
    function: Callable[..., Any], arguments: Tuple[Any, ...], sender: Connection
) -> None:
    """Call a function; send its result, and the description of an error or an empty text."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process ends this one
    with open(os.devnull, "r+b") as null:
        for number in (0, 1, 2):
            os.dup2(null.fileno(), number)
    result, fault = None, ""
    try:
        result = function(*arguments)
    except (UserError, OSError) as error:
        fault = str(error)
    except Exception:
        fault = traceback.format_exc()
    sender.send((result, fault))
    os._exit(0)  # without waiting for the threads of rospy


def _run_here(job: Job) -> Judgement:
    """Run a replay in this process, which can do it only once; return the verdict.

    Raises:
        UserError: the node cannot be started, or a parameter of the car is invalid.
        OSError: the bag cannot be written.
    """
    began, setting, sandbox = time.monotonic(), job.setting, job.setting.sandbox
    car = car_from(Parameters(setting.parameters))
    sandbox.enter()
    world = ReplayWorld(setting.parameters, setting.mux, setting.grid)
    with tempfile.TemporaryDirectory(dir=sandbox.folder or None) as folder:
        process = NodeProcess(sandboxed(job, folder), sandbox.has_namespaces)
        world.follow(process.activity)
        try:
            outcome = _watch(process, world, job)
        finally:
            process.end()
            sandbox.end_processes()
    world.wait_until_rest(car.command_timeout)
    states, stamps, poses, collisions = world.recording()
    recorded = Recorded(
        plan=job.plan,
        car=car,
        outcome=outcome,
        start=world.start,
        sent=tuple(world.sent),
        stamps=stamps,
        poses=poses,
        collisions=collisions,
        grid=setting.grid,
        actions=world.actions,
        ignored=world.ignored,
        output=process.output,
        seconds=time.monotonic() - began,
    )
    tolerances = default_tolerances(job.plan, car)._replace(**setting.tolerances)
    title = f"{job.name} drives {job.plan.path} with the car {setting.car}:"
    report = judge(recorded, tolerances)._replace(title=title)
    if job.bag:
        write_bag(job.bag, report, states)
    return report


def sandboxed(job: Job, folder: str) -> List[str]:
    """Return the command that runs the node; create its plan and its home in an empty folder."""
    os.chmod(folder, 0o755)
    plan = os.path.join(folder, os.path.basename(job.plan.path))
    shutil.copyfile(job.plan.path, plan)
    os.chmod(plan, 0o644)
    home = os.path.join(folder, "home")
    os.mkdir(home)
    os.chmod(home, 0o777)
    command = [*job.command, *job.setting.remap, f"_plan_file:={plan}"]
    environment = environment_of(job.setting.ros, job.packages)
    return job.setting.sandbox.wrap(command, environment, home, plan, job.folder)


def _watch(process: NodeProcess, world: ReplayWorld, job: Job) -> str:
    """Wait until the node has driven the plan, or has failed.

    Returns:
        A description of the node's failure; empty if there is none.
    """
    expected = count_commands(job.plan)
    limit = job.plan.duration * 3 // 2 + 5 * NANOSECONDS
    deadline, patience = _deadline(job), job.setting.patience
    began, sent = time.monotonic(), world.sent
    while not process.has_ended:
        if not world.is_alive:
            return f"the node has shut down {CAR}"
        if excess := process.excess():
            return excess
        silence = time.monotonic() - world.last_message
        if sent and sent[-1].time - sent[0].time > limit:
            return (
                f"the node still sends commands {(limit - job.plan.duration) / NANOSECONDS:g} s "
                f"after the end of the plan, which takes {job.plan.duration / NANOSECONDS:g} s"
            )
        if time.monotonic() > began + deadline:
            return f"the node did not drive the plan within {deadline:g} s of wall-clock time"
        if len(sent) >= expected:
            if silence > QUIET_AFTER:
                world.hold_clock()
                if world.silence > DONE_AFTER or silence > MAX_QUIET:
                    return ""  # a node that has driven the plan need not end
        elif silence > patience and (silence - min(process.delay, MAX_DELAY * patience) > patience):
            return _describe_silence(len(sent), expected, patience, world)
        time.sleep(POLL_PERIOD)
    fault = process.describe_failure()
    return fault or ("" if sent else f"the node ended without publishing a command on {CONTROL}")


def _describe_silence(count: int, expected: int, patience: float, world: ReplayWorld) -> str:
    """Return a description of the failure of a node that runs, but sends nothing."""
    if count:
        return (
            f"the node hangs: {count} of {expected} commands arrived, and then none for "
            f"{patience:g} s, although the node is still running"
        )
    topics = [topic for topic in world.publications() if topic != "/rosout"]
    return (
        f"the node runs, but published no command on {CONTROL} for {patience:g} s; "
        f"it publishes {', '.join(topics) or 'no topic at all'}"
    )
