"""Judge a replay: what a node sent and where the car drove, against the plan.

All instants are integer nanoseconds of simulated time; poses are in the map frame.
"""

import csv
import json
import math
import os
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, compose, inverse
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.grading.checks import apart, shown, turned
from mushr_ros_intro.plan.model import MAX_STEERING_ANGLE, Plan
from mushr_ros_intro.preview.prediction import states_at
from mushr_ros_intro.sim.stamps import NANOSECONDS

RATE = 10
"""How many commands a second of a plan is to have [Hz]."""

PERIOD = NANOSECONDS // RATE
"""From one command to the next [ns]."""

SLACK = 0.2
"""How late or early the car may be by default [s]: a stop that is not sent costs that much."""

_START_TOLERANCE = 1e-3
"""Between the start pose that a node sends and the plan's [m, rad]: what text loses at most."""

_ROUNDING = 1e-6
"""What default tolerances have on top [m, rad]: commands travel as float32."""

_DEVIATIONS = 5.0
"""How many standard deviations the noise of a car may be: it is no more in a million draws."""

_BRAKING = 5 * NANOSECONDS
"""How long any car takes to stand after the plan's end [ns]."""

_JITTER = PERIOD // 2
"""How far a stamp may be from where it belongs [ns]."""


class Sent(NamedTuple):
    """One command as a node sent it."""

    time: int
    """Its stamp, or where that is zero about when it came [ns]."""
    stamped: bool
    speed: float
    """[m/s]"""
    steering_angle: float
    """[rad]"""


class Replay(NamedTuple):
    """All that was seen of a replay."""

    plan: Plan
    car: Car
    outcome: str
    """What is wrong with how the node itself ran and ended; empty if nothing."""
    starts: Tuple[Pose, ...]
    """The start poses that the node sent; not finite where it sent that."""
    sent: Tuple[Sent, ...]
    """The commands, in the order in which they came."""
    stamps: np.ndarray
    """When the car reported its pose [ns], N of them, rising."""
    poses: np.ndarray
    """Where the car was then: x [m], y [m], theta [rad]; N x 3."""
    collisions: Optional[Tuple[Pose, ...]]
    """Where the car hit a wall; None where nobody tells."""
    map_origin: Optional[Pose]
    """The lower left corner of the map; None where there is no map."""
    map_size: Tuple[float, float]
    """Its width and height [m]."""


class Tolerances(NamedTuple):
    """How far a replay may be from the plan."""

    position: float
    """Of the start and the final pose [m]."""
    angle: float
    """Likewise [rad]."""
    path: float
    """Largest distance between the driven and the predicted path [m]."""


class Check(NamedTuple):
    """One verdict."""

    name: str
    passed: bool
    message: str
    """What was found, and what was expected."""


class Run(NamedTuple):
    """Neighbouring rows of a plan with the same command."""

    speed: float
    steering_angle: float
    first: int
    """The number of its first row, from 1."""
    last: int
    """The number of its last row."""
    duration: int
    """[ns]"""
    expected: int
    """How many commands it is to have."""


def _fastest(plan: Plan, car: Car, deviations: float = 0.0) -> Tuple[float, float]:
    """Return how fast a plan is at most [m/s], and how fast it turns a car [rad/s].

    The car's noise makes it faster, by so many of its standard `deviations`.
    """
    speed_error, angle_error = deviations * car.speed_noise, deviations * car.steering_noise
    turns = (
        (abs(row.speed) + speed_error)
        * math.tan(min(abs(row.steering_angle) + angle_error, MAX_STEERING_ANGLE))
        for row in plan.rows
    )
    return max(abs(row.speed) for row in plan.rows) + speed_error, max(turns) / car.wheelbase


def default_tolerances(plan: Plan, car: Car) -> Tolerances:
    """Return how far the car can get, and turn, in SLACK seconds of this plan, and a little."""
    speed, turn = _fastest(plan, car)
    distance = _ROUNDING + SLACK * speed
    return Tolerances(distance, _ROUNDING + SLACK * turn, distance)


