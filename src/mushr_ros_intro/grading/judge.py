"""Judge a replay: compare the commands of a node and the path of the car with the plan.

Stamps are integer nanoseconds of simulated time; poses are in the map frame.
"""

import math
from itertools import groupby
from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import counted
from mushr_ros_intro.grading.checks import step_faults
from mushr_ros_intro.grading.replay import (
    START_TOLERANCE,
    Drive,
    Replay,
    Run,
    Sent,
    drive,
    max_rates,
    runs_of,
)
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS

_ROUNDING = 1e-6
"""Added to default tolerances [m, rad]: commands travel as float32."""

_SAME = 1e-4
"""Relative difference between commands that count as equal; a node may compute in float32."""

_JITTER = COMMAND_PERIOD // 2
"""Allowed deviation of the time between two commands [ns]."""

_SPAN_TOLERANCE = 2 * COMMAND_PERIOD
"""Allowed deviation of the time from a row's first to its last command from its duration [ns]."""


class Tolerances(NamedTuple):
    """How far a replay may deviate from the plan."""

    position: float
    """Of the start pose and the final pose [m]."""
    angle: float
    """Of the start pose and the final pose [rad]."""
    path: float
    """Largest distance between the driven and the predicted path [m]."""


class Check(NamedTuple):
    """One verdict."""

    name: str
    passed: bool
    message: str
    """What was found, and what was expected."""


def default_tolerances(plan: Plan, car: Car) -> Tolerances:
    """Return how far the plan drives and turns the car within its command timeout.

    This is what a missing stop at the end of the plan costs.
    """
    speed, turn_rate = max_rates(plan, car)
    seconds = car.command_timeout / NANOSECONDS
    distance = _ROUNDING + seconds * speed
    return Tolerances(distance, _ROUNDING + seconds * turn_rate, distance)


def judge(replay: Replay, tolerances: Tolerances) -> List[Check]:
    """Return all verdicts on a replay, the most telling ones first."""
    node = Check("node", not replay.outcome, replay.outcome or "the node ran without an error")
    if not replay.sent or not len(replay.stamps):
        missing = "the node sent no command" if not replay.sent else "the car reported no pose"
        names = "start_pose", "commands", "rate", "path", "final_pose", "rest", "collision", "map"
        return [node, *(Check(name, False, f"not judged: {missing}") for name in names)]
    path = drive(replay)
    return [
        node,
        _judge_start(replay, path, tolerances),
        _judge_commands(replay),
        _judge_rate(replay),
        _judge_path(path, tolerances),
        _judge_final_pose(replay, path, tolerances),
        _judge_rest(replay),
        _judge_collisions(replay),
        _judge_map(replay),
    ]


def verdict(checks: Sequence[Check], replay: Replay) -> str:
    """Return one line for each check, failures first, and then notes and the node's last output."""
    ordered = sorted(checks, key=lambda check: 2 * check.passed or "not judged" in check.message)
    lines = [
        " ".join(["ok  " if check.passed else "FAIL", f"{check.name}:", *_ends(check.message)])
        for check in ordered
    ]
    count = sum(not check.passed for check in checks)
    lines.append(f"{counted(count, 'check')} failed" if count else "all checks passed")
    if note := _stop_note(replay, "note: "):
        lines.append(note)
    output = replay.outcome.splitlines()[1:]
    return "\n".join([*lines, *(["the last output of the node:"] if output else []), *output])


def _ends(message: str) -> List[str]:
    """Return the first and the last line of a message, which for a crash name the exception."""
    lines = message.splitlines()
    return lines[:1] + lines[1:][-1:]


def _stop_note(replay: Replay, prefix: str) -> str:
    """Return a note if the node's last command is not a stop, otherwise nothing."""
    if not replay.sent or replay.sent[-1].speed == 0.0:
        return ""
    return (
        f"{prefix}the node sends no stop at the end, so the car rolls on until its last command "
        f"expires, up to {replay.car.command_timeout / NANOSECONDS:g} s"
    )


