"""Judge a replay: compare the commands of a node and the path of the car with the plan.

Stamps are integer nanoseconds of simulated time; poses are in the map frame.
"""

import math
import re
from itertools import groupby
from typing import Any, Callable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.preview.prediction import rest
from mushr_ros_intro.replay.mistakes import (
    INITIAL_POSES,
    POSE_TYPE,
    command_mistake,
    start_mistake,
    topic_mistake,
)
from mushr_ros_intro.replay.rate import judge_rate
from mushr_ros_intro.replay.recording import (
    MAX_SHIFT,
    START_TOLERANCE,
    Drive,
    Recorded,
    drive,
    driven_plan,
    groups_of,
    matched,
    placed_pose,
    runs_of,
)
from mushr_ros_intro.replay.tolerances import Tolerances, compare, unequal
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted

_SAME_END = 1e-3
"""Final poses whose difference is not larger are equal [m, rad]."""

_WAS_NOT_LOADED = re.compile(
    r"^(SyntaxError|IndentationError|TabError|ImportError|ModuleNotFoundError): .*\Z", re.MULTILINE
)
_IS_MISSING = re.compile(r"^ModuleNotFoundError: No module named '([^'.]+)'\Z", re.MULTILINE)


class Check(NamedTuple):
    """One verdict."""

    name: str
    passed: bool
    message: str
    """What was found, and what was expected; or why the check was not judged."""
    is_judged: bool = True
    """If not, it has not passed, and another failure is the reason."""


class Judgement(NamedTuple):
    """A replay and the verdict on it."""

    recorded: Recorded
    drive: Drive
    tolerances: Any
    """`Tolerances`; those of a controller are `following.FollowTolerances`."""
    checks: Sequence[Check] = ()
    notes: Sequence[str] = ()
    """What a node might do better, although no check fails because of it."""
    title: str = ""
    """The first line of the verdict: the node, the plan and the car."""

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)

    @property
    def verdict(self) -> str:
        """One line for each check, failures first, and then notes and the node's last output.

        Checks that were not judged for the same reason share a line.
        """
        lines = [self.title] if self.title else []
        failed = [check for check in self.checks if check.is_judged and not check.passed]
        lines += [f"FAIL {check.name}: {' '.join(_ends(check.message))}" for check in failed]
        open_checks = [check for check in self.checks if not check.is_judged]
        for reason, group in groupby(open_checks, lambda check: check.message):
            lines.append(f"--   {', '.join(check.name for check in group)}: {reason}")
        passed = [check for check in self.checks if check.passed]
        lines += [f"ok   {check.name}: {check.message}" for check in passed]
        counts = f"{counted(len(failed), 'check')} failed"
        counts += f", {len(open_checks)} not judged" if open_checks else ""
        lines.append("all checks passed" if self.passed else counts)
        lines += [f"note: {note}" for note in self.notes]
        if output := self.recorded.outcome.splitlines()[1:]:
            lines += ["the last output of the node:", *output]
        return "\n".join(lines)


def missing_module(recorded: Recorded) -> Iterator[str]:
    """Yield a note if a module is missing, which may be a fault of the machine."""
    for name in _IS_MISSING.findall(recorded.outcome):
        yield (
            f"the module {name} is neither in the node's files nor on the machine that ran the "
            "node; if nodes may use it, install it there (docs/teach.md)"
        )


