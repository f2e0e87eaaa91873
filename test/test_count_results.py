"""Check that a test that fails, or that did not run at all, cannot go unnoticed."""

import os
import subprocess

COUNT = os.path.join(
    os.path.dirname(os.path.dirname(os.path.abspath(__file__))), "scripts", "count_results"
)
PASSED = '<testcase classname="test.test_plan" name="test_it"/>'
DRIVEN = '<testcase classname="__main__.TestDrive" name="test_it"/>'
LAUNCHED = '<testcase classname="rostest.runner.RosTest" name="testdrive"/>'


def count(folder, files=("test_plan.py", "drive.test"), **results):
    """Return the exit status and the lines for test files and results, of which others change."""
    contents = {"pytest": PASSED, "rosunit-drive": DRIVEN, "rostest-test_drive": LAUNCHED}
    contents.update((name.replace("_", "-", 1), text) for name, text in results.items())
    for name in files:
        node = '<launch><test pkg="a" type="drive_test.py" test-name="drive"/></launch>'
        path = folder / "tests" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(node if name.endswith(".test") else "")
    (folder / "results").mkdir()
    for name, text in contents.items():
        if text is not None:
            (folder / "results" / f"{name}.xml").write_text(f"<testsuite>{text}</testsuite>")
    run = subprocess.run(
        [COUNT, str(folder / "tests"), str(folder / "results")],
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    return run.returncode, run.stdout.splitlines()


def test_all_passed(tmp_path):
    assert count(tmp_path) == (0, ["2 passed, 0 failed"])


def test_a_failure_and_an_error(tmp_path):
    for kind in ("failure", "error"):
        case = f'<testcase classname="test.test_plan" name="test_a"><{kind}>why</{kind}></testcase>'
        folder = tmp_path / kind
        folder.mkdir()
        status, lines = count(folder, pytest=PASSED + case)
        assert (status, lines[-1]) == (1, "2 passed, 1 failed")
        assert lines[:2] == ["FAILED pytest: test.test_plan.test_a", "why"]


def test_a_skipped_test_is_told(tmp_path):
    case = '<testcase classname="test.test_plan" name="a"><skipped message="no Xvfb"/></testcase>'
    status, lines = count(tmp_path, pytest=case)
    assert (status, lines) == (
        0,
        ["SKIPPED pytest: test.test_plan.a: no Xvfb", "1 passed, 0 failed"],
    )


def test_a_test_node_that_is_named_like_a_test_file(tmp_path):
    files = ("test_plan.py", "test_nodes_test.py", "drive.test")
    assert count(tmp_path, files=files) == (0, ["2 passed, 0 failed"])


def test_a_test_file_without_a_test(tmp_path):
    status, lines = count(tmp_path, files=("test_plan.py", "test_mux.py", "drive.test"))
    assert (status, lines) == (1, ["FAILED test_mux.py: ran nothing", "2 passed, 1 failed"])


def test_a_test_node_that_did_not_run(tmp_path):
    failed = LAUNCHED.replace("/>", "><failure>did not generate test results</failure></testcase>")
    status, lines = count(tmp_path, rosunit_drive=None, rostest_test_drive=failed)
    assert (status, lines[-1]) == (1, "1 passed, 2 failed")
    assert "FAILED drive.test: the test node drive ran nothing" in lines


def test_a_test_node_without_a_test(tmp_path):
    status, lines = count(tmp_path, rosunit_drive="")
    assert (status, lines) == (
        1,
        ["FAILED drive.test: the test node drive has no test", "1 passed, 1 failed"],
    )


def test_a_result_that_is_cut_off(tmp_path):
    status, lines = count(tmp_path, rosunit_drive="<testcase")
    assert (status, lines[-1]) == (1, "1 passed, 2 failed")
    assert lines[0].startswith("FAILED rosunit-drive: not a result: ")


def test_errors_that_belong_to_no_test(tmp_path):
    status, lines = count(tmp_path, rosunit_drive=f'{DRIVEN}<testsuite errors="1"/>')
    assert (status, lines) == (
        1,
        ["FAILED rosunit-drive: 1 errors outside its cases", "2 passed, 1 failed"],
    )


def test_no_results_at_all(tmp_path):
    nothing = {"pytest": None, "rosunit_drive": None, "rostest_test_drive": None}
    assert count(tmp_path, **nothing)[0] == 1
    (tmp_path / "empty").mkdir()
    assert count(tmp_path / "empty", files=(), **nothing) == (1, ["0 passed, 0 failed"])
