"""Turn results of grading into points.

docs/teach.md describes points.yaml. A check that is not judged counts as passed.
"""

import math
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import REQUIRED, Parameters, flag, number
from mushr_ros_intro.replay.following import FOLLOW_CHECK_NAMES, FollowTolerances
from mushr_ros_intro.replay.judge import CHECK_NAMES, Check
from mushr_ros_intro.replay.tolerances import Tolerances
from mushr_ros_intro.wording import counted
from mushr_ros_intro.yaml_file import read_mapping

_MOST = 1e6  # points of one check, and of a tolerance
_DECIMALS = 6  # of a sum, so that 0.1 + 0.2 is 0.3
_FORM = "keys such as 'default: {path: 3}' and 'plans: {figure_8: {path: 4}}'"
_OPTIONS = ("all_or_nothing", "hidden")


class PlanPoints(NamedTuple):
    """What one plan gives."""

    checks: Mapping[str, float] = dict.fromkeys((*CHECK_NAMES, *FOLLOW_CHECK_NAMES), 1.0)
    """The points of each check; a check that is missing gives 0."""
    all_or_nothing: bool = False
    """Whether it gives points only if all checks passed that give points."""
    hidden: bool = False
    """Whether students see it only after grades are published."""


class Points(NamedTuple):
    """What the graded plans give; `plans` are those that differ from the default."""

    plan_names: Tuple[str, ...] = ()
    default: PlanPoints = PlanPoints()
    plans: Mapping[str, PlanPoints] = {}
    check_names: Tuple[str, ...] = CHECK_NAMES
    """The checks of the plans, or of the paths that controllers follow."""
    tolerances: Mapping[str, float] = {}
    """Those that differ from the defaults, by the names in `Tolerances` or `FollowTolerances`."""

    def points(self, plan: str, check: str) -> float:
        """Return the points that a check of a plan gives if it passes."""
        return self._of(plan).checks.get(check, 0.0)

    def is_hidden(self, plan: str) -> bool:
        """Return whether students may not see a plan before grades are published."""
        return self._of(plan).hidden

    def max_score(self, plans: Optional[Iterable[str]] = None) -> float:
        """Return the points of all checks of plans; None means all graded plans."""
        names = self.plan_names if plans is None else plans
        return _sum(self.points(name, check) for name in names for check in self.check_names)

    def earned(self, plan: PlanGrade) -> List[float]:
        """Return the points that each check of a drive gives, in the order of its checks."""
        if self._failure(plan):
            return [0.0] * len(plan.checks)
        return [
            _sum([plan.share * self.points(plan.plan, each.name)])
            if each.passed or not each.is_judged
            else 0.0
            for each in plan.checks
        ]

    def rows(self, plan: PlanGrade) -> List[Tuple[Check, float]]:
        """Return the checks of a drive with their points: failures first, then those not judged."""
        return sorted(
            zip(plan.checks, self.earned(plan)),
            key=lambda row: 2 * row[0].passed or not row[0].is_judged,
        )

    def loss(self, plan: PlanGrade) -> str:
        """Return why a drive gives less than its checks give; "" if it does not."""
        if failure := self._failure(plan):
            return f"This plan gives 0 points, because {failure}."
        if plan.share < 1.0:
            what = "plan was driven right, from its start"
            if self.check_names == FOLLOW_CHECK_NAMES:
                what = "path was followed"
            share = f"{100.0 * plan.share:.3g} %"
            return f"{share} of the {what}. So the checks give {share} of their points."
        return ""

    def _failure(self, plan: PlanGrade) -> str:
        """Return why a drive gives no points whatever its checks give, or nothing."""
        if "topics" in plan.failed:
            return "the check topics failed"
        missed = [name for name in plan.failed if self.points(plan.plan, name)]
        if missed and self._of(plan.plan).all_or_nothing:
            return f"{counted(len(missed), 'check')} failed: {', '.join(missed)}"
        return ""

    def plan_score(self, plan: PlanGrade) -> float:
        """Return the points that a drive gives."""
        return _sum(self.earned(plan))

    def score(self, result: Grade) -> float:
        """Return the points of a submission; 0 also if there is no verdict (see Grade.error)."""
        return _sum(self.plan_score(plan) for plan in result.plans)

    def _of(self, plan: str) -> PlanPoints:
        return self.plans.get(plan, self.default)


def read_points(path: Optional[str], plan_names: Iterable[str], follows: bool = False) -> Points:
    """Return the points and tolerances in a file, or the default ones without a path.

    Args:
        path: of the file, or None.
        plan_names: the graded plans, or the paths that controllers follow.
        follows: whether they are paths.

    Raises:
        UserError: the file cannot be read, or an entry is not valid.
    """
    names = tuple(plan_names)
    check_names = FOLLOW_CHECK_NAMES if follows else CHECK_NAMES
    if path is None:
        return Points(names, check_names=check_names)
    values = _mapping(read_mapping(path, _FORM), f"{path}: ", ("default", "plans", "tolerances"))
    default = _plan_points(values.get("default"), f"{path}: default: ", None, check_names)
    remedy = ", or another file for --points; {} gives one point for each check"
    entries = _mapping(values.get("plans"), f"{path}: plans: ", names, remedy)
    plans = {
        name: _plan_points(entry, f"{path}: plans: {name}: ", default, check_names)
        for name, entry in entries.items()
    }
    place = f"{path}: tolerances: "
    known = FollowTolerances if follows else Tolerances
    given = _mapping(values.get("tolerances"), place, known._fields)
    tolerances = Parameters(given, place).read([number(n, REQUIRED, "", 0.0, _MOST) for n in given])
    points = Points(names, default, plans, check_names, tolerances)
    if not points.max_score():
        raise UserError(f"{path}: all checks give 0 points; expected points for at least one check")
    return points


def _plan_points(
    entry: Any, place: str, default: Optional[PlanPoints], check_names: Sequence[str]
) -> PlanPoints:
    """Return what the entry of a plan says, or the entry `default` if there is no default yet.

    Raises:
        UserError: the entry is not valid.
    """
    raw = _mapping(entry, place, (*check_names, *_OPTIONS))
    read = Parameters(raw, place)
    named = [name for name in check_names if name in raw]
    checks = read.read([number(name, REQUIRED, "points", 0.0, _MOST) for name in named])
    if default is None:
        default = PlanPoints({}) if checks else PlanPoints()
    options = read.read([flag(key, getattr(default, key)) for key in _OPTIONS])
    return PlanPoints({**default.checks, **checks}, *options.values())


def _mapping(value: Any, place: str, keys: Sequence[str], remedy: str = "") -> Dict[str, Any]:
    """Return a mapping with its keys as text; an empty value is an empty mapping.

    `remedy` is what a user can do about an unknown key, besides choosing one of `keys`.

    Raises:
        UserError: the value is something else, or has other keys than `keys`.
    """
    if not isinstance({} if value is None else value, dict):
        raise UserError(f"{place}the value is {value!r}; expected keys of {', '.join(keys)}")
    mapping = {str(key): each for key, each in (value or {}).items()}
    if unknown := [key for key in mapping if key not in keys]:
        text = f"{place}unknown key {unknown[0]}; expected one of {', '.join(keys)}"
        raise UserError(text + remedy)
    return mapping


def _sum(numbers: Iterable[float]) -> float:
    """Return the sum of points."""
    return round(math.fsum(numbers), _DECIMALS)
