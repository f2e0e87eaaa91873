"""Check the program that runs the tests."""

import os
import subprocess
from xml.etree import ElementTree

import pytest

from support.paths import CHECKOUT

TESTS = {
    "passes": "def test_it(): pass",
    "fails": "def test_it(): assert 1 == 2",
    "cannot be imported": "import nothing_of_this_name",
    "dies": "import os\ndef test_it(): os._exit(0)",
    "is skipped": "import pytest\ndef test_it(): pytest.skip('no display')",
    "is full": "import pytest\npytestmark = pytest.mark.full\ndef test_it(): assert 1 == 2",
    "has a full test": "import pytest\n@pytest.mark.full\ndef test_it(): assert 1 == 2",
    "has a right one": "class Tests:\n def test_1(self): pass\ndef test_2(): assert 1 == 2",
}


@pytest.mark.parametrize(
    "arguments, names, status, lines",
    [
        (
            [],
            ["fails", "passes", "cannot be imported", "dies", "is skipped"],
            1,
            [
                "FAILED",
                "assert 1 == 2",
                "nothing_of_this_name",
                "no display",
                "pytest ended with exit status 0",
                "1 passed, 3 failed, 1 skipped",
            ],
        ),
        ([], ["passes", "is full", "has a full test"], 0, ["1 passed, 0 failed, 0 skipped"]),
        ([], ["has a right one::test_2"], 1, ["assert 1 == 2", "0 passed, 1 failed, 0 skipped"]),
        ([], ["is full"], 1, ["no test was chosen; ", "0 passed, 0 failed, 0 skipped"]),
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
