"""Show the result of a submission as a page: one for the course, and one for its students."""

import re
from typing import List

from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.classroom.html_page import (
    NOT_GRADED,
    NOT_RUN,
    escaped,
    page,
    picture,
    plan_title,
    shown,
    table,
    verdict,
)
from mushr_ros_intro.classroom.points import Points

FOLDER, STUDENTS = "submissions", "students"
"""The folders of the pages for the course and for the students, beside the index."""

_NOT_IN_FILE_NAME = re.compile("[\x00-\x1f/\\\\%\ud800-\udfff]")


def file_name(name: str) -> str:
    """Return the file name of the page of a submission; different names have different pages."""
    return _NOT_IN_FILE_NAME.sub(lambda match: f"%{ord(match[0]):02X}", name) + ".html"


def submission_page(result: Grade, points: Points) -> str:
    """Return the page of a submission for the course; it shows hidden plans, too."""
    parts = ['<p><a href="../index.html">All submissions</a></p>', *_head(result, points)]
    if result.error:
        parts.append(f"<pre>{escaped(result.error)}</pre>")
    parts += [_section(number, plan, points) for number, plan in enumerate(result.plans, 1)]
    return page(escaped(result.name), "\n".join([*parts, _source(result)]))


def student_page(result: Grade, points: Points) -> str:
    """Return the page of a submission for its students.

    It shows no hidden plan, no other submission, and no error of the grading.
    """
    names = [each for each in points.plan_names if not points.is_hidden(each)]
    plans = tuple(each for each in result.plans if each.plan in names)
    hidden = points.max_score() - points.max_score(names)
    points, result = points._replace(plan_names=tuple(names)), result._replace(plans=plans)
    parts = _head(result, points)
    if hidden:
        text = f"Other plans, which this page does not show, give up to {shown(hidden)} points."
        parts.append(f"<p>{text}</p>")
    parts += [_section(number, plan, points) for number, plan in enumerate(plans, 1)]
    return page(escaped(result.name), "\n".join([*parts, _source(result)]))


def _head(result: Grade, points: Points) -> List[str]:
    """Return the parts of a page above the plans."""
    parts = [f"<h1>{escaped(result.name)}</h1>"]
    parts += [f"<p>{escaped(', '.join(filter(None, student)))}</p>" for student in result.students]
    if result.error:
        text = "grading failed, which is not a fault of the submission. It must be graded again."
        parts.append(f"<p>{NOT_GRADED}: {text}</p>")
    else:
        score, most = shown(points.score(result)), shown(points.max_score())
        mark = f"{verdict(result.passed)}, " if result.plans else ""
        parts.append(f"<p>{mark}{score} of {most} points</p>")
    if result.fault:
        parts.append(f"<p>{NOT_RUN}: the submission could not be run.</p>")
        parts.append(f"<pre>{escaped(result.fault)}</pre>")
    return parts + [f"<p>Note: {escaped(note)}</p>" for note in result.notes]


def _source(result: Grade) -> str:
    return _folded("The node", result.source) if result.source else ""


def _folded(title: str, text: str) -> str:
    return f"<details><summary>{title}</summary>\n<pre>{escaped(text)}</pre>\n</details>"


def _section(number: int, plan: PlanGrade, points: Points) -> str:
    """Return the part of a page about one drive."""
    score, most = shown(points.plan_score(plan)), shown(points.max_score([plan.plan]))
    title = plan_title(plan.plan, points)
    parts = [
        f'<section id="plan-{number}">\n<h2>{title}: {verdict(plan.passed)}, {score} of {most} '
        "points</h2>"
    ]
    if loss := points.loss(plan):
        parts.append(f"<p>{escaped(loss)}</p>")
    heads = ("Check", "Verdict", "Points", "Message")
    parts.append(table("cards checks", heads, _check_rows(plan, points)))
    parts += [f"<p>{escaped(each.capitalize())}</p>" for each in plan.notes]
    if drive := plan.drive:
        parts.append(_figure(picture("locations", plan), "paths"))
        distances, largest = drive.distances, int(drive.distances.argmax())
        caption = "distance between the driven and the predicted position at the same time"
        if any(check.name == "cross_track" for check in plan.checks):  # of a controller
            caption = "distance between the driven position and the nearest point of the path"
        caption += (
            f"; the largest is {distances[largest]:.3g} m at {drive.times[largest]:.3g} s, the "
            f"last is {distances[-1]:.3g} m"
        )
        parts.append(_figure(picture("distances", plan), caption))
    else:
        parts.append("<p>There is no drive to show.</p>")
    if plan.output:
        parts.append(_folded("The output of the node, or its end", plan.output))
    return "\n".join([*parts, "</section>"])


def _figure(image: str, caption: str) -> str:
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _check_rows(plan: PlanGrade, points: Points) -> List[str]:
    """Return the rows of the checks of a drive: failures first, those not judged after them."""
    rows = sorted(
        zip(plan.checks, points.earned(plan)),
        key=lambda row: 2 * row[0].passed or not row[0].is_judged,
    )
    return [
        f'<tr><th scope="row">{escaped(check.name)}</th>'
        f"<td>{verdict(check.passed, check.is_judged)}</td>"
        f'<td class="number">{shown(earned)} / {shown(points.points(plan.plan, check.name))}</td>'
        f'<td class="message wide">{escaped(check.message)}</td></tr>'
        for check, earned in rows
    ]