def predicted_poses(plan: Plan, car: Car, instants: Sequence[int]) -> np.ndarray:
    """Return where a car is that gets the plan's commands in time and has no noise.

    Args:
        plan: what is driven.
        car: that drives it.
        instants: counted from the first command [ns], N of them, rising.

    Returns:
        x [m], y [m] and theta [rad]; N x 3.
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    poses = [state.pose for state in states_at(plan, car, instants)]
    return np.array(poses, float).reshape(-1, 3)


def frechet_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the discrete Frechet distance of two curves.

    Two walkers go along the two curves from point to point, each never back; it is the length of
    the shortest leash that lets both reach the end (Eiter and Mannila, "Computing Discrete Frechet
    Distance", CD-TR 94/64). The table of the recursion is filled by anti-diagonals, each at once.

    Args:
        one: points [m], N x 2, N at least 1.
        other: points [m], M x 2, M at least 1.
    """
    n, m = len(one), len(other)
    # At index i + 1 the shortest leash to (i, k - i), on this anti-diagonal k and the two before.
    before = np.full(n + 1, np.inf)
    last = np.full(n + 1, np.inf)
    before[0] = -np.inf  # the walkers begin at (0, 0), from nowhere
    for k in range(n + m - 1):
        low, high = max(0, k - m + 1), min(n - 1, k)
        ends = other[k - high : k - low + 1][::-1]
        leash = np.hypot(one[low : high + 1, 0] - ends[:, 0], one[low : high + 1, 1] - ends[:, 1])
        shortest = np.minimum(last[low + 1 : high + 2], last[low : high + 1])
        shortest = np.minimum(shortest, before[low : high + 1])
        present = np.full(n + 1, np.inf)
        present[low + 1 : high + 2] = np.maximum(leash, shortest)
        before, last = last, present
    return float(last[n])


