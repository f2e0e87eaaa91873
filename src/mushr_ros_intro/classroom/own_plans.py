"""Make a plan for each student, as difficult as a given plan; find the plan of a submission.

The plans and the table plans.csv are in one folder.
"""

import csv
import math
import os
import random
from itertools import groupby
from typing import Callable, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.classroom.csv_text import as_csv, plain
from mushr_ros_intro.classroom.grades import short_name
from mushr_ros_intro.classroom.store import make_folder, write_text
from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan, PlanError, Row
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.prediction import legs_of
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.walls import map_fault
from mushr_ros_intro.replay.tolerances import compare, default_tolerances
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, is_free, on_map
from mushr_ros_intro.world.grid import Grid

ATTEMPTS = 3000
"""Number of random plans of which a student's plan is the first that fits."""

TABLE = "plans.csv"

_REACH = 2.0
"""Largest distance of the first start poses from that of the given plan, in x and in y [m]."""

_GROWTH = 0.02
"""This limit grows with each attempt by this length [m]."""

_NAMES = ("name", "student", "full name")
_IDS = (
    *("id", "sid", "student id", "sis user id", "login", "sis login id", "username"),
    *("email", "e-mail", "email address"),
)
_HEADS = ("Name", "IDs", "Plan", "x [m]", "y [m]", "theta [rad]", "length [m]", "duration [s]")

Command = Tuple[float, float, int]
"""Speed [m/s], steering angle [rad], duration [ns]."""


class Person(NamedTuple):
    """A student in the table of the class."""

    name: str
    ids: Tuple[str, ...]
    """Such as a number, a login and an email address; at least one, or there is a name."""

    @property
    def key(self) -> str:
        """What the random numbers depend on, besides the seed."""
        return [*self.ids, self.name][0]


class OwnPlan(NamedTuple):
    """The plan of a student."""

    person: Person
    report: Report


def read_students(path: str) -> List[Person]:
    """Return the students in a CSV file, such as an export of Canvas or Gradescope.

    The first line has the names of the columns.

    Raises:
        UserError: the file cannot be read, or is something else, or a student occurs twice.
    """
    people: Dict[str, Person] = {}
    for line, values in _rows_of(path):
        name = next((values[each] for each in _NAMES if values.get(each)), "")
        name = name or f"{values.get('first name', '')} {values.get('last name', '')}".strip()
        person = Person(name, tuple(values[each] for each in _IDS if values.get(each)))
        if not any(values.values()) or name == "Points Possible":  # a line of Canvas
            continue
        if not (person.name or person.ids):
            raise UserError(f"{path}:{line}: the student has neither a name nor an ID")
        if person.key in people:
            raise UserError(f"{path}:{line}: the student {person.key} occurs twice")
        people[person.key] = person
    if not people:
        raise UserError(f"{path}: expected at least one student below the names of the columns")
    return list(people.values())


def _rows_of(path: str) -> List[Tuple[int, Dict[str, str]]]:
    """Return the number and the cells of each line of a CSV file, by the names of the columns.

    Raises:
        UserError: the file cannot be read, or has no column that identifies students.
    """
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            file.seek(0)
            reader = csv.reader(file, delimiter=";" if first.count(";") > first.count(",") else ",")
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (OSError, ValueError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path} cannot be read ({reason}); expected a CSV file") from None
    heads = [cell.lower() for cell in rows[0][1]] if rows else []
    known = [*_NAMES, "first name", *_IDS]
    if not set(heads) & set(known):
        raise UserError(f"{path}:1: expected the names of columns, one of: {', '.join(known)}")
    return [(line, dict(zip(heads, row))) for line, row in rows[1:]]


def make_plan(
    like: Plan, person: Person, seed: int, check: Callable[[Plan], Report], grid: Optional[Grid]
) -> OwnPlan:
    """Return a plan with the commands of another one in another order, on other sides.

    The number of rows, their speeds, radii and durations are the same. The plan is not symmetric,
    so rows in a wrong order or angles with the wrong sign change the final pose. A right node can
    drive it without hitting a wall; see `_variants`.

    Args:
        like: the other plan; its rows last whole tenths of a second.
        person: the student.
        seed: the same seed and student give the same plan.
        check: returns the report on a plan.
        grid: the map for which it checks plans, or None.

    Raises:
        UserError: no such plan has been found, or a row of the other plan lasts another time.
    """
    _refuse_other_durations(like)
    numbers = random.Random(f"{seed}:{person.key}")
    reason = ""
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
            return OwnPlan(person, report)
    if reason:
        text = (
            f"{like.path}: found no plan for {person.key} in {ATTEMPTS} attempts; in the last one"
        )
        raise UserError(f"{text}, {reason}. Expected another plan, or a map with more space")
    raise UserError(
        f"{like.path}: every other order of its rows is symmetric, or joins equal rows; expected a "
        "plan of at least three parts that differ in speed, radius or duration, such as test_drive"
    )


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


