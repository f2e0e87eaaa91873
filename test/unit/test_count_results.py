"""Check that a test that fails, or that did not run at all, cannot go unnoticed."""

import os
import subprocess

import pytest

from support.paths import PACKAGE

COUNT = os.path.join(PACKAGE, "scripts", "count_results")
PASSED = '<testcase classname="test.test_plan" name="test_it"/>'
BROKEN = '<testcase classname="test.test_plan" name="test_a"><{0}>why</{0}></testcase>'
SKIPPED = '<testcase classname="test.test_plan" name="a"><skipped message="no netem"/></testcase>'


@pytest.mark.parametrize(
    "results, status, lines",
    [
        ({}, 1, ["0 passed, 0 failed"]),
        ({"pytest": PASSED, "rostest-drive": PASSED}, 0, ["1 passed, 0 failed"]),
        (
            {"pytest": PASSED + BROKEN.format("failure"), "rosunit-drive": BROKEN.format("error")},
            1,
            [
                "FAILED pytest: test.test_plan.test_a",
                "why",
                "FAILED rosunit-drive: test.test_plan.test_a",
                "why",
                "1 passed, 2 failed",
            ],
        ),
        (
            {"pytest": PASSED, "rostest-drive": BROKEN.format("failure")},
            1,
            ["FAILED rostest-drive: test.test_plan.test_a", "why", "1 passed, 1 failed"],
        ),
        (
            {"pytest": PASSED, "rosunit-drive": ""},
            1,
            ["FAILED rosunit-drive: no test ran", "1 passed, 1 failed"],
        ),
        (
            {"pytest": PASSED + SKIPPED},
            0,
            ["SKIPPED pytest: test.test_plan.a: no netem", "1 passed, 0 failed"],
        ),
        (
            {"pytest": SKIPPED},
            1,
            ["SKIPPED pytest: test.test_plan.a: no netem", "0 passed, 0 failed"],
        ),
    ],
)
def test_the_results_are_counted(tmp_path, results, status, lines):
    for name, cases in results.items():
        (tmp_path / f"{name}.xml").write_text(f"<testsuite>{cases}</testsuite>")
    done = subprocess.run([COUNT, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert (done.returncode, done.stdout.splitlines()) == (status, lines)


def test_a_result_that_is_cut_off(tmp_path):
    (tmp_path / "rosunit-drive.xml").write_text("<testsuite><testcase")
    done = subprocess.run([COUNT, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stdout.startswith("FAILED rosunit-drive: not a result: ")
    assert done.stdout.endswith("0 passed, 1 failed\n")
