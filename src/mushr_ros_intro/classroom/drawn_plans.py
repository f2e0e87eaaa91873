"""Draw a plan for each submission, as difficult as a given plan.

The secret and the name of the submission determine the plan, on every machine and in every version
of this package: test/unit/classroom/test_drawn_plans.py holds some plans.
"""

import hashlib
import math
from itertools import count, groupby
from typing import Callable, Iterable, Iterator, List, Optional, Sequence, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan, PlanError, Row
from mushr_ros_intro.preview.prediction import legs_of
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.walls import map_fault
from mushr_ros_intro.replay.tolerances import compare, default_tolerances
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, is_free, on_map
from mushr_ros_intro.world.grid import Grid

DRAWN = "drawn"
"""Stands for the drawn plan in --plans, and is its name in the results."""

ATTEMPTS = 3000
"""Number of random plans of which the first one that fits is used."""

_REACH = 2.0
"""Largest distance of the first start poses from that of the given plan, in x and in y [m]."""

_GROWTH = 0.02
"""This limit grows with each attempt by this length [m]."""

Command = Tuple[float, float, int]
"""Speed [m/s], steering angle [rad], duration [ns]."""


def draw_plan(
    like: Plan, secret: str, name: str, check: Callable[[Plan], Report], grid: Optional[Grid]
) -> Plan:
    """Return a plan with the commands of another one in another order, on other sides.

    The number of rows, their speeds, radii and durations are the same. The plan is not symmetric,
    so rows in a wrong order or angles with the wrong sign change the final pose. A right node can
    drive it without hitting a wall; see `_variants`.

    Args:
        like: the other plan; its rows last whole tenths of a second.
        secret: of the course.
        name: of the submission.
        check: returns the report on a plan.
        grid: the map for which it checks plans, or None.

    Raises:
        UserError: no such plan has been found, or a row of the other plan lasts another time.
    """
    _refuse_other_durations(like)
    numbers, reason = _numbers(secret, name), ""
    for attempt in range(ATTEMPTS):
        rows = _shuffled(_runs(like.rows), numbers)
        start = _moved(like.start, _REACH + _GROWTH * attempt, numbers)
        if not _is_other(rows, like.rows):
            continue
        if grid and not (on_map(grid, Footprint(), start) and is_free(grid, Footprint(), start)):
            reason = reason or "the start pose is not free"
            continue  # this is faster than to check the plan
        report = check(Plan(like.path, start, tuple(rows)))
        if report.faults:
            reason = report.faults[0].text
        elif not _ends_elsewhere(report, check):
            reason = "steering angles with the wrong sign lead to the same final pose"
        elif grid and (fault := _variant_fault(report, grid)):
            reason = f"with one command more or less, {fault}"
        else:
            return report.plan
    reason = reason or "every other order of its rows is symmetric, or joins equal rows"
    text = f"{like.path}: found no plan for {name} in {ATTEMPTS} attempts, because {reason}"
    raise UserError(
        f"{text}. Expected at least three parts that differ in speed, radius or duration, such as "
        "test_drive, or a map with more space"
    )


def _numbers(secret: str, name: str) -> Iterator[float]:
    """Yield random numbers from 0 to 1, which depend on SHA-256 only."""
    for number in count():
        digest = hashlib.sha256(f"{secret}\0{name}\0{number}".encode()).digest()
        yield int.from_bytes(digest[:6], "big") / 2**48


def _refuse_other_durations(plan: Plan) -> None:
    """Raise PlanError if a row does not last whole tenths of a second."""
    expected = "expected whole tenths of a second, because a node sends ten commands per second"
    if faults := [
        plan.fault(index, 2, f"duration is {row.duration / NANOSECONDS:g} s; {expected}")
        for index, row in enumerate(plan.rows)
        if row.duration % COMMAND_PERIOD
    ]:
        raise PlanError(faults)


def _runs(rows: Iterable[Row]) -> List[List[Row]]:
    """Return rows in groups of equal neighbours."""
    return [list(group) for _, group in groupby(rows, lambda row: row[:2])]


def _commands(rows: Iterable[Row]) -> List[Command]:
    """Return one command for each group of equal neighbours."""
    return [(*run[0][:2], sum(row.duration for row in run)) for run in _runs(rows)]


def _shuffled(runs: Sequence[Sequence[Row]], numbers: Iterator[float]) -> List[Row]:
    """Return the rows of groups in a random order, each group on a random side."""
    rows: List[Row] = []
    for _, run in sorted((next(numbers), run) for run in runs):
        sign = 1.0 if next(numbers) < 0.5 else -1.0
        rows += [Row(row.speed, sign * row.steering_angle + 0.0, row.duration) for row in run]
    return rows


def _is_other(rows: Sequence[Row], like: Sequence[Row]) -> bool:
    """Return whether a plan differs from another one, has as many parts, and is not symmetric.

    A symmetric plan is the same from its end, or with the sides changed from its end.
    """
    commands, others = _commands(rows), _commands(like)
    back = commands[::-1]
    mirrored = [(speed, -angle + 0.0, time) for speed, angle, time in back]
    return len(commands) == len(others) and commands not in (others, back, mirrored)


def _ends_elsewhere(report: Report, check: Callable[[Plan], Report]) -> bool:
    """Return whether the wrong sign of all steering angles changes the final pose noticeably.

    A plan that only drives straight has no such mistake.
    """
    plan = report.plan
    rows = tuple(row._replace(steering_angle=-row.steering_angle + 0.0) for row in plan.rows)
    end = check(plan._replace(rows=rows)).final_pose
    tolerances = default_tolerances(plan, report.car)
    is_same, _ = compare(end, report.final_pose, tolerances.position, tolerances.angle)
    return rows == plan.rows or not is_same


def _variant_fault(report: Report, grid: Grid) -> str:
    """Return how a variant of a plan hits a wall or leaves the map; "" if none does."""
    for plan in _variants(report.plan):
        if fault := map_fault(plan, legs_of(plan, report.car), report.car, grid)[0]:
            return fault.text
    return ""


def _variants(plan: Plan) -> Iterator[Plan]:
    """Yield the plan with one command more or less, as right nodes may drive it.

    One border of two parts is early or late, or one part is longer or shorter: the last one if the
    node sends no stop, the first one if the node's first sleep is too short.
    """
    commands = _commands(plan.rows)
    for index in range(len(commands)):
        for change in (-COMMAND_PERIOD, COMMAND_PERIOD):
            rows = [Row(*each) for each in commands]
            for changed, sign in zip(range(index, len(rows))[:2], (1, -1)):
                duration = rows[changed].duration + sign * change
                rows[changed] = rows[changed]._replace(duration=duration)
                if min(row.duration for row in rows) > 0:
                    yield plan._replace(rows=tuple(rows))


def _moved(pose: Pose, reach: float, numbers: Iterator[float]) -> Pose:
    """Return a random pose with few digits, at most `reach` [m] away in x and in y."""
    x, y = (round(each + reach * (2.0 * next(numbers) - 1.0), 1) + 0.0 for each in pose[:2])
    return Pose(x, y, round(math.tau * next(numbers) - math.pi, 2) + 0.0)
