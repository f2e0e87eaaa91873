"""Check the files for the course and for Gradescope."""

import base64
import csv
import json
import re
import sys
from html.parser import HTMLParser
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

from mushr_ros_intro.classroom import progress
from mushr_ros_intro.classroom.grader import judge_and_draw
from mushr_ros_intro.classroom.grades import PlanGrade, Student
from mushr_ros_intro.classroom.gradescope import gradescope
from mushr_ros_intro.classroom.points import PlanPoints, Points
from mushr_ros_intro.classroom.tables import write_results
from mushr_ros_intro.replay.judge import CHECK_NAMES
from support.grades import changed, graded, submission
from support.recorded import replay

PLANS = ("circle", "secret")
POINTS = Points(
    PLANS,
    PlanPoints({"path": 3.0, "commands": 2.0}),
    {"secret": PlanPoints({"path": 10.0}, True, True)},
)
EVIL = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>&amp;\x00\x1b[31m\ud800]]></pre>"
FAULTY = submission(name="bob", students=(), fault="no file\nof this name")
BROKEN = submission(name="eve", error="the simulator did not start")
OPEN = graded("circle", ["path", "map"], unjudged=["rate"])
GOOD = submission(graded("circle"), graded("secret"))
BAD = submission(graded("circle", ["path", "map"]), graded("secret", ["path"], "leaked"))


class Page(HTMLParser):
    # The tags of a page, and its text without that of scripts and styles.
    def __init__(self, path):
        super().__init__()
        self.tags, self.text, self.open = [], "", []
        self.feed(path.read_text(encoding="utf-8"))
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "input", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += "" if self.open[-1:] in (["script"], ["style"]) else data

    def all(self, tag, name=None):
        """Return the attributes of all tags, or one attribute of those that have it."""
        found = [attributes for each, attributes in self.tags if each == tag]
        return found if name is None else [each[name] for each in found if name in each]


def written(folder, *results):
    """Write the files of results; return the index and the pages by their file names."""
    write_results(str(folder), results, POINTS)
    pages = {path.name: Page(path) for path in (folder / "submissions").iterdir()}
    return Page(folder / "index.html"), pages


def rows(path):
    """Return the rows of a CSV file."""
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def test_a_long_line_of_a_result():
    for count, end in ((300, "xx..."), (30, 30 * "x")):
        line = progress._line(submission(name="ann", fault=count * "x"), POINTS)
        assert line.endswith(end) and len(line) <= 200


def test_a_line_without_the_control_characters_of_a_build():
    """They could hide the result in the terminal of the teacher."""
    line = progress._line(submission(name="ann", fault="\x1b[2J\x1b]0;x\x07error"), POINTS)
    assert line.isprintable() and line.endswith("error")


def test_other_files_in_the_results_are_kept(tmp_path):
    written(tmp_path, GOOD._replace(name="left"))
    (tmp_path / "students" / "old").mkdir()
    (tmp_path / "students" / "notes.txt").touch()
    written(tmp_path, GOOD)
    kept = {path.name for path in (tmp_path / "students").iterdir()}
    assert kept == {f"{GOOD.name}.html", "old", "notes.txt"}


def test_the_notes_of_a_submission_that_failed(tmp_path):
    """Such as that a file of the node hides a module, which explains the failure."""
    result = BAD._replace(notes=("src/random.py hides random",))
    line = progress._line(result, POINTS)
    assert line.endswith(" circle: path, map; secret: path; src/random.py hides random")
    assert "hides random" in words(written(tmp_path, result)[0])


def test_results_of_an_earlier_run_are_counted(capsys):
    results = [each._replace(name=name) for name, each in zip("abc", (BROKEN, GOOD, BROKEN))]
    tasks = [SimpleNamespace(submission=SimpleNamespace(name=each.name)) for each in results]
    run = SimpleNamespace(run=lambda _: (pair for pair in zip(results, (True, False, True))))
    assert progress.grade_with_progress(run, tasks, POINTS) == results
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and last == "drives of an earlier run used: 1 submission"


