"""What all pages of results have in common. They load nothing; all text is escaped."""

import base64
import html
import re
from typing import Iterable

from mushr_ros_intro.classroom.grades import PlanGrade
from mushr_ros_intro.classroom.points import Points

_TERMINAL_CODE = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(\x07|\x1b\\)?)")
_NOT_TEXT = re.compile("[^\t\n\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

_STYLE = """
:root { color-scheme: light dark; --back: #fff; --line: #c9ccd1; --soft: #f2f4f7; --pass: #14692b;
  --fail: #b3261e; --open: #62676f; }
@media (prefers-color-scheme: dark) { :root { --back: #16181c; --line: #464b54; --soft: #22262c;
  --pass: #7ad694; --fail: #ff9388; --open: #a0a6af; }
  img { filter: invert(0.9) hue-rotate(180deg); } }
body { background: var(--back); font: 15px/1.45 system-ui, sans-serif; margin: 1.5rem; }
table { border-collapse: collapse; }
th, td { border: 1px solid var(--line); padding: 0.35rem 0.6rem; text-align: left;
  vertical-align: top; }
td { overflow-wrap: anywhere; }
thead th { background: var(--soft); position: sticky; top: 0; }
th button { all: unset; cursor: pointer; font-weight: 600; }
th button:focus-visible { outline: 2px solid; outline-offset: 2px; }
th button::after { content: " \\2195"; opacity: 0.6; }
th[aria-sort=ascending] button::after { content: " \\2191"; opacity: 1; }
th[aria-sort=descending] button::after { content: " \\2193"; opacity: 1; }
.pass, .fail, .open { font-weight: 600; white-space: nowrap; }
.pass { color: var(--pass); }
.fail { color: var(--fail); }
.open { color: var(--open); }
.note { font-size: 0.9em; max-width: 26rem; }
.line, .number { white-space: nowrap; }
.number { text-align: right; }
td.message, pre { white-space: pre-wrap; overflow-wrap: anywhere; }
td.message { max-width: 46rem; }
pre { background: var(--soft); border: 1px solid var(--line); padding: 0.7rem; max-width: 60rem; }
figure { margin: 1rem 0; max-width: 680px; }
img { display: block; max-width: 100%; }
figcaption { font-size: 0.9em; }
details { margin: 1rem 0; }
@media (max-width: 40rem) {
  body { margin: 0.8rem; }
  .cards, .cards tbody { display: block; }
  .cards thead th { position: static; }
  .cards thead tr, .cards tbody tr { display: grid; grid-template-columns: auto 1fr auto;
    margin-bottom: 0.8rem; }
  .index thead tr { grid-template-columns: 1fr 1fr; }
  .cards td.wide, .index td, .index td.number { grid-column: 1 / -1; text-align: left; }
  .checks thead, .cards td:empty { display: none; }
  td[data-name]::before { content: attr(data-name) ": "; font-weight: 600; }
}
"""

_PASS, _FAIL, _NOT_JUDGED = (
    '<span class="pass">&#10003; pass</span>',
    '<span class="fail">&#10007; fail</span>',
    '<span class="open">&ndash; not judged</span>',
)
NOT_RUN = '<span class="fail">&#10007; not run</span>'
NOT_GRADED = '<span class="open">? not graded</span>'


def clean(text: str) -> str:
    """Return text without terminal codes; a character that XML does not allow becomes U+FFFD."""
    lines = _TERMINAL_CODE.sub("", text).replace("\r\n", "\n").replace("\r", "\n")
    return _NOT_TEXT.sub("\ufffd", lines)


def shown(points: float) -> str:
    """Return points as text, such as 2 or 0.5."""
    return f"{points:.12g}"


def picture(name: str, plan: PlanGrade) -> str:
    """Return a stored picture of a drive by its name."""
    if name not in plan.pictures:
        return "no picture: matplotlib was missing when this was graded; install it, add --rejudge"
    data = base64.b64encode(plan.pictures[name].encode()).decode()
    return f'<img alt="{name} of the drive" src="data:image/svg+xml;base64,{data}">'


def plan_title(plan: str, points: Points) -> str:
    """Return the name of a plan, marked if it is hidden from students."""
    return escaped(plan) + (" (hidden)" if points.is_hidden(plan) else "")


def verdict(passed: bool, is_judged: bool = True) -> str:
    """Return the mark of a check, a plan or a submission."""
    return _PASS if passed else _FAIL if is_judged else _NOT_JUDGED


def escaped(text: str) -> str:
    """Return text as HTML, without what HTML does not allow."""
    return html.escape(clean(text))


def table(kind: str, heads: Iterable[str], rows: Iterable[str]) -> str:
    """Return a table with a class of CSS; heads and rows are HTML."""
    cells, lines = "".join(f'<th scope="col">{each}</th>' for each in heads), "\n".join(rows)
    head = f'<table class="{kind}"><thead><tr>{cells}</tr></thead>'
    return f"{head}\n<tbody>\n{lines}\n</tbody></table>"


def page(title: str, body: str) -> str:
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
