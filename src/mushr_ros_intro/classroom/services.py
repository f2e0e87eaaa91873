"""Write the result of one submission for grading services: Gradescope, Classroom 50, GitHub."""

import argparse
import json
import math
import os
import time
from itertools import groupby
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence

from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.html_page import clean, shown
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.classroom.store import write_text
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.wording import counted

_CLASSROOM_50 = {
    "classroom": "CLASSROOM",
    "assignment": "ASSIGNMENT",
    "submission": "SUBMISSION_TAG",
    "commit": "COMMIT_URL",
    "release": "RELEASE_URL",
    "review": "REVIEW_URL",
}
"""The fields of a result for Classroom 50, and their environment variables."""

_FOR_STUDENTS = (
    "Grading failed. This is not a fault of your submission. The instructor must grade it again."
)


_NOT_JUDGED = " (not judged)"


class _Test(NamedTuple):
    """What a grading service shows as one test."""

    plan: str
    hidden: bool
    name: str
    number: str
    status: str
    """pass, fail or error."""
    score: float
    max_score: float
    message: str


def write_results(
    arguments: argparse.Namespace, result: Grade, points: Points, seconds: float
) -> None:
    """Write the result of a submission to the files that the command line names.

    Args:
        arguments: the command line.
        result: of the submission.
        points: what the plans give.
        seconds: the time that grading took [s].

    Raises:
        UserError: Classroom 50 takes no fractions of points.
        OSError: a file cannot be written.
    """
    formats = {
        arguments.gradescope: lambda: gradescope(result, points, seconds),
        arguments.classroom50: lambda: classroom50(result, points, os.environ, time.time()),
        arguments.github: lambda: github(result, points),
    }
    for path, convert in formats.items():
        if path is not None:
            write_text(path, json.dumps(convert(), indent=2))
    if arguments.classroom50 is not None:
        folder = os.path.dirname(arguments.classroom50)
        write_text(os.path.join(folder, "release-body.md"), release_body(result, points))


def gradescope(result: Grade, points: Points, seconds: float) -> Dict[str, Any]:
    """Return results.json of Gradescope for one submission.

    Each check of each plan is a test. The tests of hidden plans are visible after grades are
    published, and the other text does not mention them. Without a verdict there is neither a score
    nor a test. Gradescope requires one of them, so it records no score of 0, and the instructor
    runs the autograder again.

    Args:
        result: of the submission.
        points: what the plans give.
        seconds: the time that grading took [s].
    """
    lines = [_FOR_STUDENTS] if result.error else _summary(result, points)
    report: Dict[str, Any] = {
        "execution_time": _number(seconds),
        "output": "\n".join(lines),
        "output_format": "text",
        "test_output_format": "text",
        "test_name_format": "text",
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "extra_data": {},
    }
    if not result.error:
        report["tests"] = [
            {
                "score": _number(test.score),
                "max_score": _number(test.max_score),
                "status": "passed" if test.status == "pass" else "failed",
                "name": test.name,
                "number": test.number,
                "output": test.message,
                "output_format": "text",
                "tags": [],
                "visibility": "after_published" if test.hidden else "visible",
            }
            for test in _tests(result, points)
        ]
    return report


def classroom50(
    result: Grade, points: Points, environment: Mapping[str, str], now: float
) -> Dict[str, Any]:
    """Return result.json of Classroom 50 for one submission.

    Students see all of it, so each hidden plan is a single test without its name. Without a
    verdict there is one failed test; do not publish it.

    Args:
        result: of the submission.
        points: what the plans give.
        environment: the environment variables of the action.
        now: the current time [s since 1970].

    Raises:
        UserError: a check gives a fraction of a point.
    """
    tests = _merged(_tests(result, points))
    for test in tests:
        if test.max_score != int(test.max_score):
            raise UserError(
                f"{test.name} gives {shown(test.max_score)} points; expected whole numbers "
                "of points, because Classroom 50 takes no fractions"
            )
    return {
        "schema": "classroom50/result/v1",
        **{field: environment.get(name, "") for field, name in _CLASSROOM_50.items()},
        "datetime": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(now)),
        "score": sum(int(test.score) for test in tests),
        "max-score": sum(int(test.max_score) for test in tests),
        "tests": [
            {
                "test-name": test.name,
                "passed": test.status == "pass",
                "score": int(test.score),
                "max-score": int(test.max_score),
                "message": test.message,
            }
            for test in tests
        ],
    }


