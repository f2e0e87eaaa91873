"""Convert the result of one submission to results.json, the format of Gradescope."""

from typing import Any, Dict, Iterator, List

from mushr_ros_intro.classroom.csv_text import clean, shown
from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.wording import counted

_FOR_STUDENTS = (
    "Grading failed. This is not a fault of your submission. The instructor must grade it again."
)


def gradescope(result: Grade, points: Points) -> Dict[str, Any]:
    """Return results.json of Gradescope for one submission.

    Each check of each plan is a test. The tests of hidden plans are visible after grades are
    published, and the other text does not mention them. Without a verdict there is neither a score
    nor a test. Gradescope requires one of them, so it records no score of 0, and the instructor
    runs the autograder again.
    """
    report: Dict[str, Any] = {
        "output": "\n".join(_summary(result, points)),
        "output_format": "text",
        "test_output_format": "text",
        "test_name_format": "text",
        "stdout_visibility": "hidden",
    }
    if result.plans:
        report["tests"] = [*_tests(result, points)]
    elif not result.error:
        report["score"] = 0
    return report


def _tests(result: Grade, points: Points) -> Iterator[Dict[str, Any]]:
    """Yield the tests of a submission: one for each check."""
    for plan in result.plans:
        loss, is_hidden = points.loss(plan), points.is_hidden(plan.plan)
        for check, earned in zip(plan.checks, points.earned(plan)):
            yield {
                "name": f"{plan.plan}: {check.name}{'' if check.is_judged else ' (not judged)'}",
                "score": earned,
                "max_score": points.points(plan.plan, check.name),
                "status": "passed" if check.passed else "failed",
                "output": "\n".join(filter(None, [clean(check.message), loss])),
                "visibility": "after_published" if is_hidden else "visible",
            }


def _summary(result: Grade, points: Points) -> List[str]:
    """Return lines for the student: one for each plan that is not hidden."""
    if result.error:
        return [_FOR_STUDENTS]
    if not result.plans:
        return ["The submission could not be run.", clean(result.fault)]
    lines = []
    for plan in result.plans:
        if not points.is_hidden(plan.plan):
            lines.append(f"{plan.plan}: {_verdict(plan, points)}")
            lines += filter(None, [points.loss(plan)])
    return lines


def _verdict(plan: PlanGrade, points: Points) -> str:
    """Return which checks of a drive failed, and its points."""
    verdict = f"{counted(len(plan.failed), 'check')} failed: {', '.join(plan.failed)}"
    if count := sum(not check.is_judged for check in plan.checks):
        verdict += f", {count} not judged"
    verdict = "all checks passed" if plan.passed else verdict
    return f"{verdict} ({shown(points.plan_score(plan))} of {shown(points.max_score([plan.plan]))})"