def words(page):
    """Return the text of a page with one blank between words."""
    return " ".join(page.text.split())


def test_the_index(tmp_path):
    """The class comes first; then one line for each submission."""
    index, pages = written(tmp_path, GOOD, BAD._replace(name="zoe-1f"), FAULTY, BROKEN)
    text = words(index)
    assert "4 submissions: 1 passed, 1 failed, 1 could not be run, 1 not graded." in text
    assert text.index("Check") < text.index("Show only rows with")
    assert "secret (hidden)" in text and "\u2713 pass 5" in text and "\u2717 fail 0 path" in text
    assert "\u2717 fail 2 path, map" in text and "no file" in text and "of this name" not in text
    assert text.count("\u2717 not run") == text.count("\u2013 not graded") == 2
    keys = index.all("td", "data-key")
    assert keys[:5] == ["ann", "Ann", "5", "10", "15"] and keys[8:11] == ["2", "0", "2"]
    assert keys[-4:-1] == ["-1", "-1", "-1"]
    links = [link for link in index.all("a", "href") if "#" not in link]
    assert links[1] == "submissions/zoe-1f.html" and len(links) == 4
    assert "submissions/ann.html#2" in index.all("a", "href")
    assert sorted(pages) == ["ann.html", "bob.html", "eve.html", "zoe-1f.html"]
    assert not index.all("link") and not index.all("script", "src") and not index.all("img")


def test_a_page(tmp_path):
    circle = changed(graded("circle", ["path", "map"]), notes=["the car ignored it"])
    ann = submission(circle, BAD.plans[1], source="print('hello')")
    _, pages = written(tmp_path, ann, FAULTY, BROKEN)
    text = words(pages["ann.html"])
    names = re.findall(r"(\w+) ?\u2717 fail \d|(\w+) ?\u2713 pass \d", text)
    order = ["path", "map"] + [name for name in CHECK_NAMES if name not in ("path", "map")]
    assert ["".join(each) for each in names[: len(order)]] == order
    assert "0 / 3 path: as expected" in text and "the output: as expected" in text
    assert "Note: the car ignored it" in text and "print('hello')" in text
    assert "secret (hidden): \u2717 fail, 0 of 10 points" in text
    assert "This plan gives 0 points, because 1 check failed: path." in text
    assert "could not be run" in pages["bob.html"].text and "no file\nof" in pages["bob.html"].text
    assert "did not start" in pages["eve.html"].text and "15 points" not in pages["eve.html"].text


def test_what_to_do_next(tmp_path):
    """A failed plan is shown, so that a student can drive it; long messages are folded."""
    long = graded("circle", ["path"], message=400 * "x")
    _, pages = written(tmp_path, submission(long, graded("secret")))
    text = words(pages["ann.html"])
    assert text.count("What to do next") == 1
    assert "grade.py circle.txt --node PACKAGE" in text and "1.0, 2.0, 0.5" in text
    details = pages["ann.html"].all("details")
    assert len(details) == len(CHECK_NAMES) + 4  # two plans, two outputs
    assert f"path: {194 * 'x'} ... The whole messagepath: {400 * 'x'}" in text


def test_not_judged(tmp_path):
    """It is grey, counts as no failure, costs no points, and is explained."""
    points = Points(("circle",), PlanPoints({"path": 3.0, "rate": 2.0}))
    write_results(str(tmp_path), [submission(OPEN)], points)
    page = Page(tmp_path / "submissions" / "ann.html")
    text = words(page)
    assert "\u2013 not judged 2 / 2 rate: as expected" in text and "2 of 5 points" in text
    assert text.count("needs what another check did not find") == 1
    assert "fail 2 path, map" in words(Page(tmp_path / "index.html"))
    report = gradescope(submission(OPEN), points)
    (rate,) = (each for each in report["tests"] if "rate" in each["name"])
    assert report["output"] == "circle: 2 checks failed: path, map, 1 not judged (2 of 5)"
    assert rate["name"] == "circle: rate (not judged)" and rate["score"] == 2


