"""Print the results of a class while it is graded."""

import sys
from contextlib import closing
from typing import Dict, List, Sequence

from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.grading import Grading, Task, not_graded
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.wording import counted

_WIDTH = 200
"""Longest line of a result."""
_BAR = 40


def grade_with_progress(grading: Grading, tasks: Sequence[Task], points: Points) -> List[Grade]:
    """Grade until the end, or until Ctrl-C; return the results in the order of the tasks."""
    progress = Progress(points, len(tasks))
    results: Dict[str, Grade] = {}
    try:
        with closing(grading.run(tasks)) as graded:
            for each, is_new in graded:
                results[each.name] = each
                progress.add(each, is_new)
    except KeyboardInterrupt:
        progress.end()
        done = f"{len(results)} of {counted(len(tasks), 'submission')}"
        print(f"interrupted: {done} graded; the same command grades the others", file=sys.stderr)
    else:
        progress.end()
    return [results.get(task.submission.name) or not_graded(task.submission) for task in tasks]


class Progress:
    """Prints a line for each new result, and on a terminal how many are left."""

    def __init__(self, points: Points, count: int) -> None:
        """Begin with no result of `count` submissions."""
        self._points, self._count = points, count
        self._done = self._old = 0

    def add(self, result: Grade, is_new: bool) -> None:
        """Count a result; print it if it is new."""
        self._done += 1
        self._old += not (is_new or result.error)
        if is_new:
            self._replace_line("")
            print(_line(result, self._points), flush=True)
        bar = "#" * (_BAR * self._done // self._count)
        self._replace_line(f"[{bar:{_BAR}s}] {self._done} of {self._count}")

    def end(self) -> None:
        """Remove the line of progress; print how many results have stored drives."""
        self._replace_line("")
        if self._old:
            print(f"drives of an earlier run used: {counted(self._old, 'submission')}")

    def _replace_line(self, text: str) -> None:
        """Replace the line of progress, which is shown on a terminal only."""
        if sys.stderr.isatty():
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def _line(result: Grade, points: Points) -> str:
    """Return the line of a result: the score, and what failed."""
    state = "passed" if result.passed else "FAILED"
    text = result.fault
    if result.error:
        state, text = "ERROR", result.error
    failed = {
        plan.plan: [check.name for check in plan.checks if check.is_judged and not check.passed]
        for plan in result.plans
    }
    text = text or "; ".join(
        f"{plan}: {', '.join(names)}" for plan, names in failed.items() if names
    )
    text = (text or "; ".join(result.notes)).partition("\n")[0]
    score = f"{points.score(result):g}/{points.max_score():g}"
    line = f"{result.name:30s} {state} {score:>7s} {text}".rstrip()
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 3]}..."
