"""Print the results of a class while it is graded."""

import sys
from contextlib import closing
from typing import Dict, List, Sequence

from mushr_ros_intro.classroom.csv_text import clean
from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.grading import Grading, Task, not_graded
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.wording import counted

_WIDTH = 200
"""Longest line of a result."""


def grade_with_progress(grading: Grading, tasks: Sequence[Task], points: Points) -> List[Grade]:
    """Grade until the end, or until Ctrl-C; return the results in the order of the tasks.

    Print each result that is new, and how many follow from stored drives.
    """
    results: Dict[str, Grade] = {}
    old, note = 0, ""
    try:
        with closing(grading.run(tasks)) as graded:
            for each, is_new in graded:
                results[each.name] = each
                old += not is_new
                if is_new:
                    print(_line(each, points), flush=True)
    except KeyboardInterrupt:
        done = f"{len(results)} of {counted(len(tasks), 'submission')}"
        note = f"interrupted: {done} graded; the same command grades the others"
    if old:
        print(f"drives of an earlier run used: {counted(old, 'submission')}")
    if note:
        print(note, file=sys.stderr)
    return [results.get(task.submission.name) or not_graded(task.submission) for task in tasks]


def _line(result: Grade, points: Points) -> str:
    """Return the line of a result: the score, what failed, and the notes."""
    state = "passed" if result.passed else "FAILED"
    text = result.fault
    if result.error:
        state, text = "ERROR", result.error
    failed = (f"{each.plan}: {', '.join(each.failed)}" for each in result.plans if each.failed)
    text = clean((text or "; ".join([*failed, *result.notes])).partition("\n")[0])
    score = f"{points.score(result):g}/{points.max_score():g}"
    line = f"{result.name:30s} {state} {score:>7s} {text}".rstrip()
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 3]}..."