def _judge_start(replay: Replay, path: Drive, tolerances: Tolerances) -> Check:
    """Judge whether the drive began at the plan's start pose."""
    wanted = Pose(*replay.plan.start)
    if not replay.starts:
        return Check("start_pose", False, f"the node sent no start pose; expected {wanted}")
    sent = replay.starts[0]
    if not sent.is_close_to(wanted, START_TOLERANCE):  # also if it is NaN
        return Check("start_pose", False, f"the node sent the start pose {sent}; expected {wanted}")
    return _compare("start_pose", "the car started at", path.driven[0], wanted, tolerances)


def _compare(name: str, what: str, row: np.ndarray, wanted: Pose, tolerances: Tolerances) -> Check:
    """Judge the difference between a pose, given as x, y and theta, and the wanted pose."""
    pose = Pose(*row)
    distance, angle = pose.distance_to(wanted), pose.angle_to(wanted)
    message = (
        f"{what} {pose}, {distance:.3g} m and {angle:.3g} rad from the expected {wanted}; "
        f"tolerances {tolerances.position:.3g} m and {tolerances.angle:.3g} rad"
    )
    return Check(name, distance <= tolerances.position and angle <= tolerances.angle, message)


def _judge_commands(replay: Replay) -> Check:
    """Judge whether the commands are those of the plan, in its order."""
    for number, sent in enumerate(replay.sent, 1):
        if not (math.isfinite(sent.speed) and math.isfinite(sent.steering_angle)):
            shown = _shown(sent[2:])
            return Check("commands", False, f"command {number} is {shown}; expected finite numbers")
    runs = runs_of(replay.plan)
    wanted = [run[:2] for run in runs]
    got = [group[0][2:] for group in _groups(replay)]
    if got == wanted:
        return Check("commands", True, f"{len(replay.sent)} commands, in the plan's order")
    same = min(len(got), len(wanted))
    index = next((i for i in range(same) if got[i] != wanted[i]), same)
    if index == len(got):
        message = f"no command after row {runs[index - 1].last}; expected {runs[index]}"
    elif index == len(wanted):
        message = f"after the last row the node sent {_shown(got[index])}; expected only a stop"
    else:
        message = f"{runs[index]}: received {_shown(got[index])}; expected {_shown(wanted[index])}"
        message += _mistake(got, wanted)
    return Check("commands", False, message)


def _mistake(got: Sequence[Tuple[float, ...]], wanted: Sequence[Tuple[float, ...]]) -> str:
    """Return a sentence about a common mistake that explains all commands, if there is one."""
    if len(got) == len(wanted):
        if [command[::-1] for command in got] == list(wanted):
            return ". Speed and steering angle are swapped in all commands"
        (speeds, angles), (right_speeds, right_angles) = zip(*got), zip(*wanted)
        speed, angle = _factor(speeds, right_speeds), _factor(angles, right_angles)
        if speed is not None and angle is not None:
            mistakes = []
            if abs(speed - 1.0) > _SAME:
                mistakes.append(f"All speeds are {speed:.4g} times those of the plan")
            if abs(angle + 1.0) < _SAME:
                mistakes.append("All steering angles have the wrong sign; positive turns left")
            elif abs(angle / math.degrees(1.0) - 1.0) < _SAME:
                mistakes.append("All steering angles are in degrees; expected radians")
            elif abs(angle - 1.0) > _SAME:
                mistakes.append(f"All steering angles are {angle:.4g} times those of the plan")
            return "".join(f". {mistake}" for mistake in mistakes)
    return ". The rows are in the wrong order" if sorted(got) == sorted(wanted) else ""


def _factor(got: Sequence[float], wanted: Sequence[float]) -> Optional[float]:
    """Return the factor between all numbers of two sequences, or None if there is none."""
    square = float(np.dot(wanted, wanted))
    factor = float(np.dot(got, wanted)) / square if square else 1.0
    is_same = np.allclose(got, factor * np.array(wanted), rtol=_SAME, atol=0.0)
    return factor if is_same else None


def _shown(command: Tuple[float, ...]) -> str:
    """Return a command as text."""
    return f"{command[0]:g} m/s, {command[1]:g} rad"


def _groups(replay: Replay) -> List[List[Sent]]:
    """Return the commands in groups of equal neighbours, without the stop at the end."""
    groups = [list(group) for _, group in groupby(replay.sent, lambda sent: sent[2:])]
    if groups[-1][0].speed == 0.0 and len(groups) == len(runs_of(replay.plan)) + 1:
        groups.pop()
    return groups


def _judge_rate(replay: Replay) -> Check:
    """Judge whether each row has its number of commands, evenly spaced by their stamps."""
    runs, groups = runs_of(replay.plan), _groups(replay)
    for index, run in enumerate(runs):
        if index >= len(groups) or groups[index][0][2:] != run[:2]:
            return Check(
                "rate", False, f"{run}: not judged, because its command was not received in turn"
            )
        if fault := _rate_fault(run, groups[index], run is runs[-1]):
            return Check("rate", False, f"{run}: {fault}")
    message = f"{NANOSECONDS // COMMAND_PERIOD} commands per second in every row"
    if not all(sent.stamped for sent in replay.sent):
        message += "; their spacing was not judged, because they have no stamps"
    return Check("rate", True, message)


def _rate_fault(run: Run, group: Sequence[Sent], is_last: bool) -> str:
    """Return what is wrong with the number or the stamps of a run's commands, if anything."""
    times = [sent.time for sent in group]
    seconds, span = run.duration / NANOSECONDS, (times[-1] - times[0]) / NANOSECONDS
    # If the last row of the plan is a stop, the final stop belongs to the same group.
    extra = int(is_last and run.speed == 0.0)
    if len(group) - run.expected not in (0, extra):
        pace = f", {(len(group) - 1) / span:.3g} per second" if span else ""
        return f"{counted(len(group), 'command')} received{pace}; expected {run.expected}"
    if not all(sent.stamped for sent in group):
        return ""  # times of arrival are too rough
    if faults := step_faults(times, COMMAND_PERIOD, _JITTER):
        return faults[0]
    if abs(span - seconds) > _SPAN_TOLERANCE / NANOSECONDS:
        expected = f"{seconds:g} s, tolerance {_SPAN_TOLERANCE / NANOSECONDS:g} s"
        return f"the stamps of its {len(group)} commands span {span:.3g} s; expected {expected}"
    return ""


def _judge_path(path: Drive, tolerances: Tolerances) -> Check:
    """Judge the distance between the driven and the predicted path."""
    distance = path.frechet_distance
    message = (
        f"the driven path deviates by up to {distance:.3g} m from the predicted path; "
        f"tolerance {tolerances.path:.3g} m"
    )
    return Check("path", distance <= tolerances.path, message)


def _judge_final_pose(replay: Replay, path: Drive, tolerances: Tolerances) -> Check:
    """Judge whether the car ended at the predicted pose."""
    wanted = Pose(*path.predicted[-1])
    check = _compare("final_pose", "the car ended at", path.driven[-1], wanted, tolerances)
    note = "" if check.passed else _stop_note(replay, "; ")
    return check._replace(message=check.message + note)


def _judge_rest(replay: Replay) -> Check:
    """Judge whether the car stands at the end."""
    tail = replay.poses[replay.stamps >= replay.stamps[-1] - replay.car.command_timeout]
    if len(tail) < 2:
        return Check("rest", False, "not judged: the car reported fewer than two poses at the end")
    stands = bool(np.all(tail == tail[-1]))
    message = "the car still moves at the end; expected it to stand"
    message = "the car stands at the end" if stands else message
    return Check("rest", stands, message)


def _judge_collisions(replay: Replay) -> Check:
    """Judge whether the car hit a wall."""
    if replay.collisions is None:
        return Check("collision", False, "not judged: the car reports no collisions")
    if replay.collisions:
        where = f"the car hit a wall at {replay.collisions[0]}; expected no collision"
        return Check("collision", False, where)
    return Check("collision", True, "the car hit no wall")


def _judge_map(replay: Replay) -> Check:
    """Judge whether the car stayed on the map."""
    grid = replay.grid
    if grid is None:
        return Check("map", True, "there is no map")
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    size = f"{width:g} m x {height:g} m"
    for pose in (Pose(*row) for row in replay.poses):
        x, y, _ = grid.to_grid(pose)
        if not (0.0 <= x <= width and 0.0 <= y <= height):
            return Check("map", False, f"the car left the map at {pose}; the map is {size}")
    return Check("map", True, f"the car stayed on the map of {size}")
