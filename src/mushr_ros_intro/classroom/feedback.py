"""Read points and comments that a course gives by hand.

A file feedback.yaml has the names of submissions, as in the first column of grades.csv:

    ann: {points: -2, comment: "Two days late."}
    bob: {points: 1, comment: "The comments in your code are good."}

The points are added to the score of the submission, which is at least 0.
"""

from typing import Any, Dict, Iterable, NamedTuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.wording import similar
from mushr_ros_intro.yaml_file import read_mapping

_MAX_POINTS = 1e6
_FORM = "names of submissions with points and comments, such as 'ann: {points: -2, comment: late}'"


class Feedback(NamedTuple):
    """What a course says about a submission."""

    points: float = 0.0
    """These are added to the score; may be negative."""
    comment: str = ""


def read_feedback(path: str, names: Iterable[str]) -> Dict[str, Feedback]:
    """Return the feedback in a file by the names of the submissions; none for the path "".

    Args:
        path: the file.
        names: of all submissions.

    Raises:
        UserError: the file cannot be read, names another submission, or an entry is not valid.
    """
    known = list(names)
    found = {}
    for key, value in (read_mapping(path, _FORM) if path else {}).items():
        name = str(key)
        if name not in known:
            raise UserError(f"{path}: there is no submission {name}{similar(name, known)}")
        found[name] = _feedback(value, f"{path}: {name}: ")
    return found


def _feedback(value: Any, place: str) -> Feedback:
    """Return an entry.

    Raises:
        UserError: it is not valid.
    """
    if not isinstance(value, dict):
        raise UserError(f"{place}the value is {value!r}; expected {_FORM}")
    entry = Parameters(value, place)
    entry.check_names("points", "comment")
    points = entry.number("points", 0.0, "points", -_MAX_POINTS, _MAX_POINTS)
    return Feedback(points, str(value.get("comment") or "").strip())
