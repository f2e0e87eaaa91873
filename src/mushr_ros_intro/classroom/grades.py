"""The results of grading, as plain values that become JSON."""

import hashlib
import math
import re
import unicodedata
from collections import Counter
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.replay.judge import Check, Judgement
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.wording import similar

MAX_POINTS = 500
"""Limit of the number of points of a stored path."""


class Student(NamedTuple):
    """One of the authors of a submission; fields that are not known are empty."""

    name: str
    id: str
    """Of the school, which Canvas calls SIS ID."""
    email: str
    canvas_id: str = ""
    """Canvas's own number."""


class PlanGrade(NamedTuple):
    """The verdict on one drive."""

    plan: str
    """The name of the plan."""
    checks: Tuple[Check, ...]
    """In the order of CHECK_NAMES."""
    verdict: str
    """The verdict as printed, in several lines; includes the last output of a failed node."""
    output: str
    """The end of the node's output."""
    seconds: float
    """The duration of the replay [s of wall-clock time]."""
    times: Tuple[float, ...]
    """Since the first command [s]; empty if there is no drive."""
    driven: Tuple[Tuple[float, float, float], ...]
    """The poses of the car at these times: x, y, theta [m, m, rad]."""
    predicted: Tuple[Tuple[float, float, float], ...]
    """The predicted poses at these times: x, y, theta [m, m, rad]."""
    pictures: Mapping[str, str] = {}
    """Pictures of the drive as SVG, by name; see `replay.pictures.as_texts`."""

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)

    @property
    def has_commands(self) -> bool:
        """Whether the node has sent a command to drive; otherwise most checks are not judged."""
        others = (
            check for check in self.checks if check.name not in ("node", "topics", "commands")
        )
        return any(check.is_judged for check in others)

    @property
    def notes(self) -> List[str]:
        """The lines of the verdict with notes."""
        return [line for line in self.verdict.splitlines() if line.startswith("note: ")]

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
    source: str = ""
    """The text of the node."""

    @property
    def passed(self) -> bool:
        """Whether every check of every plan passed."""
        return bool(self.plans) and all(plan.passed for plan in self.plans)


def short_name(name: str) -> str:
    """Return a name as part of a file name, with only letters, digits, dots, "_" and "-".

    If it is not ASCII or too long, it ends with a hash. It does not depend on the other names, as a
    number would, so that no result moves to another student when one of them leaves.
    """
    original = unicodedata.normalize("NFKD", name)  # the same for all forms of an accent
    text = original.encode("ascii", "ignore").decode()[:100]
    base = re.sub(r"[^A-Za-z0-9._-]+", "_", text).strip("._-") or "submission"
    if text != original:
        digest = hashlib.sha256(original.encode("utf-8", "surrogatepass")).hexdigest()
        base = f"{base}-{digest[:6]}"
    return base


def names_of(all_students: Mapping[str, Iterable[Student]]) -> Dict[str, str]:
    """Return the names of submissions by what a user may type: these names, and students' names.

    A student of several submissions has none of them.

    Args:
        all_students: the students of each submission, by its name.
    """
    pairs = {
        (unicodedata.normalize("NFC", each.name), name)
        for name, students in all_students.items()
        for each in students
        if each.name
    }
    counts = Counter(student for student, _ in pairs)
    found = {student: name for student, name in pairs if counts[student] == 1}
    return {**found, **{name: name for name in all_students}}


def find_name(text: str, names: Mapping[str, str], place: str) -> str:
    """Return the name of the submission that a user means; raise UserError if there is none.

    Args:
        text: what the user typed.
        names: see `names_of`.
        place: where it was typed, for the message.
    """
    name = names.get(unicodedata.normalize("NFC", text))
    if name is None:
        raise UserError(f"{place}there is no submission {text}{similar(text, names)}")
    return name


def thinned(rows: np.ndarray) -> np.ndarray:
    """Return at most MAX_POINTS rows, evenly spaced, with the first and the last one."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, MAX_POINTS).astype(int))]


def plan_grade(name: str, judgement: Judgement, shorten: Callable[[str], str]) -> PlanGrade:
    """Return the verdict on a drive of the plan `name`.

    `shorten` removes the paths of this machine from a text.
    """
    drive = judgement.drive
    times, driven, predicted = (
        np.round(thinned(each), 4).tolist() for each in (drive.times, drive.driven, drive.predicted)
    )
    return PlanGrade(
        name,
        tuple(check._replace(message=shorten(check.message)) for check in judgement.checks),
        shorten(judgement.verdict),
        shorten(judgement.recorded.output),
        round(judgement.recorded.seconds, 3),
        tuple(times),
        tuple(map(tuple, driven)),
        tuple(map(tuple, predicted)),
    )


def plan_to_json(plan: PlanGrade) -> Dict[str, Any]:
    """Return a verdict on a drive as a JSON object."""
    return {**plan._asdict(), "checks": [check._asdict() for check in plan.checks]}


def plan_from_json(value: Dict[str, Any]) -> PlanGrade:
    """Return the verdict that `plan_to_json` has converted.

    Raises:
        KeyError, TypeError: the value is something else.
    """
    changes = {
        "checks": tuple(Check(**check) for check in value["checks"]),
        "times": tuple(value["times"]),
        "driven": tuple(map(tuple, value["driven"])),
        "predicted": tuple(map(tuple, value["predicted"])),
    }
    return PlanGrade(**{**value, **changes})
