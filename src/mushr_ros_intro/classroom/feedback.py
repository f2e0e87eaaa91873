"""Read points and comments that a course gives by hand.

A file feedback.yaml has the names of submissions or of students, as in the first two columns of
grades.csv:

    ann: {points: -2, comment: "Two days late."}
    bob: {points: 1, comment: "The comments in your code are good."}

The points are added to the score of the submission, which is at least 0.
"""

from typing import Any, Dict, Mapping, NamedTuple

from mushr_ros_intro.classroom.grades import find_name
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.yaml_file import read_mapping

_MAX_POINTS = 1e6
_FORM = "names of submissions with points and comments, such as 'ann: {points: -2, comment: late}'"


class Feedback(NamedTuple):
    """What a course says about a submission."""

    points: float = 0.0
    """These are added to the score; may be negative."""
    comment: str = ""


def read_feedback(path: str, names: Mapping[str, str]) -> Dict[str, Feedback]:
    """Return the feedback in a file by the names of the submissions; none for the path "".

    Args:
        path: the file.
        names: of all submissions; see `names_of`.

    Raises:
        UserError: the file cannot be read, names another submission or one twice, or an entry is
            not valid.
    """
    found: Dict[str, Feedback] = {}
    for key, value in (read_mapping(path, _FORM) if path else {}).items():
        name = find_name(str(key), names, f"{path}: ")
        if name in found:
            raise UserError(f"{path}: {key}: expected one entry for the submission {name}")
        found[name] = _feedback(value, f"{path}: {key}: ")
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
