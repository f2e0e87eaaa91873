"""Watch the node of a replay until it has driven its plan or its path, or has failed."""

import time

from mushr_ros_intro.isolation.node_process import NodeProcess
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.replay.following import EXTRA_TIME
from mushr_ros_intro.replay.judge import STILL_SENDS
from mushr_ros_intro.replay.pace import STEP, Pace
from mushr_ros_intro.replay.received import CONTROL
from mushr_ros_intro.replay.recording import MAX_SHIFT, count_leading_stops
from mushr_ros_intro.replay.reference import Exercise, Reference
from mushr_ros_intro.replay.world import ReplayWorld
from mushr_ros_intro.stamps import NANOSECONDS

MAX_SILENCE = 60.0
"""A node that sends no command for this time hangs [s of simulated time]."""

TIMEOUT = 15.0
"""The same for the time for which it waits or runs [s]; with half a core, it starts in 2 s."""

DONE_AFTER = 2.0
"""If no command follows the last one for this time, the node is done [s of simulated time]."""

STOPS_AFTER = 5.0
"""If a node sends only stops for this time after the plan, it is done [s of simulated time]."""

REST = 2 * NANOSECONDS
"""A controller is done if the car stands for this time [ns]."""

EXIT_TIMEOUT = 5.0
"""Longest wait for the exit of a node that has left ROS [s of wall-clock time]."""

MAX_DURATION = 120.0
"""Time limit of a drive [s, without waits for a processor]; for a long plan, twice its duration."""

MAX_TIMES = {False: 1.5, True: 3.0}
"""Limit of a drive, as a multiple of the plan, and of the path; EXTRA_TIME is added."""

CHECK_PERIOD = 0.05
"""Period of the checks of what a running node uses [s of wall-clock time]."""


def watch(process: NodeProcess, world: ReplayWorld, exercise: Exercise) -> str:
    """Wait until the node is done, or has failed.

    Args:
        process: the node.
        world: the world of the replay.
        exercise: the plan or the path of the node.

    Returns:
        A description of the node's failure; empty if there is none.
    """
    pace, plan = Pace(process.threads), exercise if isinstance(exercise, Plan) else None
    expected = count_commands(plan) if plan else 0
    count, heard, checked = 0, 0.0, time.monotonic()
    while not process.has_ended:
        commands = world.received.commands
        driven = len(commands) - (count_leading_stops(commands, plan) if plan else 0)
        if plan:
            world.observe(pace, world.time_left if driven <= expected else None)
        else:
            world.observe(pace, 0)  # a command may come at each step of the clock
        if world.count != count:
            count, heard = world.count, pace.seconds
        silence = pace.seconds - heard
        if _has_driven(world, driven - expected) if plan else has_followed(world):
            if not world.is_ending or silence > EXIT_TIMEOUT:
                return ""  # a node that is done need not end
        elif silence > TIMEOUT or world.silence > MAX_SILENCE:
            # Which limit it exceeds first depends on the load of the machine, so both are named.
            limits = f"{TIMEOUT:g} s, or for {MAX_SILENCE:g} s of simulated time"
            progress = f"{driven} of {expected} commands" if plan else f"{driven} commands"
            if driven:
                return (
                    f"the node hangs: {progress} arrived, and then none for {limits}, although "
                    "the node is still running"
                )
            mistake = world.topic_mistake
            return f"the node runs, but sent no command on {CONTROL} for {limits}; {mistake}"
        if fault := world.fault(pace) or _fault(world, exercise, pace.seconds):
            return fault
        if time.monotonic() > checked + CHECK_PERIOD:
            checked = time.monotonic()
            if excess := process.excess():
                return excess
    return world.describe_end(process)


def deadline(exercise: Exercise) -> float:
    """Return the limit on the duration of a drive [s of wall-clock time]."""
    return max(MAX_DURATION, 2.0 * exercise.duration / NANOSECONDS)


def has_followed(world: ReplayWorld) -> bool:
    """Return whether the car has driven, and has stood for REST."""
    commands = world.received.commands
    first = next((each.arrived for each in commands if each.speed), world.now)
    recent = world.states[-REST // STEP :]
    return world.now > first + REST and all(each.pose == recent[0].pose for each in recent)


def _has_driven(world: ReplayWorld, more: int) -> bool:
    """Return whether a plan has been driven, given by how many commands there are more."""
    commands = world.received.commands
    stops = commands[-more:] if more > 0 else []
    seconds = (stops[-1].time - stops[0].time) / NANOSECONDS if stops else 0.0
    if seconds > STOPS_AFTER and not any(each.speed for each in stops):
        return True
    return bool(commands) and more >= -MAX_SHIFT and world.silence > DONE_AFTER


def _fault(world: ReplayWorld, exercise: Exercise, seconds: float) -> str:
    """Return why a node that has used `seconds` of its own time has failed; "" if it has not."""
    is_path, duration = isinstance(exercise, Reference), exercise.duration / NANOSECONDS
    limit, sent = MAX_TIMES[is_path] * duration + EXTRA_TIME, world.received.commands
    sent = sent[next((index for index, each in enumerate(sent) if each.speed), 0) :]
    kind = "path" if is_path else "plan"
    if sent and (sent[-1].time - sent[0].time) / NANOSECONDS > limit:
        return (
            f"{STILL_SENDS} {limit - duration:g} s after the end of the {kind}, which takes "
            f"{duration:g} s"
        )
    if not is_path and seconds > deadline(exercise):
        return f"the node did not drive the plan within {deadline(exercise):g} s of wall-clock time"
    return ""
