"""compare_drive.py: what it prints, and its exit status."""

import json
import os
import random
import sys

import pytest

from mushr_ros_intro.comparison.drive_log import drive_log
from support.cars import CARS, plan_of
from support.paths import PACKAGE
from support.recorded_drive import received

sys.path.append(os.path.join(PACKAGE, "src"))

import compare_drive  # noqa: E402

NANO = CARS["mushr_nano"]


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs the program, and returns its exit status and its outputs.

    The bags contain the same drive of a car that is 10 % slow.
    """
    plan = plan_of("0, 0, 0\n0.5, 0, 2")
    slow = NANO._replace(speed_gain=0.9)
    messages = received(plan, slow, random.Random(1), rate=6.0)

    def read(path, source, timeout):
        return drive_log(path, *messages, timeout)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["compare_drive.py", *arguments])
        status = compare_drive.main()
        return (status, *capsys.readouterr())

    call.read = lambda: monkeypatch.setattr(compare_drive, "read_bag", read)
    return call


def test_text(run):
    run.read()
    status, text, errors = run("a.bag", "--car", "mushr_nano")
    assert (status, errors) == (0, "")
    assert text.startswith("a.bag: 1 row, ")
    assert "% slower than commanded" in text.splitlines()[-1]


def test_json(run):
    run.read()
    status, text, errors = run("a.bag", "b.bag", "--car", "mushr_nano", "--json")
    assert (status, errors) == (0, "")
    values = json.loads(text)
    assert [each["drive"] for each in values["drives"]] == ["a.bag", "b.bag"]
    assert values["fit"]["speed_gain"]["value"] == pytest.approx(0.9, abs=0.05)
    assert values["fit"]["steering_gain"]["fitted"] is False


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("none.bag",), "compare_drive.py: none.bag: the bag cannot be read (No such file"),
        (("a.bag", "--plan", "figure8"), "figure8: no such file; did you mean figure_8"),
        (("a.bag", "--car", "nano"), "nano: no such file"),
        (("a.bag", "--pose_offset", "far"), "parameter --pose_offset is 'far'; expected a number"),
    ],
)
def test_wrong_arguments(run, arguments, expected):
    if "--plan" in arguments:
        run.read()
    status, text, errors = run(*arguments)
    assert (status, text) == (2, "")
    assert expected in errors
    assert errors.count("\n") == 1