def _notes(recorded: Recorded) -> Iterator[str]:
    """Yield what a node might do better, although no check fails because of it."""
    yield from missing_module(recorded)
    if recorded.outcome.endswith("KeyError: '~plan_file'"):
        yield "~plan_file exists only after rospy.init_node; call rospy.get_param after it"
    elif not recorded.plan_is_read and not _WAS_NOT_LOADED.search(recorded.outcome):
        yield (
            "the node did not read its parameter ~plan_file, the path of the plan; plan_file "
            "without ~ is another parameter"
        )
    if stops := len(recorded.sent) - len(recorded.commands):
        yield f"the node sends {counted(stops, 'stop')} before the plan"
    for run, group in matched(recorded):
        if abs(len(group) - run.expected) == 1 and run.speed:
            yield f"{run}: {counted(len(group), 'command')} received; expected {run.expected}"
    ends = [rest(plan, recorded.car)[1] for plan in (recorded.plan, driven_plan(recorded))]
    if not ends[0].is_close_to(ends[1], _SAME_END):
        yield (
            "path and final_pose are judged with the rows as long as the node drove them; the plan "
            f"itself ends at {ends[0]}"
        )
    # A node that has failed, or repeats the plan, may have been ended before its stop.
    is_cut = recorded.outcome or len(groups_of(recorded)) > len(runs_of(recorded.plan))
    if recorded.sent and not is_cut and recorded.sent[-1].speed != 0.0:
        seconds = recorded.car.command_timeout / NANOSECONDS
        yield (
            "the node sends no stop at the end, so the car rolls on until its last command "
            f"expires, up to {seconds:g} s"
        )
    if recorded.ignored:
        yield f"the car ignored {recorded.ignored}"
    if recorded.limit:
        yield f"{recorded.limit}, a limit of the car's motion; 0 means as fast as possible"


def _ends(message: str) -> List[str]:
    """Return the first and the last line of a message; after a crash, the last is the exception."""
    lines = message.splitlines()
    return lines[:1] + lines[1:][-1:]


def _topics(judgement: Judgement) -> Tuple[bool, str]:
    """Judge whether the node only drove the car."""
    if actions := judgement.recorded.actions:
        return False, f"the node {', '.join(actions)}; expected only a start pose and commands"
    return True, "the node did nothing that is not allowed"


def _start_pose(judgement: Judgement) -> Tuple[bool, str]:
    """Judge whether the drive began at the plan's start pose."""
    wanted = judgement.recorded.plan.start
    sent = judgement.recorded.start
    if not sent:
        return False, f"{_missing_start(judgement.recorded)}; expected {wanted}"
    if not sent.is_close_to(wanted, START_TOLERANCE):  # also if it is NaN
        if not all(map(math.isfinite, sent)):
            ignored = judgement.recorded.ignored
            return False, f"the car ignored {ignored}; the plan starts at {wanted}"
        found = f"the node sent the start pose {sent}; expected {wanted}"
        return False, f"{found}{start_mistake(sent, wanted, START_TOLERANCE)}"
    placed = Pose(*judgement.recorded.poses[placed_pose(judgement.recorded)])
    passed, difference = compare(placed, wanted, *judgement.tolerances[:2])
    return passed, f"the car started at {difference}"


def _missing_start(recorded: Recorded) -> str:
    """Return why there was no start pose before the first command."""
    if recorded.start_delay:
        seconds = recorded.start_delay / NANOSECONDS
        return f"the node sent its start pose {seconds:.2f} s after the first command to drive"
    if fault := topic_mistake(dict(recorded.published), INITIAL_POSES, POSE_TYPE):
        return f"the node {fault}"
    return (
        f"the node sent no start pose on {INITIAL_POSES}, or sent it before this topic was "
        "connected: wait until its get_num_connections() is not 0, or sleep for a second"
    )


def _commands(judgement: Judgement) -> Tuple[bool, str]:
    """Judge whether the commands are those of the plan, in its order."""
    runs, groups = runs_of(judgement.recorded.plan), groups_of(judgement.recorded)
    wanted = [run[:2] for run in runs]
    got = [group[0].values for group in groups]
    if got == wanted:
        return True, f"{len(judgement.recorded.sent)} commands, in the plan's order"
    same = min(len(got), len(wanted))
    index = next((i for i in range(same) if got[i] != wanted[i]), same)
    if index == len(got) and judgement.recorded.outcome.startswith(STILL_SENDS):
        return False, f"the drive was ended before {runs[index]}"
    if index == len(got):
        return False, f"no command after row {runs[index - 1].last}; expected {runs[index]}"
    if index == len(wanted):
        run, count = runs[-1], len(groups[index - 1])
        if count < run.expected - MAX_SHIFT:
            text = f"received {_shown(got[index])} after {counted(count, 'command')}"
            return False, f"{run}: {text}; expected {run.expected} commands of {_shown(run[:2])}"
        sent = " and ".join(map(_shown, got[index : index + 2]))
        hint = "expected only a stop (does the node repeat the plan?)"
        return False, f"after the plan the node sent {sent}; {hint}"
    difference = f"received {_shown(got[index])}; expected {_shown(wanted[index])}"
    mistake = command_mistake(got, wanted, judgement.recorded.plan.start)
    return False, f"{runs[index]}: {difference}{mistake}"


