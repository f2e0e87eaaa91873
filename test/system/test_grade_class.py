"""Grade a class with right, wrong, broken and dishonest submissions."""

import csv
from xml.etree import ElementTree

import pytest

from support import classroom as submissions
from support.grading import ISOLATED, PLAN, grade, load, verdicts_of

WRONG = ("sign", "hangs")


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """Grade a class; return the exit status, the output and the folder of the results."""
    folder = tmp_path_factory.mktemp("course")
    (folder / "open.txt").write_text(PLAN)
    nodes = {"right": submissions.RIGHT}
    nodes.update((name, submissions.WRONG[name][0]) for name in WRONG)
    nodes.update((name, source) for name, (source, _) in submissions.BROKEN.items())
    nodes.update((f"cheat_{name}", submissions.cheat(name)) for name in submissions.CHEATS)
    for name, source in nodes.items():
        submissions.write(folder / "submissions", name, source)
    out = folder / "results"
    plans = ("--plans", folder / "open.txt", "--out", out)
    return *grade(folder / "submissions", *plans), out


def result_of(graded, name):
    path = graded[2] / "data" / f"{name}.json"
    assert path.exists(), graded[1]
    return load(path)


def failed_checks(result):
    assert len(result.plans) == 1, verdicts_of(result)
    (plan,) = result.plans
    return {check.name: check.message for check in plan.checks if not check.passed}


@ISOLATED
def test_right(graded):
    result = result_of(graded, "right")
    assert failed_checks(result) == {}, verdicts_of(result)


@ISOLATED
@pytest.mark.parametrize("name", WRONG)
def test_wrong(graded, name):
    result = result_of(graded, name)
    assert submissions.WRONG[name][1] in failed_checks(result), verdicts_of(result)
    if name == "hangs":
        found = "FAIL node: the node printed ZeroDivisionError: division by zero (path_publisher."
        assert found in result.plans[0].judgement.verdict


@ISOLATED
@pytest.mark.parametrize("name", submissions.BROKEN)
def test_broken(graded, name):
    result = result_of(graded, name)
    assert submissions.BROKEN[name][1] in result.fault, verdicts_of(result)
    assert not result.plans


@ISOLATED
@pytest.mark.parametrize("name", submissions.CHEATS)
def test_cheat(graded, name):
    """The cheat fails, and either its message names the action, or it had no effect."""
    result = result_of(graded, f"cheat_{name}")
    (plan,) = result.plans
    assert failed_checks(result), plan.judgement.verdict
    assert submissions.CHEATS[name][1] in plan.judgement.verdict
    assert "ended without a command" not in plan.judgement.verdict


@ISOLATED
@pytest.mark.parametrize("name", submissions.MISUSES)
def test_misuse(graded, name):
    message = failed_checks(result_of(graded, "cheat_misuses"))["topics"]
    assert f"{submissions.MISUSES[name][1]}, " in message.replace("; expected", ", ")


@ISOLATED
def test_files(graded):
    status, output, out = graded
    assert status == 1, output
    assert "Traceback" not in output
    with open(out / "grades.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    count = 1 + len(WRONG) + len(submissions.BROKEN) + len(submissions.CHEATS)
    assert len(rows) == count
    assert {row["Name"] for row in rows if row["Passed"] == "yes"} == {"right"}
    assert f"1 of {count} submissions passed" in output
    suites = ElementTree.parse(out / "results.xml").getroot().findall("testsuite")
    assert len(suites) == count
    assert len(list((out / "submissions").iterdir())) == count
