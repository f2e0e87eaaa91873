"""compare_drive.py: what it prints, and its exit status."""

import os
import random
import re
import sys

import pytest

from mushr_ros_intro.car.profile import car_from, read_profile
from mushr_ros_intro.comparison.drive_log import drive_log
from mushr_ros_intro.comparison.fit import Combined
from mushr_ros_intro.comparison.profile_file import vesc_text, write_profile
from mushr_ros_intro.errors import exit_status
from mushr_ros_intro.parameters import Parameters
from support.cars import CARS, plan_of
from support.paths import PACKAGE
from support.recorded_drive import received

sys.path.append(os.path.join(PACKAGE, "src"))

import compare_drive  # noqa: E402

NANO = CARS["mushr_nano"]


CAR = ("--car", "mushr_nano")


@pytest.fixture(scope="module")
def drives():
    """Return the commands, the poses, and the poses if the car slips.

    The car is 10 % slow; if it slips, it drives at half of this speed in one row.
    """
    plan = plan_of("0, 0, 0\n0.5, 0, 2\n0.3, 0, 2\n0.5, 0, 2\n0.3, 0, 2")
    rows = [
        row._replace(speed=0.5 * row.speed) if i == 2 else row for i, row in enumerate(plan.rows)
    ]
    slow, options = NANO._replace(speed_gain=0.9), {"rate": 6.0, "position": 0.005}
    messages, slipping = (
        received(each, slow, random.Random(1), heading=0.005, **options)
        for each in (plan, plan._replace(rows=tuple(rows)))
    )
    return *messages, slipping[1]


@pytest.fixture
def run(monkeypatch, capsys, drives):
    """Return a function that runs the program, and returns its exit status and its outputs."""
    commands, regular, slipping = drives

    def call(*arguments):
        monkeypatch.setattr("signal.signal", lambda *_: None)  # SIGPIPE would end pytest
        monkeypatch.setattr(sys, "argv", ["compare_drive.py", *arguments])
        status = exit_status("compare_drive.py", compare_drive.run)
        return (status, *capsys.readouterr())

    def use(slips=False):
        poses = slipping if slips else regular
        monkeypatch.setattr(
            compare_drive,
            "read_bag",
            lambda path, *_: drive_log(path, commands, poses, NANO.command_timeout),
        )

    call.read = use
    return call


def test_text(run):
    run.read()
    status, text, errors = run("a.bag", "--car", "mushr_nano")
    assert (status, errors) == (0, "")
    assert text.startswith("a.bag: 4 rows of commands, ")
    assert "% slower than predicted" in text.splitlines()[-1]


def test_interrupted(run, monkeypatch):
    """Ctrl-C ends a long computation without a traceback."""

    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(compare_drive, "read_bag", interrupt)
    assert run("a.bag") == (130, "", "")


def test_files(run, tmp_path):
    """The picture, and a profile that a plan can be checked with."""
    run.read()
    vesc, profile = tmp_path / "vesc.yaml", tmp_path / "my_car.yaml"
    vesc.write_text(
        "speed_to_erpm_gain: -3500\nsteering_angle_to_servo_gain: 0.95\n"
        "steering_angle_to_servo_offset: 0.55\n"
    )
    options = ("--fit", str(profile), "--vesc", str(vesc), "--out", str(tmp_path / "out"))
    status, text, errors = run("a.bag", "--car", "mushr_nano", *options)
    assert (status, errors) == (0, "")
    folder = tmp_path / "out" / "1_a"
    assert (folder / "path.png").read_bytes().startswith(b"\x89PNG")
    _, first, *_, last = (folder / "trajectory.csv").read_text().splitlines()
    assert [*map(float, first.split(",")[1:4])] == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    assert [*map(float, last.split(",")[4:7])] == pytest.approx([3.2, 0.0, 0.0], abs=0.1)
    assert "% slower than predicted" in text.splitlines()[-1]
    car = car_from(Parameters({**read_profile(str(profile)), "noise": True}))
    assert car.speed_gain == pytest.approx(0.9, abs=0.05)
    unchanged = ("wheelbase", "track", "speed_limit", "steering_gain")
    for name in unchanged:
        assert getattr(car, name) == getattr(NANO, name)
    assert car.speed_noise > 0.0
    (line,) = re.findall("speed_to_erpm_gain .*", text)
    old, new = map(float, line.split()[1:])
    assert old == -3500.0
    assert new == pytest.approx(-3500.0 / car.speed_gain, rel=1e-3)
    sources = profile.read_text()
    assert "mushr_nano.yaml; the drives do not determine it.\nsteering_gain: 1" in sources
    assert re.search(r"# Fitted; 95 % range 0.\d+ to 0.\d+.\nspeed_gain: ", sources)