def test_the_class(tmp_path):
    index, _ = written(tmp_path, GOOD, BAD, submission(OPEN), FAULTY, BROKEN)
    assert "path1 passed, 2 failed1 passed, 1 failed" in index.text
    assert "rate2 passed, 1 not judged2 passed" in index.text
    assert "Check" not in written(tmp_path, BROKEN)[0].text


def test_the_pages_for_students(tmp_path):
    """No hidden plan, no other submission, no error of the grading."""
    zoe = BAD._replace(name="Zoe-3f2a1b", students=(Student("Zo\u00eb", "", ""),))
    write_results(str(tmp_path), [BAD, FAULTY, BROKEN, zoe], POINTS)
    pages = {path.stem: Page(path) for path in (tmp_path / "students").iterdir()}
    ann, bob, eve = (words(pages[name]) for name in ("ann", "bob", "eve"))
    assert "\u2717 fail, 2 of 5 points" in ann
    assert "Other plans, which this page does not show, give up to 10 points." in ann
    assert "circle: \u2717 fail, 2 of 5 points" in ann and "the output: as expected" in ann
    assert "could not be run" in bob and "no file" in bob and "did not start" not in eve
    assert "not a fault of the submission" in eve
    assert words(pages["Zoe-3f2a1b"]).startswith("Zo\u00eb Zo\u00eb")  # title and heading
    for page in pages.values():
        assert "secret" not in page.text and "leaked" not in page.text and not page.all("a")
    assert "2 of 15 points" in words(Page(tmp_path / "submissions" / "ann.html"))


def pictures(page):
    """Return the colours of the lines in each picture of a page, which is an SVG file."""
    start = "data:image/svg+xml;base64,"
    for source in page.all("img", "src"):
        assert source.startswith(start)
        root = ElementTree.fromstring(base64.b64decode(source[len(start) :]))
        yield set(re.findall("stroke: ?(#[0-9a-f]{6})", ElementTree.tostring(root, "unicode")))


@pytest.mark.parametrize(
    ("changes", "count"), [({}, 0), ({"sent": ()}, 1), ({"outcome": "it crashed"}, 1)]
)
def test_pictures(tmp_path, changes, count):
    """Only a drive that has failed a check has one: drawing takes as long as driving."""
    plan = PlanGrade("circle", *judge_and_draw(replay(**changes), {}))
    _, pages = written(tmp_path, submission(plan))
    found = list(pictures(pages["ann.html"]))
    assert len(found) == count and all({"#1f77b4", "#ff7f0e"} <= each for each in found)


def test_without_matplotlib(tmp_path, monkeypatch):
    """An autograder has none; its pages are not seen, but it must grade."""
    monkeypatch.setitem(sys.modules, "mushr_ros_intro.replay.pictures", None)
    plan = PlanGrade("circle", *judge_and_draw(replay(sent=()), {}))
    assert not plan.passed and plan.picture == ""
    _, pages = written(tmp_path, submission(plan))
    assert "no picture: matplotlib is missing" in pages["ann.html"].text


def test_text_of_a_submission_is_escaped(tmp_path):
    harmless = written(tmp_path / "good", submission(graded("circle", ["path"])))
    evil = submission(graded("circle", ["path"], EVIL), students=[Student(*3 * [EVIL])])
    found = written(tmp_path / "evil", evil)
    for seen, wanted in zip((found[0], *found[1].values()), (harmless[0], *harmless[1].values())):
        assert [tag for tag, _ in seen.tags] == [tag for tag, _ in wanted.tags]
        assert [sorted(each) for _, each in seen.tags] == [sorted(each) for _, each in wanted.tags]
        shown = EVIL.replace("\x1b[31m", "").replace("\x00", "\ufffd").replace("\ud800", "\ufffd")
        assert shown in seen.text
    written(tmp_path, submission(name="x", fault=EVIL), submission(name="y", error=EVIL))
    root = ElementTree.parse(tmp_path / "evil" / "results.xml").getroot()
    assert root.find(".//failure").text == f"path: {shown}"


