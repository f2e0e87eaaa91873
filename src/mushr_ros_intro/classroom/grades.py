"""The results of grading."""

import hashlib
import re
import unicodedata
from typing import List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.replay.judge import Check, Judgement
from mushr_ros_intro.replay.recording import Recorded


class Student(NamedTuple):
    """One of the authors of a submission; fields that are not known are empty."""

    name: str
    id: str
    """Of the school, which Canvas calls SIS ID."""
    email: str
    canvas_id: str = ""
    """Canvas's own number."""


class StoredDrive(NamedTuple):
    """One plan, driven by a submission."""

    plan: str
    """The name of the plan."""
    key: str
    """A hash of what the drive depends on."""
    fault: str
    """Why the submission cannot be built; empty if it was driven."""
    recorded: Optional[Recorded]
    """The drive, with the plan; of the map, only the size. None if there is a fault, or if it must
    be driven."""


class PlanGrade(NamedTuple):
    """The verdict on one drive."""

    plan: str
    """The name of the plan."""
    judgement: Judgement
    share: float = 1.0
    """Which share of the plan, or of the path, was driven right; 0 to 1."""
    picture: str = ""
    """The drive as SVG, if a check failed."""

    @property
    def checks(self) -> Sequence[Check]:
        """The checks, in the order of CHECK_NAMES."""
        return self.judgement.checks

    @property
    def failed(self) -> List[str]:
        """The names of the checks that failed, without those that were not judged."""
        return [each.name for each in self.checks if each.is_judged and not each.passed]

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return self.judgement.passed


class Grade(NamedTuple):
    """The grading of one submission, which is stored without `plans`."""

    name: str
    """Of the submission; unique."""
    students: Tuple[Student, ...]
    fault: str
    """Why the submission could not be run; empty if it was run."""
    error: str
    """Why grading itself failed, so that there is no verdict; empty otherwise."""
    notes: Tuple[str, ...] = ()
    """What is unusual about the submission, although it can be run."""
    source: str = ""
    """The text of the node."""
    drives: Tuple[StoredDrive, ...] = ()
    """In the order of the command line."""
    plans: Tuple[PlanGrade, ...] = ()
    """The verdicts on them; empty if there is a fault or an error."""

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