def runs_of(plan: Plan) -> List[Run]:
    """Return the rows of a plan, with neighbours of the same command made one."""
    runs: List[Run] = []
    for number, row in enumerate(plan.rows, 1):
        speed, steering_angle = row.speed, row.steering_angle
        run = Run(speed, steering_angle, number, number, row.duration, -(-row.duration // PERIOD))
        if runs and runs[-1][:2] == run[:2]:
            earlier = runs.pop()
            run = run._replace(
                first=earlier.first,
                duration=earlier.duration + run.duration,
                expected=earlier.expected + run.expected,
            )
        runs.append(run)
    return runs


def judge(replay: Replay, tolerances: Tolerances) -> List[Check]:
    """Return every verdict on a replay, the most telling ones first."""
    checks = [Check("node", not replay.outcome, replay.outcome or "the node ran to its end")]
    if not replay.sent or not len(replay.stamps):
        missing = "no command came" if not replay.sent else "the car never reported its pose"
        names = ("start_pose", "commands", "rate", "path", "final_pose", "rest")
        checks += [Check(name, False, f"not judged: {missing}") for name in names]
    else:
        begin = _first_pose(replay)
        checks += [
            _judge_start(replay, begin, tolerances),
            _judge_commands(replay),
            _judge_rate(replay),
            *_judge_drive(replay, begin, tolerances),
            _judge_rest(replay),
        ]
    return [*checks, _judge_collisions(replay), _judge_map(replay)]


def verdict(checks: Sequence[Check], replay: Replay) -> str:
    """Return all the checks in one line: the first fault, or that there is none."""
    for check in checks:
        if not check.passed:
            return f"{check.name}: {check.message}"
    return "everything is right" + ("" if _stopped(replay) else ", but " + _NO_STOP)


_NO_STOP = (
    "the node sends no stop at the end, so the car rolls on until its last command runs out, "
    f"at most {SLACK:g} s"
)


def _stopped(replay: Replay) -> bool:
    """Say whether the node's last command is a stop."""
    return bool(replay.sent) and replay.sent[-1].speed == 0.0


def _first_pose(replay: Replay) -> int:
    """Return the index of the first pose of the drive: the one that the start pose made.

    That is the last one that the car cannot have driven to, up to shortly after the first command.
    """
    first = replay.sent[0].time
    late = int(np.searchsorted(replay.stamps, first + 2 * PERIOD))
    poses, seconds = replay.poses[:late], np.diff(replay.stamps[:late]) / NANOSECONDS
    speed, turn = _fastest(replay.plan, replay.car, _DEVIATIONS)
    x, y, theta = np.diff(poses, axis=0).T
    moved, rotated = np.hypot(x, y), np.abs(np.remainder(theta + np.pi, 2.0 * np.pi) - np.pi)
    jumps = np.flatnonzero(
        (moved > speed * seconds + _START_TOLERANCE) | (rotated > turn * seconds + _START_TOLERANCE)
    )
    placed = int(jumps[-1]) + 1 if len(jumps) else 0
    if len(jumps) and not replay.sent[0].stamped:
        return placed  # when the first command came is not known so well
    return max(placed, min(int(np.searchsorted(replay.stamps, first)), len(replay.stamps) - 1))


def _judge_start(replay: Replay, begin: int, tolerances: Tolerances) -> Check:
    """Judge whether the drive began at the plan's start pose."""
    wanted = Pose(*replay.plan.start)
    expected = f"expected the plan's {shown(wanted)}"
    if not replay.starts:
        return Check("start_pose", False, f"the node sent no start pose; {expected}")
    got = replay.starts[0]
    if not all(map(math.isfinite, got)):
        return Check("start_pose", False, f"the node sent the start pose {got}; {expected}")
    if apart(got, wanted) > _START_TOLERANCE or turned(got, wanted) > _START_TOLERANCE:
        return Check("start_pose", False, f"the node sent the start pose {shown(got)}; {expected}")
    there = Pose(*replay.poses[begin])
    passed = (
        apart(there, wanted) <= tolerances.position and turned(there, wanted) <= tolerances.angle
    )
    return Check("start_pose", passed, f"the car began at {shown(there)}; {expected}")


def _judge_commands(replay: Replay) -> Check:
    """Judge whether the commands are the plan's, in its order."""
    for number, sent in enumerate(replay.sent, 1):
        if not (math.isfinite(sent.speed) and math.isfinite(sent.steering_angle)):
            message = (
                f"command {number} has the speed {sent.speed:g} and the steering angle "
                f"{sent.steering_angle:g}; expected finite numbers"
            )
            return Check("commands", False, message)
    plan = runs_of(replay.plan)
    came = [group[0] for group in _groups(replay)]
    values = [run[:2] for run in plan]
    got = [(sent.speed, sent.steering_angle) for sent in came]
    if got == values:
        return Check("commands", True, f"{len(replay.sent)} commands, in the plan's order")
    place = next(
        (i for i, pair in enumerate(zip(got, values)) if pair[0] != pair[1]),
        min(len(got), len(values)),
    )
    if place == len(got):
        last = plan[place - 1].last
        message = f"the commands end with row {last} of {len(replay.plan.rows)}"
    elif place == len(values):
        message = f"after the last row came a command that the plan has not: {_said(*got[place])}"
    else:
        message = (
            f"where {_rows(plan[place])} of the plan has {_said(*values[place])}, "
            f"there came {_said(*got[place])}"
        )
        if sorted(got) == sorted(values):
            message = f"the rows are in the wrong order: {message}"
        elif (got[place][0], -got[place][1]) == values[place]:
            message += "; left is positive"
    return Check("commands", False, message)


def _groups(replay: Replay) -> List[List[Sent]]:
    """Return the commands in groups of equal neighbours, without a stop that ends a drive."""
    groups: List[List[Sent]] = []
    for sent in replay.sent:
        if groups and groups[-1][0][2:] == sent[2:]:
            groups[-1].append(sent)
        else:
            groups.append([sent])
    plan = runs_of(replay.plan)
    if groups[-1][0].speed == 0.0 and (
        len(groups) == len(plan) + 1 or plan[-1].speed != 0.0 and len(groups) > 1
    ):
        groups.pop()
    return groups


def _judge_rate(replay: Replay) -> Check:
    """Judge whether every row has ten commands a second and, by their stamps, evenly."""
    for run, group in zip(runs_of(replay.plan), _groups(replay)):
        if group[0][2:] != run[:2]:
            break  # which is a fault of the commands
        here = f"{_rows(run)} ({run.duration / NANOSECONDS:g} s)"
        times = [sent.time for sent in group]
        span = (times[-1] - times[0]) / NANOSECONDS
        stop = run.speed == 0.0 and run.last == len(replay.plan.rows)
        if len(group) != run.expected and not (stop and len(group) == run.expected + 1):
            pace = f", {(len(group) - 1) / span:.3g} a second" if span else ""
            message = f"{here} came with {_counted(len(group))}{pace}; expected {run.expected}"
            return Check("rate", False, f"{message}, {RATE} a second")
        if not all(sent.stamped for sent in group):
            continue  # when they came is known too roughly; the path tells
        for earlier, later in zip(times, times[1:]):
            if later < earlier:
                message = f"in {here} a stamp goes back by {(earlier - later) / NANOSECONDS:g} s"
                return Check("rate", False, f"{message}; expected rising stamps")
            if later - earlier > PERIOD + _JITTER:
                gap = (later - earlier) / NANOSECONDS
                message = f"in {here} nothing came for {gap:.3g} s"
                return Check("rate", False, f"{message}; expected a command every 0.1 s")
        if abs(span - run.duration / NANOSECONDS) > SLACK:
            message = f"the {len(group)} commands of {here} are stamped within {span:.3g} s"
            expected = f"expected {run.duration / NANOSECONDS:g} s, within {SLACK:g} s"
            return Check("rate", False, f"{message}; {expected}")
    return Check("rate", True, f"{RATE} commands a second in every row")


def _judge_drive(replay: Replay, begin: int, tolerances: Tolerances) -> List[Check]:
    """Judge the path that was driven, and where it ends."""
    _, driven, predicted = drive(replay, begin)
    leash = frechet_distance(driven[:, :2], predicted[:, :2])
    path = Check(
        "path",
        leash <= tolerances.path,
        f"the driven path is {leash:.3g} m from the predicted one where it is furthest; "
        f"allowed are {tolerances.path:.3g} m",
    )
    end, wanted = Pose(*driven[-1]), Pose(*predicted[-1])
    distance, angle = apart(end, wanted), turned(end, wanted)
    message = (
        f"the car ended at {shown(end)}, {distance:.3g} m and {angle:.3g} rad from {shown(wanted)}"
        f"; allowed are {tolerances.position:.3g} m and {tolerances.angle:.3g} rad"
    )
    passed = distance <= tolerances.position and angle <= tolerances.angle
    if not passed and not _stopped(replay):
        message += ". " + _NO_STOP[0].upper() + _NO_STOP[1:]
    return [path, Check("final_pose", passed, message)]


def drive(replay: Replay, begin: int) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the car was from the pose `begin` on, and where it should have been.

    Where the recording ends before the plan does, the car is taken to stand from there on. What
    follows the last move of both is left out.

    Returns:
        The instants, counted from the first command [s], N of them; the poses of the car then, and
        those that were predicted, N x 3 each: x [m], y [m], theta [rad].
    """
    poses = replay.poses[begin:]
    instants = (replay.stamps[begin:] - replay.sent[0].time).tolist()
    end = replay.plan.duration + _BRAKING
    step = max(NANOSECONDS // 50, (end - instants[-1]) // 10_000)
    instants += range(instants[-1] + step, end + step, step)
    standing = np.repeat(poses[-1:], len(instants) - len(poses), axis=0)
    poses = np.concatenate([poses, standing])
    predicted = predicted_poses(replay.plan, replay.car, instants)
    moves = np.flatnonzero(
        np.any(np.diff(poses, axis=0) != 0.0, axis=1)
        | np.any(np.diff(predicted, axis=0) != 0.0, axis=1)
    )
    last = int(moves[-1]) + 2 if len(moves) else 1
    return np.array(instants[:last]) / NANOSECONDS, poses[:last], predicted[:last]


def _judge_rest(replay: Replay) -> Check:
    """Judge whether the car stands at the end, and who made it stop."""
    tail = replay.stamps >= replay.stamps[-1] - replay.car.command_timeout
    passed = bool(np.all(replay.poses[tail] == replay.poses[-1]))
    message = "the car stands" if passed else "the car still drives; expected it to stand"
    return Check("rest", passed, message if _stopped(replay) else f"{message}; {_NO_STOP}")


def _judge_collisions(replay: Replay) -> Check:
    """Judge whether the car drove into a wall."""
    if replay.collisions is None:
        return Check("collision", True, "there are no walls")
    if replay.collisions:
        where = shown(replay.collisions[0])
        return Check("collision", False, f"the car drove into a wall at {where}")
    return Check("collision", True, "the car touched no wall")


def _judge_map(replay: Replay) -> Check:
    """Judge whether the car stayed on the map."""
    if replay.map_origin is None:
        return Check("map", True, "there is no map to leave")
    width, height = replay.map_size
    to_map = inverse(replay.map_origin)
    for pose in replay.poses:
        here = compose(to_map, Pose(*pose))
        if not (0.0 <= here.x <= width and 0.0 <= here.y <= height):
            message = f"the car left the map of {width:g} m x {height:g} m at {shown(Pose(*pose))}"
            return Check("map", False, message)
    return Check("map", True, f"the car stayed on the map of {width:g} m x {height:g} m")


def write(folder: str, replay: Replay, checks: Sequence[Check], facts: Dict[str, Any]) -> None:
    """Write report.json, trajectory.csv, locations.png and distances.png into `folder`.

    The last three are left out where the car has not been driven.

    Args:
        folder: made if it is not there.
        replay: what was seen.
        checks: the verdicts.
        facts: more that report.json is to hold, such as what was started.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    content = {
        **facts,
        "passed": all(check.passed for check in checks),
        "verdict": verdict(checks, replay),
        "checks": [check._asdict() for check in checks],
        "commands": len(replay.sent),
    }
    if replay.sent and len(replay.stamps):
        begin = _first_pose(replay)
        seconds, driven, predicted = drive(replay, begin)
        away = np.hypot(*(driven[:, :2] - replay.plan.start[:2]).T)
        names = ("x", "y", "theta")
        content["final_pose"] = dict(zip(names, driven[-1].tolist()))
        content["predicted_final_pose"] = dict(zip(names, predicted[-1].tolist()))
        content["frechet_distance"] = frechet_distance(driven[:, :2], predicted[:, :2])
        _write_trajectory(os.path.join(folder, "trajectory.csv"), seconds, driven, predicted, away)
        _draw(folder, replay.plan, seconds, driven, predicted, away)
    with open(os.path.join(folder, "report.json"), "w", encoding="ascii") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")


def _write_trajectory(
    path: str, seconds: np.ndarray, driven: np.ndarray, predicted: np.ndarray, away: np.ndarray
) -> None:
    """Write one line for each pose that the car reported."""
    columns = ["time", "x", "y", "theta", "predicted_x", "predicted_y", "predicted_theta"]
    with open(path, "w", encoding="ascii", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*columns, "distance_from_start"])
        for row in np.column_stack([seconds, driven, predicted, away]).tolist():
            writer.writerow([f"{row[0]:.9f}", *map(repr, row[1:])])


def _draw(
    folder: str,
    plan: Plan,
    seconds: np.ndarray,
    driven: np.ndarray,
    predicted: np.ndarray,
    away: np.ndarray,
) -> None:
    """Draw the two plots, without a display."""
    # Only who asks for plots has to wait for matplotlib, or to have it.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    def save(name: str, labels: Tuple[str, str], curves: Sequence[Tuple[Any, Any, str]]) -> None:
        figure = Figure(figsize=(7.0, 5.0), dpi=100.0)
        FigureCanvasAgg(figure)
        axes = figure.add_subplot(1, 1, 1)
        for (x, y, label), style in zip(curves, ("-", "--")):
            axes.plot(x, y, style, label=label)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        axes.set_title(os.path.basename(plan.path).replace("$", r"\$"))
        axes.grid(True)
        axes.legend()
        if name == "locations.png":
            axes.set_aspect("equal", "datalim")
        figure.savefig(os.path.join(folder, name))

    there = np.hypot(*(predicted[:, :2] - plan.start[:2]).T)
    save(
        "locations.png",
        ("x [m]", "y [m]"),
        [
            (driven[:, 0], driven[:, 1], "driven"),
            (predicted[:, 0], predicted[:, 1], "predicted"),
        ],
    )
    save(
        "distances.png",
        ("time [s]", "distance from the start [m]"),
        [(seconds, away, "driven"), (seconds, there, "predicted")],
    )


def _said(speed: float, steering_angle: float) -> str:
    """Return a command as text."""
    return f"{speed:g} m/s, {steering_angle:g} rad"


def _rows(run: Run) -> str:
    """Return which rows of the plan a run is."""
    if run.first == run.last:
        return f"row {run.first}"
    return f"rows {run.first} to {run.last}"


def _counted(number: int) -> str:
    """Return how many messages that is, as text."""
    return "1 message" if number == 1 else f"{number} messages"
