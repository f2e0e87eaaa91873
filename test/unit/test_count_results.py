"""Check that a test that fails, or that did not run at all, cannot go unnoticed."""

import os
import subprocess

from support.paths import PACKAGE

COUNT = os.path.join(PACKAGE, "scripts", "dev", "count_results")
PASSED = '<testcase classname="test.test_plan" name="test_it"/>'
BROKEN = '<testcase classname="test.test_plan" name="test_a"><{0}>why</{0}></testcase>'
SKIPPED = '<testcase classname="test.test_plan" name="a"><skipped message="no netem"/></testcase>'


def count(folder, results):
    """Write files of results; return the exit status and the lines of count_results."""
    folder.mkdir(exist_ok=True)
    for name, cases in results.items():
        (folder / f"{name}.xml").write_text(f"<testsuite>{cases}</testsuite>")
    done = subprocess.run([COUNT, str(folder)], stdout=subprocess.PIPE, text=True)
    return done.returncode, done.stdout.splitlines()


def test_the_results_are_counted(tmp_path):
    assert count(tmp_path, {}) == (1, ["0 passed, 0 failed"])
    skipped = "SKIPPED pytest: test.test_plan.a: no netem"
    assert count(tmp_path, {"pytest": SKIPPED}) == (1, [skipped, "0 passed, 0 failed"])
    assert count(tmp_path, {"pytest": PASSED + SKIPPED}) == (0, [skipped, "1 passed, 0 failed"])
    results = {"pytest": PASSED, "rostest-drive": PASSED}
    assert count(tmp_path, results) == (0, ["1 passed, 0 failed"])


def test_failures_are_counted(tmp_path):
    failure, error = BROKEN.format("failure"), BROKEN.format("error")
    for number, (results, *lines) in enumerate(
        [
            ({"rostest-a": failure}, "FAILED rostest-a: test.test_plan.test_a", "why"),
            ({"rosunit-a": error}, "FAILED rosunit-a: test.test_plan.test_a", "why"),
            ({"rosunit-a": ""}, "FAILED rosunit-a: no test ran"),
        ]
    ):
        expected = [*lines, "1 passed, 1 failed"]
        assert count(tmp_path / str(number), {"pytest": PASSED, **results}) == (1, expected)
    both = {"pytest": PASSED + failure, "rosunit-drive": error}
    assert count(tmp_path / "both", both)[1][-1] == "1 passed, 2 failed"
    status, lines = count(tmp_path / "cut off", {"rosunit-drive": "<testcase"})
    assert status == 1
    assert lines[0].startswith("FAILED rosunit-drive: not a result: ")
    assert lines[-1] == "0 passed, 1 failed"