def _shuffled(runs: Sequence[Sequence[Row]], numbers: random.Random) -> List[Row]:
    """Return the rows of groups in a random order, each group on a random side.

    The result depends on `Random.random` only, which is the same in all versions of Python.
    """
    rows: List[Row] = []
    for _, run in sorted((numbers.random(), run) for run in runs):
        sign = 1.0 if numbers.random() < 0.5 else -1.0
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
    end, tolerances = (
        check(plan._replace(rows=rows)).final_pose,
        default_tolerances(plan, report.car),
    )
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


def _moved(pose: Pose, reach: float, numbers: random.Random) -> Pose:
    """Return a random pose with few digits, at most `reach` [m] away in x and in y."""
    x, y = (round(each + reach * (2.0 * numbers.random() - 1.0), 1) + 0.0 for each in pose[:2])
    return Pose(x, y, round(math.tau * numbers.random() - math.pi, 2) + 0.0)


def write_folder(folder: str, plans: Sequence[OwnPlan]) -> None:
    """Write the plans, and the table with their final poses.

    Raises:
        UserError: the folder is not empty.
        OSError: it cannot be written.
    """
    make_folder(folder, 0o700)
    if os.listdir(folder):
        raise UserError(f"--out {folder}: expected a new or empty folder")
    table: List[Sequence[str]] = [_HEADS]
    taken = {os.path.splitext(TABLE)[0]}
    for person, report in plans:
        base = name = short_name(person.name or person.key)
        number = 1
        while name.lower() in taken:
            number += 1
            name = f"{base}-{number}"
        taken.add(name.lower())
        name += ".txt"
        content = plan_text(report.plan.start, report.plan.rows)
        write_text(os.path.join(folder, name), content)
        x, y, theta = report.final_pose
        numbers = (x, y, math.remainder(theta, math.tau), report.length)
        values = [*(f"{each + 0.0:.4f}" for each in numbers), f"{_seconds(report.plan):g}"]
        table.append([person.name, "; ".join(map(plain, person.ids)), name, *values])
    write_text(os.path.join(folder, TABLE), as_csv(table))


def _seconds(plan: Plan) -> float:
    return plan.duration / NANOSECONDS


def summary(plans: Sequence[OwnPlan]) -> str:
    """Return a line about plans, of which there is at least one."""
    orders = len({tuple(_commands(report.plan.rows)) for _, report in plans})
    report = plans[0].report
    return (
        f"{len(plans)} plans of {report.length:.2f} m and {_seconds(report.plan):g} s, "
        f"with {orders} different orders of rows"
    )


class OwnPlans:
    """The plans in a folder of `write_folder`."""

    def __init__(self, folder: str) -> None:
        """Read the folder.

        Raises:
            UserError: the table or a plan cannot be read.
        """
        folder = os.path.abspath(folder)
        self.name = os.path.basename(folder)
        """The name of the plan in tables and points; the same for all students."""
        self._table = os.path.join(folder, TABLE)
        self.plans: List[Plan] = []
        self._plans: Dict[str, Optional[Plan]] = {}
        for line, row in _rows_of(self._table):
            if not row.get("plan"):
                raise UserError(f"{self._table}:{line}: expected the file of a plan")
            plan = read_plan(os.path.join(folder, row["plan"]))
            self.plans.append(plan)
            name, ids = row.get("name", ""), row.get("ids", "").split("; ")
            # The name of the plan's file has a number if several students have this name.
            names = {name, short_name(name or ids[0] or plan.name), *ids}
            for each in {plain(name).lower() for name in names if name}:
                self._plans[each] = None if each in self._plans else plan

    def find(self, submission: Submission) -> Optional[Plan]:
        """Return the plan of the first student of a submission who has one, or None.

        A name that two students share is not used.
        """
        students = submission.students
        names = [each for student in students for each in (student.canvas_id, *student[1:3])]
        names += [student.name for student in students]
        found = (self._plans.get(plain(each).lower()) for each in (*names, submission.name))
        return next((each for each in found if each), None)
