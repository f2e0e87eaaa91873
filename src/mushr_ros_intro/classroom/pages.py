"""Show results as HTML pages for the course: an index, and one page for each submission.

The pages contain all that they need, and load nothing. They show hidden plans too. All text of a
submission is escaped.
"""

import base64
import html
import re
from typing import List, Sequence
from urllib.parse import quote

from mushr_ros_intro.classroom.grades import Grade, PlanGrade
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.wording import counted

FOLDER = "submissions"
"""The folder of the pages of submissions, beside the index."""

_TERMINAL_CODE = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(\x07|\x1b\\)?)")
_NOT_TEXT = re.compile("[^\t\n\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_NOT_IN_FILE_NAME = re.compile("[\x00-\x1f/\\\\%\ud800-\udfff]")
_NOTE_LENGTH = 200
"""The index shows so many characters of a fault."""

_STYLE = """
:root { color-scheme: light dark; --back: #fff; --line: #c9ccd1; --soft: #f2f4f7; --pass: #14692b;
  --fail: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --back: #16181c; --line: #464b54; --soft: #22262c;
  --pass: #7ad694; --fail: #ff9388; } img { filter: invert(0.9) hue-rotate(180deg); } }
body { background: var(--back); font: 15px/1.45 system-ui, sans-serif; margin: 1.5rem; }
table { border-collapse: collapse; }
th, td { border: 1px solid var(--line); padding: 0.35rem 0.6rem; text-align: left;
  vertical-align: top; overflow-wrap: anywhere; }
thead th { background: var(--soft); position: sticky; top: 0; }
th button { all: unset; cursor: pointer; font-weight: 600; }
th button:focus-visible { outline: 2px solid; outline-offset: 2px; }
th button::after { content: " \\2195"; opacity: 0.6; }
th[aria-sort=ascending] button::after { content: " \\2191"; opacity: 1; }
th[aria-sort=descending] button::after { content: " \\2193"; opacity: 1; }
.pass, .fail, .open { font-weight: 600; white-space: nowrap; }
.pass { color: var(--pass); }
.fail { color: var(--fail); }
.note { font-size: 0.9em; max-width: 26rem; }
.line, .number { white-space: nowrap; }
.number { text-align: right; }
td.message, pre { white-space: pre-wrap; overflow-wrap: anywhere; }
td.message { max-width: 46rem; }
pre { background: var(--soft); border: 1px solid var(--line); padding: 0.7rem; max-width: 60rem; }
figure { margin: 1rem 0; max-width: 680px; }
img { display: block; max-width: 100%; }
figcaption { font-size: 0.9em; }
"""

_SCRIPT = """
for (const button of document.querySelectorAll("th button")) button.onclick = () => {
  const head = button.parentElement, body = document.querySelector("tbody");
  const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  const key = row => row.cells[head.cellIndex].dataset.key;
  const order = (a, b) => sign * (a - b || a.localeCompare(b));
  for (const each of head.parentElement.cells) each.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  body.append(...[...body.rows].sort((one, other) => order(key(one), key(other))));
};
"""

_PASS, _FAIL = (
    '<span class="pass">&#10003; pass</span>',
    '<span class="fail">&#10007; fail</span>',
)
_NOT_RUN = '<span class="fail">&#10007; not run</span>'
_NOT_GRADED = '<span class="open">? not graded</span>'
_LEGEND = "solid: driven; dashed: predicted; square: end of the driven path"


def clean(text: str) -> str:
    """Return text without terminal codes; a character that XML does not allow becomes U+FFFD."""
    lines = _TERMINAL_CODE.sub("", text).replace("\r\n", "\n").replace("\r", "\n")
    return _NOT_TEXT.sub("\ufffd", lines)


def shown(points: float) -> str:
    """Return points as text, such as 2 or 0.5."""
    return f"{points:.12g}"


def file_name(name: str) -> str:
    """Return the file name of the page of a submission; different names have different pages."""
    return _NOT_IN_FILE_NAME.sub(lambda match: f"%{ord(match[0]):02X}", name) + ".html"


def index_page(results: Sequence[Grade], points: Points) -> str:
    """Return the page with one row for each submission."""
    passed = sum(result.passed for result in results)
    faults = sum(bool(result.fault) for result in results)
    errors = sum(bool(result.error) for result in results)
    counts = [f"{passed} passed", f"{len(results) - passed - faults - errors} failed"]
    counts += [f"{faults} could not be run"] if faults else []
    counts += [f"{errors} not graded"] if errors else []
    plans = [_title(name, points) for name in points.plan_names]
    columns = ["Submission", "Students", *plans, f"Score of {shown(points.max_score())}"]
    heads = "".join(
        f'<th scope="col"><button type="button">{each}</button></th>' for each in columns
    )
    rows = "\n".join(_row(result, points) for result in results)
    body = (
        f"<h1>Submissions</h1>\n<p>{counted(len(results), 'submission')}: {', '.join(counts)}. "
        f"Click on the name of a column to sort. Pictures: {_LEGEND}.</p>\n"
        f"<table><thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>\n"
        f"<script>{_SCRIPT}</script>"
    )
    return _page("Submissions", body)


def submission_page(result: Grade, points: Points) -> str:
    """Return the page of a submission, with all checks, drawings and the output of its node."""
    parts = [f'<p><a href="../index.html">All submissions</a></p>\n<h1>{_text(result.name)}</h1>']
    parts += [f"<p>{_text(', '.join(filter(None, student)))}</p>" for student in result.students]
    if result.error:
        parts.append(f"<p>{_NOT_GRADED}: grading failed. Grade this submission again.</p>")
        parts.append(f"<pre>{_text(result.error)}</pre>")
    else:
        score, most = shown(points.score(result)), shown(points.max_score())
        parts.append(f"<p>{_verdict(result.passed)}, {score} of {most} points</p>")
    if result.fault:
        parts.append(f"<p>{_NOT_RUN}: the submission could not be run.</p>")
        parts.append(f"<pre>{_text(result.fault)}</pre>")
    parts += [f"<p>Note: {_text(note)}</p>" for note in result.notes]
    parts += [_section(number, plan, points) for number, plan in enumerate(result.plans, 1)]
    return _page(_text(result.name), "\n".join(parts))


def _row(result: Grade, points: Points) -> str:
    link = quote(f"{FOLDER}/{file_name(result.name)}")
    fault = clean(result.error or result.fault).strip()
    note = fault if len(fault) <= _NOTE_LENGTH else fault[:_NOTE_LENGTH] + " ..."
    name = f'<a href="{link}">{_text(result.name)}</a>'
    if note:
        name += f'<div class="note">{_text(note)}</div>'
    students = "<br>".join(_text(each.name or each.id or each.email) for each in result.students)
    names = ", ".join(each.name or each.id for each in result.students)
    cells = [_cell(result.name, name), _cell(names, students)]
    plans = {plan.plan: (number, plan) for number, plan in enumerate(result.plans, 1)}
    for each in points.plan_names:
        if each in plans:
            number, plan = plans[each]
            cells.append(_plan_cell(plan, points, f"{link}#plan-{number}"))
        else:
            cells.append(_cell("-1", _NOT_GRADED if result.error else _NOT_RUN))
    score = "" if result.error else shown(points.score(result))
    cells.append(_cell(score or "-1", score or "?", "number"))
    return f"<tr>{''.join(cells)}</tr>"


def _plan_cell(plan: PlanGrade, points: Points, link: str) -> str:
    score, most = shown(points.plan_score(plan)), shown(points.max_score([plan.plan]))
    failed = [check for check in plan.checks if not check.passed]
    judged = [check for check in failed if check.is_judged] or failed
    names = _text(", ".join(check.name for check in judged))
    image = _picture("thumbnail", plan) if plan.drive else "no drive"
    line = f'<div class="line">{_verdict(plan.passed)} {score} / {most}</div>'
    return _cell(score, f'{line}<a href="{link}">{image}</a><div class="note">{names}</div>')


def _cell(key: str, content: str, name: str = "") -> str:
    """Return a cell that is sorted by a key."""
    kind = f' class="{name}"' if name else ""
    return f'<td data-key="{_text(key)}"{kind}>{content}</td>'


def _section(number: int, plan: PlanGrade, points: Points) -> str:
    """Return the part of a page about one drive."""
    score, most = shown(points.plan_score(plan)), shown(points.max_score([plan.plan]))
    title = _title(plan.plan, points)
    parts = [
        f'<section id="plan-{number}">\n<h2>{title}: {_verdict(plan.passed)}, {score} of {most} '
        "points</h2>"
    ]
    if loss := points.loss(plan):
        parts.append(f"<p>{_text(loss)}</p>")
    heads = "".join(
        f'<th scope="col">{each}</th>' for each in ("Check", "Verdict", "Points", "Message")
    )
    rows = "\n".join(_check_rows(plan, points))
    parts.append(f"<table><thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>")
    if drive := plan.drive:
        parts.append(_figure(_picture("locations", plan), "paths"))
        distances, largest = drive.distances, int(drive.distances.argmax())
        caption = (
            "distance between the driven and the predicted position at the same time; the largest "
            f"is {distances[largest]:.3g} m at {drive.times[largest]:.3g} s, the last is "
            f"{distances[-1]:.3g} m"
        )
        parts.append(_figure(_picture("distances", plan), caption))
    else:
        parts.append("<p>There is no drive to show.</p>")
    parts.append(f"<h3>Verdict and last output</h3>\n<pre>{_text(plan.verdict)}</pre>\n</section>")
    return "\n".join(parts)


def _figure(image: str, caption: str) -> str:
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _picture(name: str, plan: PlanGrade) -> str:
    """Return a stored picture of a drive by its name."""
    if name not in plan.pictures:
        return "no picture: matplotlib was missing when this was graded; install it, add --rejudge"
    data = base64.b64encode(plan.pictures[name].encode()).decode()
    return f'<img alt="{name} of the drive" src="data:image/svg+xml;base64,{data}">'


def _check_rows(plan: PlanGrade, points: Points) -> List[str]:
    """Return the rows of the checks of a drive: failures first, those not judged after them."""
    rows = sorted(
        zip(plan.checks, points.earned(plan)),
        key=lambda row: 2 * row[0].passed or not row[0].is_judged,
    )
    return [
        f'<tr><th scope="row">{_text(check.name)}</th><td>{_verdict(check.passed)}</td>'
        f'<td class="number">{shown(earned)} / {shown(points.points(plan.plan, check.name))}</td>'
        f'<td class="message">{_text(check.message)}</td></tr>'
        for check, earned in rows
    ]


def _title(plan: str, points: Points) -> str:
    """Return the name of a plan, marked if it is hidden from students."""
    return _text(plan) + (" (hidden)" if points.is_hidden(plan) else "")


def _verdict(passed: bool) -> str:
    return _PASS if passed else _FAIL


def _text(text: str) -> str:
    return html.escape(clean(text))


def _page(title: str, body: str) -> str:
    """Return a page; `title` and `body` are HTML."""
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f"<title>{title}</title>\n<style>{_STYLE}</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )
