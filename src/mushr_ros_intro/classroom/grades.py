"""The results of grading, as plain values that are stored as JSON."""

import json
import math
import os
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.replay.judge import Check, Judgement
from mushr_ros_intro.replay.recording import Drive

FOLDER = "data"
"""The folder of the results, in the output folder of grade.py."""

MAX_POINTS = 500
"""A stored path has at most so many points."""


class Student(NamedTuple):
    """One of the authors of a submission; fields that are not known are empty."""

    name: str
    id: str
    email: str


class PlanGrade(NamedTuple):
    """The verdict on one drive."""

    plan: str
    """The name of the plan."""
    checks: Tuple[Check, ...]
    """In the order of CHECK_NAMES."""
    verdict: str
    """The verdict as printed, in several lines; includes the last output of a failed node."""
    times: Tuple[float, ...]
    """Since the first command [s]; empty if there is no drive."""
    driven: Tuple[Tuple[float, float, float], ...]
    """The poses of the car at these times: x, y, theta [m, m, rad]."""
    predicted: Tuple[Tuple[float, float, float], ...]
    """The predicted poses at these times: x, y, theta [m, m, rad]."""

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)

    @property
    def drive(self) -> Optional[Drive]:
        """The drive without poses that are not finite; None if there is no drive."""
        poses = zip(self.times, self.driven, self.predicted)
        rows = np.array([[time, *driven, *predicted] for time, driven, predicted in poses])
        rows = rows.reshape(-1, 7)[np.isfinite(rows.reshape(-1, 7)).all(axis=1)]
        return Drive(rows[:, 0], rows[:, 1:4], rows[:, 4:], math.nan) if len(rows) else None


class Grade(NamedTuple):
    """The grading of one submission."""

    name: str
    """Of the submission; unique."""
    students: Tuple[Student, ...]
    fault: str
    """Why the submission could not be run; empty if it was run."""
    error: str
    """Why grading itself failed, so that there is no verdict; empty otherwise."""
    plans: Tuple[PlanGrade, ...]
    """In the order of the command line; empty if there is a fault or an error."""
    notes: Tuple[str, ...] = ()
    """What is unusual about the submission, although it can be run."""

    @property
    def passed(self) -> bool:
        """Whether every check of every plan passed."""
        return bool(self.plans) and all(plan.passed for plan in self.plans)


def plan_grade(name: str, report: Judgement) -> PlanGrade:
    """Return the verdict of a report on a plan with a name."""
    drive = report.drive
    chosen = np.unique(np.linspace(0, len(drive.times) - 1, MAX_POINTS).astype(int))
    times, driven, predicted = (
        np.round(each[chosen], 4).tolist() for each in (drive.times, drive.driven, drive.predicted)
    )
    return PlanGrade(
        name,
        tuple(report.checks),
        report.verdict,
        tuple(times),
        tuple(map(tuple, driven)),
        tuple(map(tuple, predicted)),
    )


def to_json(result: Grade) -> Dict[str, Any]:
    """Return a result as a JSON object."""
    return {
        **result._asdict(),
        "students": [student._asdict() for student in result.students],
        "plans": [
            {**plan._asdict(), "checks": [check._asdict() for check in plan.checks]}
            for plan in result.plans
        ],
    }


def from_json(value: Dict[str, Any]) -> Grade:
    """Return the result that `to_json` has converted.

    Raises:
        KeyError, TypeError: the value is something else.
    """
    plans = tuple(
        PlanGrade(
            **{
                **plan,
                "checks": tuple(Check(**check) for check in plan["checks"]),
                "times": tuple(plan["times"]),
                "driven": tuple(map(tuple, plan["driven"])),
                "predicted": tuple(map(tuple, plan["predicted"])),
            }
        )
        for plan in value["plans"]
    )
    students = tuple(Student(**student) for student in value["students"])
    notes = tuple(value["notes"])
    return Grade(**{**value, "students": students, "plans": plans, "notes": notes})


def store(folder: str, results: Iterable[Grade]) -> None:
    """Write each result to NAME.json in a folder.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    for result in results:
        path = os.path.join(folder, f"{result.name}.json")
        with open(path, "w", encoding="ascii") as file:
            json.dump(to_json(result), file)


def load(folder: str) -> List[Grade]:
    """Return the results that `store` has written, in the order of their names.

    Raises:
        OSError: a file cannot be read.
        ValueError, KeyError, TypeError: a file is something else.
    """
    results = []
    for name in sorted(os.listdir(folder)):
        if name.endswith(".json"):
            with open(os.path.join(folder, name), encoding="ascii") as file:
                results.append(from_json(json.load(file)))
    return results
