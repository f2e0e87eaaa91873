"""Write results as files for the course: pages, tables, and JUnit."""

import os
from typing import Iterable, Iterator, List, Sequence
from xml.etree import ElementTree

from mushr_ros_intro.classroom import pages
from mushr_ros_intro.classroom.csv_text import as_csv, clean, plain, shown
from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.points import Points
from mushr_ros_intro.classroom.store import make_folder, write_text
from mushr_ros_intro.replay.judge import CHECK_NAMES


def write_results(folder: str, results: Sequence[Grade], points: Points) -> None:
    """Write index.html, submissions/, students/, the tables and results.xml into a folder.

    Args:
        folder: is created if it does not exist.
        results: of the submissions, in the order of the files.
        points: what the plans give, which are in the order of the columns.

    Raises:
        OSError: a file cannot be written.
    """
    folder = os.path.join(folder, "")
    make_folder(folder)
    write_text(f"{folder}index.html", pages.index_page(results, points))
    names = {f"{result.name}.html": result for result in results}
    kinds = {pages.FOLDER: pages.submission_page, pages.STUDENTS: pages.student_page}
    for kind, function in kinds.items():
        make_folder(folder + kind)
        for name, result in names.items():
            write_text(os.path.join(folder, kind, name), function(result, points))
        for name in set(os.listdir(folder + kind)) - set(names):
            if name.endswith(".html"):  # of a student who left
                os.unlink(os.path.join(folder, kind, name))
    write_text(f"{folder}grades.csv", as_csv(_grades(results, points)))
    write_text(f"{folder}canvas.csv", as_csv(_canvas(results, points)))
    write_text(f"{folder}results.xml", _junit(results))


def _grades(results: Iterable[Grade], points: Points) -> Iterator[List[str]]:
    """Yield the rows of grades.csv: one for each submission; without a verdict, no points."""
    names = points.plan_names
    heads = ["Score", "Max", "Passed", "Error/Fault"]
    yield ["Name", "Students", "IDs", *names, *heads]
    for result in results:
        scores = {plan.plan: shown(points.plan_score(plan)) for plan in result.plans}
        missing = "" if result.error else "0"
        yield [
            result.name,
            "; ".join(plain(each.name) for each in result.students),
            "; ".join(plain(each.id or each.canvas_id) for each in result.students),
            *(scores.get(name, missing) for name in names),
            "" if result.error else shown(points.score(result)),
            shown(points.max_score()),
            "" if result.error else "yes" if result.passed else "no",
            f"error: {result.error}" if result.error else result.fault,
        ]


def _canvas(results: Iterable[Grade], points: Points) -> Iterator[List[str]]:
    """Yield the rows of canvas.csv: one for each student; without a verdict, no score."""
    yield ["Student", "ID", "SIS User ID", "SIS Login ID", "Section", "path_publisher"]
    for result in results:
        score = "" if result.error else shown(points.score(result))
        for student in result.students:
            name = student.name or student.email
            yield [name, student.canvas_id, student.id, "", "", score]


def _junit(results: Iterable[Grade]) -> str:
    """Return results.xml in the format of JUnit; the check node has the time of the replay."""
    root = ElementTree.Element("testsuites")
    for result in results:
        name = clean(result.name)
        suite = ElementTree.SubElement(root, "testsuite", name=name)
        for plan in result.plans:
            for check in plan.checks:
                kind = "" if check.passed else "failure" if check.is_judged else "skipped"
                seconds = plan.judgement.recorded.seconds if check.name == CHECK_NAMES[0] else 0.0
                place = f"{result.name}.{plan.plan}"
                _add_case(suite, place, check.name, kind, check.message, seconds)
        if result.error or result.fault:
            kind = "error" if result.error else "failure"
            _add_case(suite, result.name, "submission", kind, result.error or result.fault, 0.0)
        suite.set("tests", str(len(suite)))
        counts = {"failures": "failure", "errors": "error", "skipped": "skipped"}
        for attribute, tag in counts.items():
            suite.set(attribute, str(len(suite.findall(f"*/{tag}"))))
        suite.set("time", f"{sum(plan.judgement.recorded.seconds for plan in result.plans):g}")
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _add_case(
    suite: ElementTree.Element, place: str, name: str, kind: str, message: str, seconds: float
) -> None:
    """Add a test case to a suite; `kind` is a tag such as failure, or "" if it passed."""
    case = ElementTree.SubElement(suite, "testcase")
    case.attrib.update(classname=clean(place), name=clean(name), time=f"{seconds:g}")
    if kind:
        text = clean(message)
        first = (text.splitlines() or [""])[0]
        ElementTree.SubElement(case, kind, message=first).text = text