def test_a_drive_that_nothing_known_explains_writes_nothing(run, tmp_path):
    run.read(slips=True)
    vesc, profile = tmp_path / "vesc.yaml", tmp_path / "my_car.yaml"
    options = ("--car", "mushr_nano")
    status, text, errors = run("a.bag", *options)
    assert (status, errors) == (2, "")
    assert text.splitlines()[-1].startswith("a.bag: nothing known explains this drive: from ")
    assert "speed_gain" not in text
    for option, path in (("--fit", profile), ("--vesc", vesc)):
        status, text, errors = run("a.bag", *options, option, str(path))
        assert status == 2
        assert errors.startswith(f"compare_drive.py: {option}: no ")
        assert not path.exists()


def test_two_drives_of_one_car(run):
    run.read()
    status, text, errors = run("a.bag", "b.bag", "--car", "mushr_nano")
    assert (status, errors) == (0, "")
    assert re.search(r"standard deviation between the drives: speed_gain 0.0000", text)
    first, second = text.splitlines()[-2:]
    assert (first.split()[0], second.split()[0]) == ("a.bag:", "b.bag:")


def test_new_values_for_a_car_that_steers_too_much_and_to_the_left(tmp_path):
    """A servo at 0.5 + 0.8 a gives the angle 1.25 (a + 0.025) on a car that needs 0.48 + 0.64 a."""
    car = NANO._replace(steering_gain=1.25, steering_offset=0.03125)
    path = tmp_path / "vesc.yaml"
    names = ("speed_to_erpm_gain", "steering_angle_to_servo_gain", "steering_angle_to_servo_offset")
    path.write_text("".join(f"{name}: {old}\n" for name, old in zip(names, (4614, 0.8, 0.5))))
    _, *lines = vesc_text(car._replace(speed_gain=0.5), str(path))
    assert [line.split() for line in lines] == [
        [names[0], "4614", "9228"],
        [names[1], "0.8", "0.64"],
        [names[2], "0.5", "0.48"],
    ]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("none.bag",), "compare_drive.py: none.bag: the bag cannot be read (No such file"),
        (("a.bag", "--car", "nano"), "nano: no such file"),
        (("a.bag", *CAR, "--vesc", "v.yaml"), "v.yaml: the file cannot be read"),
        (
            ("a.bag", *CAR, "--fit", "/none/a.yaml"),
            "--fit: /none/a.yaml cannot be written (No such",
        ),
        (("a.bag", "--out", "/proc/out"), "--out: /proc/out cannot be written ("),
        (("a.bag", "--pose_offset", "far"), "parameter --pose_offset is 'far'; expected a number"),
    ],
)
def test_wrong_arguments(run, arguments, expected):
    if "none.bag" not in arguments:
        run.read()
    status, text, errors = run(*arguments)
    assert status == 2
    assert "written" not in text
    assert expected in errors
    assert errors.count("\n") == 1


def test_a_fitted_profile_keeps_the_other_numbers(tmp_path):
    path = str(tmp_path / "my_car.yaml")
    slow = NANO._replace(command_timeout=500_000_000)
    write_profile(path, Combined(slow, {}, {}), "mushr_nano.yaml", ["a.bag"])
    car = car_from(Parameters({**read_profile(path), "noise": True}))
    assert car._replace(seed=slow.seed) == slow
