"""Check the program that runs the tests."""

import os
import signal
import subprocess
from xml.etree import ElementTree

import pytest

from support import fork_server
from support.paths import CHECKOUT

TESTS = {
    "passes": "def test_it(): pass",
    "fails": "def test_it(): assert 1 == 2",
    "cannot be imported": "import nothing_of_this_name",
    "dies": "import os\ndef test_it(): os._exit(0)",
    "dies at the end": "import atexit, os\natexit.register(os._exit, 7)\ndef test_it(): pass",
    "is skipped": "import pytest\ndef test_it(): pytest.skip('no display')",
    "is full": "import pytest\npytestmark = pytest.mark.full\ndef test_it(): assert 1 == 2",
    "has a full test": "import pytest\n@pytest.mark.full\ndef test_it(): assert 1 == 2",
    "has a right one": "class Tests:\n def test_1(self): pass\ndef test_2(): assert 1 == 2",
}


def full(*values):
    return pytest.param(*values, marks=pytest.mark.full)


@pytest.mark.parametrize(
    "arguments, names, status, lines",
    [
        ([], ["passes"], 0, ["1 passed, 0 failed, 0 skipped"]),
        ([], ["fails", "passes"], 1, ["FAILED", "assert 1 == 2", "1 passed, 1 failed, 0 skipped"]),
        ([], ["cannot be imported"], 1, ["nothing_of_this_name", "0 passed, 1 failed, 0 skipped"]),
        full([], ["dies"], 1, ["pytest ended with exit status 0", "0 passed, 1 failed, 0 skipped"]),
        full([], ["dies at the end"], 1, ["exit status 7", "0 passed, 1 failed, 0 skipped"]),
        ([], ["is skipped"], 1, ["no display", "0 passed, 0 failed, 1 skipped"]),
        ([], ["passes", "is full", "has a full test"], 0, ["1 passed, 0 failed, 0 skipped"]),
        full([], ["has a right one::test_1"], 0, ["1 passed, 0 failed, 0 skipped"]),
        ([], ["has a right one::test_2"], 1, ["assert 1 == 2", "0 passed, 1 failed, 0 skipped"]),
        full([], ["has a right one::Tests::test_1"], 0, ["1 passed, 0 failed, 0 skipped"]),
        full([], ["has a right one::test_2[a-b c]"], 1, ["0 passed, 1 failed, 0 skipped"]),
        ([], ["is full"], 1, ["no test was chosen; ", "0 passed, 0 failed, 0 skipped"]),
        (["--all"], ["passes", "is full"], 1, ["1 passed, 1 failed, 0 skipped"]),
        (["--all"], ["passes", "has a full test"], 1, ["1 passed, 1 failed, 0 skipped"]),
    ],
)
def test_results(tmp_path, arguments, names, status, lines):
    paths = []
    for number, name in enumerate(names):
        name, *test = name.split("::", 1)
        path = tmp_path / f"test_{number}.py"
        path.write_text(TESTS[name])
        paths.append("::".join([str(path), *test]))
    results = tmp_path / "results.xml"
    command = [os.path.join(CHECKOUT, "scripts/dev/run_tests"), *arguments, results, *paths]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == status, done.stdout
    for line in lines:
        assert line in done.stdout
    assert done.stdout.splitlines()[-1] == lines[-1]
    passed = [case for case in ElementTree.parse(results).iter("testcase") if not len(case)]
    assert len(passed) == int(lines[-1].split()[0])


def test_in_the_background_of_a_script(tmp_path):
    """Such a command ignores SIGINT, but the tests and their programs do not."""
    path = tmp_path / "test_it.py"
    path.write_text(
        "import signal\n"
        "def test_it(): assert signal.getsignal(signal.SIGINT) == signal.default_int_handler"
    )
    command = [os.path.join(CHECKOUT, "scripts/dev/run_tests"), tmp_path / "results.xml", path]
    own = {name: value for name, value in os.environ.items() if name != fork_server.SERVER}
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False, env=own)
    finally:
        signal.signal(signal.SIGINT, before)
    assert done.stdout.splitlines()[-1] == "1 passed, 0 failed, 0 skipped", done.stdout