def release_body(result: Grade, points: Points) -> str:
    """Return the text of the release in which Classroom 50 shows a result to its student.

    It has the points of `classroom50`, which are whole numbers.
    """
    lines = [_FOR_STUDENTS] if result.error else []
    tests = _merged(_tests(result, points))
    for test in tests:
        state = "passed" if test.status == "pass" else "FAILED"
        state = "--" if test.name.endswith(_NOT_JUDGED) else state
        lines.append(f"{state} {test.name}, {int(test.score)} of {shown(test.max_score)}")
        lines += [f"    {line}" for line in test.message.splitlines()]
    text = "\n".join(f"    {line}" for line in lines)  # Markdown shows such lines as they are
    score = sum(int(test.score) for test in tests)
    return f"**{score} of {shown(points.max_score())} points**\n\n{text}\n"


def github(result: Grade, points: Points) -> Dict[str, Any]:
    """Return the result of one submission for the autograding actions of GitHub.

    Students see all of it, so each hidden plan is a single test without its name and messages.
    """
    tests = _merged(_tests(result, points))
    status = "error" if result.error else "pass" if result.passed else "fail"
    return {
        "version": 1,
        "status": status,
        "max_score": _number(points.max_score()),
        "tests": [
            {
                "name": test.name,
                "status": test.status,
                "score": _number(test.score),
                "message": test.message,
                "test_code": "",
                "filename": "",
                "line_no": 0,
                "duration": 0,
            }
            for test in tests
        ],
    }


def _tests(result: Grade, points: Points) -> List[_Test]:
    """Return the tests of a submission: one for each check, or one if there is no drive."""
    if result.error or result.fault or not result.plans:
        status = "error" if result.error else "fail"
        message = _FOR_STUDENTS if result.error else clean(result.fault)
        return [_Test("", False, "submission", "1", status, 0.0, points.max_score(), message)]
    tests = []
    for row, plan in enumerate(result.plans, 1):
        loss = points.loss(plan)
        for column, (check, earned) in enumerate(zip(plan.checks, points.earned(plan)), 1):
            lines = [clean(check.message), loss] if loss else [clean(check.message)]
            test = _Test(
                plan.plan,
                points.is_hidden(plan.plan),
                f"{plan.plan}: {check.name}{'' if check.is_judged else _NOT_JUDGED}",
                f"{row}.{column}",
                "pass" if check.passed else "fail",
                earned,
                points.points(plan.plan, check.name),
                "\n".join(lines),
            )
            tests.append(test)
    return tests


def _merged(tests: Sequence[_Test]) -> List[_Test]:
    """Return tests that do not show the checks of hidden plans: one test for each such plan."""
    merged = [test for test in tests if not test.hidden]
    hidden = [[*group] for _, group in groupby(tests, lambda test: test.hidden and test.plan)]
    for index, group in enumerate((each for each in hidden if each[0].hidden), 1):
        status = "pass" if all(test.status == "pass" for test in group) else "fail"
        score = math.fsum(test.score for test in group)
        most = math.fsum(test.max_score for test in group)
        first = group[0]._replace(name=f"hidden plan {index}", status=status, message="")
        merged.append(first._replace(score=score, max_score=most))
    return merged


def _summary(result: Grade, points: Points) -> List[str]:
    """Return lines for the student: one for each plan that is not hidden."""
    if result.fault or not result.plans:
        return ["The submission could not be run."]
    lines = []
    for plan in result.plans:
        if not points.is_hidden(plan.plan):
            failed = [check.name for check in plan.checks if check.is_judged and not check.passed]
            verdict = f"{counted(len(failed), 'check')} failed: {', '.join(failed)}"
            if count := sum(not check.is_judged for check in plan.checks):
                verdict += f", {count} not judged"
            verdict = "all checks passed" if plan.passed else verdict
            score, most = points.plan_score(plan), points.max_score([plan.plan])
            lines.append(f"{plan.plan}: {verdict} ({shown(score)} of {shown(most)})")
            lines += filter(None, [points.loss(plan)])
    return lines


def _number(value: float) -> float:
    """Return a number of points or seconds, as an integer if it is whole."""
    return int(value) if value == int(value) else round(value, 6)