def _shown(command: Tuple[float, ...]) -> str:
    return f"{command[0]:g} m/s, {command[1]:g} rad"


def _path(judgement: Judgement) -> Tuple[bool, str]:
    distance, tolerance = judgement.drive.frechet_distance, judgement.tolerances.path
    far, limit = unequal(distance, tolerance)
    message = f"the driven path deviates by up to {far} m from the predicted path"
    return distance <= tolerance, f"{message}; tolerance {limit} m"


def _final_pose(judgement: Judgement) -> Tuple[bool, str]:
    """Judge whether the car ended right; it proves nothing if it was placed near the end."""
    _, driven, predicted, _ = judgement.drive
    (starts, start), (ends, end) = (
        compare(Pose(*driven[index]), Pose(*predicted[index]), *judgement.tolerances[:2])
        for index in (0, -1)
    )
    if ends and not starts:
        return False, f"the car ended at the expected pose, but started at {start}"
    return ends, f"the car ended at {end}"


def _map(judgement: Judgement) -> Tuple[bool, str]:
    """Judge whether the car hit no wall and stayed on the map."""
    recorded = judgement.recorded
    grid = recorded.grid
    if recorded.collisions:
        return False, f"the car hit a wall at {recorded.collisions[0]}; expected no collision"
    if grid is None:
        return True, "there is no map"
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    size = f"{width:g} m x {height:g} m"
    # Before its start, the car waits at the origin.
    for pose in (Pose(*row) for row in recorded.poses[placed_pose(recorded) :]):
        x, y, _ = grid.to_grid(pose)
        if not (0.0 <= x <= width and 0.0 <= y <= height):
            return False, f"the car left the map at {pose}; the map is {size}"
    return True, f"the car hit no wall and stayed on the map of {size}"


STILL_SENDS = "the node still sends commands"
"""The failure of a node that is ended while it sends commands begins with this."""

CHECKS: Mapping[str, Callable[[Judgement], Tuple[Optional[bool], str]]] = {
    "topics": _topics,
    "start_pose": _start_pose,
    "commands": _commands,
    "rate": lambda judgement: judge_rate(judgement.recorded),
    "path": _path,
    "final_pose": _final_pose,
    "map": _map,
}
"""Each function returns whether a check passed, or None if it cannot be judged, and a message."""

CHECK_NAMES = ("node", *CHECKS)
"""The names of all checks. A failure often explains those after it."""


def judge(recorded: Recorded, tolerances: Tolerances) -> Judgement:
    """Return the verdict on a replay; its checks are in the order of CHECK_NAMES."""
    judgement = Judgement(recorded, drive(recorded), tolerances, notes=tuple(_notes(recorded)))
    return judgement._replace(checks=tuple(checked(judgement, CHECKS)))


def checked(judgement: Judgement, checks: Mapping[str, Callable[..., Any]]) -> Iterator[Check]:
    """Yield the check `node`, and the result of each function in `checks`, by their names.

    A function gets the judgement. It returns whether the check passed, or None if it cannot be
    judged, and a message.
    """
    recorded = judgement.recorded
    message = recorded.outcome or "the node ran without an error"
    if recorded.error and "\n" not in recorded.outcome:  # several lines quote the output
        message = "; ".join(filter(None, [f"the node printed {recorded.error}", recorded.outcome]))
    yield Check("node", not recorded.outcome, message)
    missing = "" if recorded.sent else "no command"
    named = {"topics"} if recorded.actions else set()  # these checks are judged all the same
    if recorded.sent and not any(each.speed for each in recorded.sent):
        if recorded.outcome:
            missing = "only stops"
        elif "commands" in checks and any(row.speed for row in recorded.plan.rows):
            missing, named = "only stops", named | {"commands"}
    for name, check in checks.items():
        passed, message = None, f"not judged: the node sent {missing}"
        if not missing or name in named:
            passed, message = check(judgement)
        yield Check(name, bool(passed), message, passed is not None)
