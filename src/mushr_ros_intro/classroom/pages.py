"""Show results as pages: an index, and one of each submission for the course and its students.

The pages load nothing. All text is escaped.
"""

import base64
from typing import Any, Sequence

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from mushr_ros_intro.classroom.csv_text import clean, shown
from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.plan.write import plan_text

FOLDER, STUDENTS = "submissions", "students"
"""The folders of the pages for the course and for the students, beside the index."""


def index_page(results: Sequence[Grade], points: Points) -> str:
    """Return the page with a summary of the class, and one row for each submission."""
    passed = sum(result.passed for result in results)
    faults = sum(bool(result.fault) for result in results)
    errors = sum(bool(result.error) for result in results)
    counts = [f"{passed} passed", f"{len(results) - passed - faults - errors} failed"]
    counts += [f"{faults} could not be run"] if faults else []
    counts += [f"{errors} not graded"] if errors else []
    drives = [[p for r in results for p in r.plans if p.plan == name] for name in points.plan_names]
    checks = [(check, [_counts(check, each) for each in drives]) for check in points.check_names]
    return _page(
        "index",
        results=results,
        points=points,
        counts=counts,
        class_checks=checks,
    )


def submission_page(result: Grade, points: Points) -> str:
    """Return the page of a submission for the course; it shows hidden plans, too."""
    return _page("submission", result=result, points=points, is_course=True, hidden_points=0.0)


def student_page(result: Grade, points: Points) -> str:
    """Return the page of a submission for its students.

    It shows no hidden plan, no other submission, and no error of the grading.
    """
    names = tuple(each for each in points.plan_names if not points.is_hidden(each))
    hidden = points.max_score() - points.max_score(names)
    plans = tuple(each for each in result.plans if each.plan in names)
    return _page(
        "submission",
        result=result._replace(plans=plans),
        points=points._replace(plan_names=names),
        is_course=False,
        hidden_points=hidden,
    )


def _page(template: str, **values: Any) -> str:
    """Return the page that a template in web/results describes."""
    environment = Environment(
        loader=FileSystemLoader(package_folder("web/results")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: clean(value) if type(value) is str else value,
    )
    environment.filters.update(
        points=shown,
        students=_students,
        plan_text=_plan_text,
        base64=lambda text: base64.b64encode(text.encode()).decode(),
    )
    return environment.get_template(f"{template}.jinja").render(**values)


def _students(result: Grade) -> str:
    """Return the names of the students, as they write them."""
    return ", ".join(each.name or each.id or each.email for each in result.students)


def _plan_text(plan: PlanGrade) -> str:
    """Return the text of the file of a plan; "" for a path that a controller follows."""
    driven = plan.judgement.recorded.plan
    return plan_text(driven.start, driven.rows) if isinstance(driven, Plan) else ""


def _counts(name: str, drives: Sequence[PlanGrade]) -> str:
    """Return how many drives passed a check, failed it, or were not judged."""
    checks = [check for drive in drives for check in drive.checks if check.name == name]
    passed = sum(check.passed for check in checks)
    failed = sum(check.is_judged and not check.passed for check in checks)
    counts = {"passed": passed, "failed": failed, "not judged": len(checks) - passed - failed}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