def test_tables(tmp_path):
    pair = [Student("Bo\nB", "17", ""), Student("=1+1", "-ann7", "")]
    canvas = FAULTY._replace(students=[Student("poebob", "", "", "1234")])
    results = (BAD._replace(students=pair, name="@a"), canvas, BROKEN)
    write_results(str(tmp_path), results, POINTS)
    assert rows(tmp_path / "grades.csv") == [
        [*("Name", "Students", "IDs", *PLANS, "Score", "Max", "Passed", "Error/Fault")],
        ["'@a", "Bo B; '=1+1", "17; '-ann7", "2", "0", "2", "15", "no", ""],
        ["bob", "poebob", "1234", "0", "0", "0", "15", "no", "no file of this name"],
        ["eve", "Ann", "17", "", "", "", "15", "", "error: the simulator did not start"],
    ]
    assert rows(tmp_path / "canvas.csv") == [
        ["Student", "ID", "SIS User ID", "SIS Login ID", "Section", "path_publisher"],
        ["Bo B", "", "17", "", "", "2"],
        ["'=1+1", "", "'-ann7", "", "", "2"],
        ["poebob", "1234", "", "", "", "0"],
        ["Ann", "", "17", "", "", ""],
    ]


def test_junit(tmp_path):
    written(tmp_path, submission(OPEN, BAD.plans[1]), FAULTY, BROKEN)
    ann, bob, eve = ElementTree.parse(tmp_path / "results.xml").getroot()
    names = ("tests", "failures", "errors", "skipped")
    counts = [[each.get(key) for key in names] for each in (ann, bob, eve)]
    assert counts == [
        [str(2 * len(CHECK_NAMES)), "3", "0", "1"],
        ["1", "1", "0", "0"],
        ["1", "0", "1", "0"],
    ]
    assert ann.find("testcase[@name='rate']/skipped").get("message") == "rate: as expected"
    case = ann.find("testcase[@name='path']")
    assert case.get("classname") == "ann.circle" and case.get("time") == "0"
    assert ann.find("testcase[@name='node']").get("time") == "2.5" and ann.get("time") == "5"
    assert case.find("failure").get("message") == "path: as expected"
    assert bob[0].find("failure").get("message") == "no file" and bob[0].get("name") == "submission"


def test_gradescope():
    report = gradescope(BAD, POINTS)
    tests = {test["name"]: test for test in report["tests"]}
    assert "score" not in report and len(tests) == 2 * len(CHECK_NAMES)
    assert sum(test["score"] for test in tests.values()) == 2
    assert sum(test["max_score"] for test in tests.values()) == 15
    path = tests["circle: path"]
    assert (path["status"], path["score"], path["max_score"]) == ("failed", 0, 3)
    assert path["visibility"] == "visible" and tests["circle: rate"]["status"] == "passed"
    secret = [test for name, test in tests.items() if name.startswith("secret")]
    assert {test["visibility"] for test in secret} == {"after_published"}
    said = json.dumps([each for each in (report["output"], *tests.values()) if each not in secret])
    assert "secret" not in said and "leaked" not in said
    assert "circle: 2 checks failed: path, map (2 of 5)" in report["output"]
    cheat = gradescope(submission(graded("circle", ["topics"])), POINTS)
    assert sum(test["score"] for test in cheat["tests"]) == 0 and "score" not in cheat
    assert all("check topics failed" in each["output"] for each in (cheat, *cheat["tests"]))


def test_submissions_without_a_drive():
    hidden = POINTS._replace(default=POINTS.default._replace(hidden=True))
    report = gradescope(FAULTY, hidden)
    assert report["score"] == 0 and "tests" not in report
    assert report["output"] == f"The submission could not be run.\n{FAULTY.fault}"
    error = gradescope(BROKEN, POINTS)
    assert not {"score", "tests"} & set(error) and "must grade it again" in error["output"]
