"""Show the results of a class as a table, with one row for each submission."""

from statistics import mean, median
from typing import Sequence
from urllib.parse import quote

from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.classroom.html_page import (
    NOT_GRADED,
    NOT_RUN,
    clean,
    escaped,
    page,
    picture,
    plan_title,
    shown,
    table,
    verdict,
)
from mushr_ros_intro.classroom.pages import FOLDER, file_name
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.wording import counted

_NOTE_LENGTH = 200
"""Number of characters of a fault that the index shows."""

_SCRIPT = """
for (const button of document.querySelectorAll("th button")) button.onclick = () => {
  const head = button.parentElement, body = document.querySelector(".index tbody");
  const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  const key = row => row.cells[head.cellIndex].dataset.key;
  const order = (a, b) => sign * (a - b || a.localeCompare(b));
  for (const each of head.parentElement.cells) each.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  body.append(...[...body.rows].sort((one, other) => order(key(one), key(other))));
};
"""

_LEGEND = "solid: driven; dashed: predicted; square: end of the driven path"


def index_page(results: Sequence[Grade], points: Points) -> str:
    """Return the page with one row for each submission."""
    passed = sum(result.passed for result in results)
    faults = sum(bool(result.fault) for result in results)
    errors = sum(bool(result.error) for result in results)
    counts = [f"{passed} passed", f"{len(results) - passed - faults - errors} failed"]
    counts += [f"{faults} could not be run"] if faults else []
    counts += [f"{errors} not graded"] if errors else []
    plans = [plan_title(name, points) for name in points.plan_names]
    columns = ["Submission", "Students", *plans, f"Score of {shown(points.max_score())}"]
    heads = (f'<button type="button">{each}</button>' for each in columns)
    results_table = table("cards index", heads, (_row(result, points) for result in results))
    body = (
        f"<h1>Submissions</h1>\n<p>{counted(len(results), 'submission')}: {', '.join(counts)}. "
        f"Click on the name of a column to sort. Pictures: {_LEGEND}.</p>\n"
        f"{results_table}\n{_statistics(results, points)}\n"
        f"<script>{_SCRIPT}</script>"
    )
    return page("Submissions", body)


def _row(result: Grade, points: Points) -> str:
    link = quote(f"{FOLDER}/{file_name(result.name)}")
    fault = clean(result.error or result.fault).strip()
    note = fault if len(fault) <= _NOTE_LENGTH else fault[:_NOTE_LENGTH] + " ..."
    name = f'<a href="{link}">{escaped(result.name)}</a>'
    if note:
        name += f'<div class="note">{escaped(note)}</div>'
    students = "<br>".join(escaped(each.name or each.id or each.email) for each in result.students)
    names = ", ".join(each.name or each.id for each in result.students)
    cells = [_cell(result.name, name), _cell(names, students)]
    plans = {plan.plan: (number, plan) for number, plan in enumerate(result.plans, 1)}
    for each in points.plan_names:
        if each in plans:
            number, plan = plans[each]
            cells.append(_plan_cell(plan, points, f"{link}#plan-{number}"))
        else:
            mark = NOT_GRADED if result.error else NOT_RUN
            cells.append(_cell("-1", mark, f' data-name="{escaped(each)}"'))
    score = "" if result.error else shown(points.score(result))
    cells.append(_cell(score or "-1", score or "?", ' class="number" data-name="Score"'))
    return f"<tr>{''.join(cells)}</tr>"


def _plan_cell(plan: PlanGrade, points: Points, link: str) -> str:
    score, most = shown(points.plan_score(plan)), shown(points.max_score([plan.plan]))
    failed = [check for check in plan.checks if not check.passed]
    judged = [check for check in failed if check.is_judged] or failed
    names = escaped(", ".join(check.name for check in judged))
    image = picture("thumbnail", plan) if plan.drive else "no drive"
    line = f'<div class="line">{verdict(plan.passed)} {score} / {most}</div>'
    content = f'{line}<a href="{link}">{image}</a><div class="note">{names}</div>'
    return _cell(score, content, f' data-name="{escaped(plan.plan)}"')


def _cell(key: str, content: str, attributes: str = "") -> str:
    """Return a cell that is sorted by a key."""
    return f'<td data-key="{escaped(key)}"{attributes}>{content}</td>'


def _statistics(results: Sequence[Grade], points: Points) -> str:
    """Return the scores of the class, and how many drives passed each check of each plan."""
    scores = [points.score(each) for each in results if not each.error]
    if not scores:
        return ""
    numbers = ", ".join(
        f"{name} {shown(round(value, 2))}"
        for name, value in (
            ("lowest", min(scores)),
            ("median", median(scores)),
            ("mean", mean(scores)),
            ("highest", max(scores)),
        )
    )
    plans = {
        name: [plan for each in results for plan in each.plans if plan.plan == name]
        for name in points.plan_names
    }
    rows = (
        f'<tr><th scope="row">{check}</th>'
        + "".join(f"<td>{_counts(check, drives)}</td>" for drives in plans.values())
        + "</tr>"
        for check in points.check_names
    )
    heads = ["Check", *(plan_title(each, points) for each in plans)]
    return f"<h2>The class</h2>\n<p>Scores: {numbers}.</p>\n{table('counts', heads, rows)}"


def _counts(name: str, drives: Sequence[PlanGrade]) -> str:
    """Return how many drives passed a check, failed it, or were not judged."""
    checks = [check for drive in drives for check in drive.checks if check.name == name]
    passed = sum(check.passed for check in checks)
    failed = sum(check.is_judged and not check.passed for check in checks)
    counts = {"passed": passed, "failed": failed, "not judged": len(checks) - passed - failed}
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
