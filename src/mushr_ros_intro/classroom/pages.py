"""Show the result of a submission as a page for the course. It shows hidden plans, too."""

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
    verdict,
)
from mushr_ros_intro.classroom.points import Points

FOLDER = "submissions"
"""The folder of the pages of submissions, beside the index."""

_NOT_IN_FILE_NAME = re.compile("[\x00-\x1f/\\\\%\ud800-\udfff]")


def file_name(name: str) -> str:
    """Return the file name of the page of a submission; different names have different pages."""
    return _NOT_IN_FILE_NAME.sub(lambda match: f"%{ord(match[0]):02X}", name) + ".html"


def submission_page(result: Grade, points: Points) -> str:
    """Return the page of a submission, with all checks, drawings and the output of its node."""
    parts = [f'<p><a href="../index.html">All submissions</a></p>\n<h1>{escaped(result.name)}</h1>']
    parts += [f"<p>{escaped(', '.join(filter(None, student)))}</p>" for student in result.students]
    if result.error:
        parts.append(f"<p>{NOT_GRADED}: grading failed. Grade this submission again.</p>")
        parts.append(f"<pre>{escaped(result.error)}</pre>")
    else:
        score, most = shown(points.score(result)), shown(points.max_score())
        parts.append(f"<p>{verdict(result.passed)}, {score} of {most} points</p>")
    if result.fault:
        parts.append(f"<p>{NOT_RUN}: the submission could not be run.</p>")
        parts.append(f"<pre>{escaped(result.fault)}</pre>")
    parts += [f"<p>Note: {escaped(note)}</p>" for note in result.notes]
    parts += [_section(number, plan, points) for number, plan in enumerate(result.plans, 1)]
    return page(escaped(result.name), "\n".join(parts))


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
    heads = "".join(
        f'<th scope="col">{each}</th>' for each in ("Check", "Verdict", "Points", "Message")
    )
    rows = "\n".join(_check_rows(plan, points))
    parts.append(f"<table><thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>")
    if drive := plan.drive:
        parts.append(_figure(picture("locations", plan), "paths"))
        distances, largest = drive.distances, int(drive.distances.argmax())
        caption = (
            "distance between the driven and the predicted position at the same time; the largest "
            f"is {distances[largest]:.3g} m at {drive.times[largest]:.3g} s, the last is "
            f"{distances[-1]:.3g} m"
        )
        parts.append(_figure(picture("distances", plan), caption))
    else:
        parts.append("<p>There is no drive to show.</p>")
    parts.append(
        f"<h3>Verdict and last output</h3>\n<pre>{escaped(plan.verdict)}</pre>\n</section>"
    )
    return "\n".join(parts)


def _figure(image: str, caption: str) -> str:
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _check_rows(plan: PlanGrade, points: Points) -> List[str]:
    """Return the rows of the checks of a drive: failures first, those not judged after them."""
    rows = sorted(
        zip(plan.checks, points.earned(plan)),
        key=lambda row: 2 * row[0].passed or not row[0].is_judged,
    )
    return [
        f'<tr><th scope="row">{escaped(check.name)}</th><td>{verdict(check.passed)}</td>'
        f'<td class="number">{shown(earned)} / {shown(points.points(plan.plan, check.name))}</td>'
        f'<td class="message">{escaped(check.message)}</td></tr>'
        for check, earned in rows
    ]
