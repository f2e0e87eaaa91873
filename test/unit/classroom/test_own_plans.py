"""Check the plans of students: as difficult as the given plan, never symmetric, on free places."""

import csv
import math
import os
import runpy
import subprocess
import sys
from unittest import mock

import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.classroom import own_plans
from mushr_ros_intro.classroom.arguments import parse_arguments
from mushr_ros_intro.classroom.assignment import Plans
from mushr_ros_intro.classroom.grades import Student
from mushr_ros_intro.classroom.submissions import Submission, collect
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.replay.setting import read_setting
from mushr_ros_intro.stamps import COMMAND_PERIOD
from mushr_ros_intro.world.map_file import read_map
from support.geometry import closed_form
from support.paths import CHECKOUT, PACKAGE
from support.submissions import fill

LIKE = "0,0,0.5\n1.0,0.1,2\n2.0,-0.1\n2.0,-0.1,2\n1.5,0.2,2\n1.0,0,1\n"
CLASS = "Student,ID,SIS Login ID,Section\n  Points Possible,,,\nAnn,17,ann7,1\nBob,18,,1\nEve,,,\n"


def make(folder, *arguments, like=LIKE, students=CLASS):
    """Run make_plans in this process; return the exit status."""
    (folder / "like.txt").write_text(like)
    (folder / "class.csv").write_text(students)
    files = ("--like", folder / "like.txt", "--students", folder / "class.csv")
    words = ["make_plans", *files, "--out", folder / "plans", *arguments]
    argv, path = mock.patch("sys.argv", [*map(str, words)]), mock.patch("sys.path", [*sys.path])
    with argv, path, pytest.raises(SystemExit) as ended:
        runpy.run_path(os.path.join(CHECKOUT, "scripts", "make_plans"), run_name="__main__")
    return ended.value.code


@pytest.mark.parametrize("name", ["make_plans", "make_autograder"])
def test_without_a_workspace(name):
    """The script runs in a terminal in which no workspace is sourced."""
    command = [os.path.join(CHECKOUT, "scripts", name), "--help"]
    subprocess.run(command, env={"PATH": "/usr/bin:/bin"}, stdout=subprocess.DEVNULL, check=True)


def texts(folder):
    return {path.name: path.read_text() for path in (folder / "plans").iterdir()}


def parts(rows):
    """Return speed, absolute angle and duration of all rows, in an order that does not matter."""
    return sorted((row.speed, abs(row.steering_angle), row.duration) for row in rows)


def test_plans(tmp_path, capsys):
    assert make(tmp_path, "--seed", 7) == 0
    assert "3 plans of 12.00 m and 8 s, with 3 different orders of rows" in capsys.readouterr().out
    like = read_plan(str(tmp_path / "like.txt"))
    with open(tmp_path / "plans" / "plans.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert [(row["Name"], row["IDs"], row["Plan"]) for row in table] == [
        ("Ann", "17; ann7", "Ann.txt"),
        ("Bob", "18", "Bob.txt"),
        ("Eve", "", "Eve.txt"),
    ]
    for row in table:
        plan = read_plan(str(tmp_path / "plans" / row["Plan"]))
        assert parts(plan.rows) == parts(like.rows) and plan.start != like.start
        commands = [(*each[:2], each.duration) for each in plan.rows]
        back = commands[::-1]
        assert commands not in (back, [(speed, -angle, time) for speed, angle, time in back])
        end = closed_form(plan.start, [(*each[:2], each.duration / 1e9) for each in plan.rows])
        assert float(row["x [m]"]) == pytest.approx(end[0], abs=1e-4)
        assert float(row["y [m]"]) == pytest.approx(end[1], abs=1e-4)
        turned = float(row["theta [rad]"]) - end[2]
        assert math.remainder(turned, math.tau) == pytest.approx(0.0, abs=1e-4)


def test_the_seed_and_the_student_determine_the_plan(tmp_path):
    made = []
    for number, (seed, students) in enumerate(
        [(7, CLASS), (7, CLASS), (8, CLASS), (7, CLASS.replace("Eve,,,\n", ""))]
    ):
        (tmp_path / str(number)).mkdir()
        assert make(tmp_path / str(number), "--seed", seed, students=students) == 0
        made.append(texts(tmp_path / str(number)))
    assert made[0] == made[1]
    assert made[0]["Ann.txt"] == made[3]["Ann.txt"] and len(made[3]) == 3
    for name in ("Ann.txt", "Bob.txt", "Eve.txt"):
        assert made[0][name] != made[2][name]
    assert (
        made[0]["Ann.txt"]
        == (  # the same in all versions of Python
            "# x [m], y [m], theta [rad]\n1.4, -1.0, -3.1\n"
            "# speed [m/s], steering angle [rad], duration [s]\n"
            "1.0, 0.0, 1.0\n1.0, -0.1, 2.0\n2.0, 0.1, 1.0\n2.0, 0.1, 2.0\n1.5, 0.2, 2.0\n"
        )
    )


def test_angles_with_the_wrong_sign_do_not_pass(tmp_path):
    """Without this rule, each of these students gets a plan for which they do."""
    with open(os.path.join(PACKAGE, "plans", "test_drive.txt"), encoding="ascii") as file:
        like = file.read()
    assert make(tmp_path, "--seed", 7, like=like, students="name\ns64\ns243\ns525\n") == 0
    for path in (tmp_path / "plans").glob("*.txt"):
        plan = read_plan(str(path))
        rows = [(*each[:2], each.duration / 1e9) for each in plan.rows]
        wrong = [(speed, -angle, seconds) for speed, angle, seconds in rows]
        end, other = closed_form(plan.start, rows), closed_form(plan.start, wrong)
        rate = max(abs(speed * math.tan(angle)) for speed, angle, _ in rows) / 0.33
        turn = abs(math.remainder(end[2] - other[2], math.tau))
        far = math.dist(end[:2], other[:2])
        assert far > 0.001 + 0.2 * 2.5 or turn > 0.001 + 0.2 * rate


def test_a_command_more_or_less_hits_no_wall(tmp_path):
    """Without this rule, each of these students gets a plan on which it does.

    So it is for s8 without shorter parts or without shifted borders, for s28 without longer parts,
    and for s268 without parts of another length.
    """
    like = "0,0,0\n2,0.2,0.8\n2,-0.2,1.5\n2,0.2,1.5\n2,-0.2,1.5\n2,0.2,0.8\n2,0\n"
    assert make(tmp_path, "--seed", 3, like=like, students="name\ns8\ns28\ns268\n") == 0
    grid = read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml"))
    for path in (tmp_path / "plans").glob("*.txt"):
        plan = read_plan(str(path))
        sent = [
            row._replace(duration=COMMAND_PERIOD, line=0, columns=(1, 1))
            for row in plan.rows
            for _ in range(row.duration // COMMAND_PERIOD)
        ]
        drives = [sent, sent[1:], sent + sent[-1:]]
        for i in range(1, len(sent)):
            if sent[i] != sent[i - 1]:
                a, b = sent[i - 1 : i + 1]
                for around in ([a], [b], [a, a], [b, b], [a, a, b], [a, b, b]):
                    drives.append([*sent[: i - 1], *around, *sent[i + 1 :]])
        for rows in drives:
            driven = plan._replace(rows=tuple(rows))
            assert not check(driven, "ideal", Car(), "sandbox", grid).faults


def test_a_straight_plan(tmp_path):
    assert make(tmp_path, "--seed", 7, like="0,0,0\n1,0,1\n2,0,1\n1.5,0,1\n") == 0


@pytest.mark.parametrize(
    ("arguments", "files", "said"),
    [
        ((), {"like": "0,0,0\n1,0.1\n1,-0.1\n"}, "like.txt: every other order of its rows is symm"),
        (
            (),
            {"like": "0,0,0\n1,x\n"},
            "like.txt:2:3: steering angle is 'x', which is not a number",
        ),
        (
            (),
            {"like": LIKE + "1,0.3,0.75\n"},
            "like.txt:7:7: duration is 0.75 s; expected whole tenths of a second",
        ),
        (
            ("--map", "rooms"),
            {"like": LIKE + "6,0,9\n"},
            "like.txt: found no plan for 17 in 20 att",
        ),
        (("--car", "mushr_nano"), {"like": "0,0,0\n90,0\n"}, "like.txt:2:1: "),
        (
            (),
            {"students": "a,b\n1,2\n"},
            "class.csv:1: expected the names of columns, one of: name",
        ),
        ((), {"students": "name\n"}, "class.csv: expected at least one student"),
        ((), {"students": "name,id\nAnn,1\nBob,1\n"}, "class.csv:3: the student 1 occurs twice"),
        ((), {"students": "name;section\nAnn;1\n;2\n"}, "class.csv:3: the student has neither"),
    ],
)
def test_bad_input(tmp_path, capsys, monkeypatch, arguments, files, said):
    monkeypatch.setattr(own_plans, "ATTEMPTS", 20)
    assert make(tmp_path, "--seed", 7, *arguments, **files) == 2
    assert capsys.readouterr().err.startswith(f"make_plans: {tmp_path}/{said}")
    assert not (tmp_path / "plans").exists()


def test_each_submission_has_its_own_plan(tmp_path):
    assert make(tmp_path, "--seed", 7, students=CLASS + "Bob,19,,\n") == 0
    words = [str(tmp_path / "class"), "--plans-for", str(tmp_path / "plans"), "--out", "out"]
    plans = Plans(parse_arguments([*words, "--plans", "slalom"], ""))
    assert plans.names == ["slalom", "plans"]
    for name, students, found in (
        ("x", [("someone", "17", "")], "Ann"),
        ("x", [("", "", "ann7"), ("Eve", "", "")], "Ann"),
        ("eve", [], "Eve"),
        ("x", [("bob", "18", "")], "Bob"),
        ("x", [("bob", "", "", "18")], "Bob"),
        ("x", [("bob", "", "")], None),  # there are two
    ):
        students = tuple(Student(*each) for each in students)
        task = plans.task(Submission(name, students, "", (), "", (), (), False), True)
        if found:
            assert os.path.basename(task.plans["plans"].path) == f"{found}.txt" and not task.error
        else:
            assert task.error == "plans/plans.csv has no plan for bob, or two; expected one line"


def test_names_of_files_that_are_equal(tmp_path):
    """The name of a submission does not tell which of these students has handed it in."""
    students = "name,id\nann lee,1\nAnn_Lee,2\nBo,3\nBo,4\nCy Poe,5\n"
    assert make(tmp_path, "--seed", 7, students=students) == 0
    own = own_plans.OwnPlans(str(tmp_path / "plans"))
    names = {"1": "ann_lee", "2": "Ann_Lee-2", "3": "Bo", "4": "Bo-2", "5": "Cy_Poe"}
    for number, name in names.items():
        submission = Submission("x", (Student("", number, ""),), "", (), "", (), (), False)
        assert own.find(submission).name == name
        found = own.find(Submission(name, (), "", (), "", (), (), False))
        assert (found and found.name) == (name if name == "Cy_Poe" else None)


def test_names_that_look_like_formulas(tmp_path):
    """They get an apostrophe in the table, and their students still get their plans."""
    students = "name,id,login\n=1+1,-ann,@ann\nBob,18,@bob\n"
    assert make(tmp_path, "--seed", 7, students=students) == 0
    with open(tmp_path / "plans" / "plans.csv", newline="") as file:
        found = [(row["Name"], row["IDs"]) for row in csv.DictReader(file)]
    assert found == [("'=1+1", "'-ann; '@ann"), ("Bob", "18; '@bob")]
    own = own_plans.OwnPlans(str(tmp_path / "plans"))
    for student, name in (
        (("=1+1", "", ""), "1_1"),
        (("", "-ann", ""), "1_1"),
        (("", "@bob", ""), "Bob"),
    ):
        submission = Submission("x", (Student(*student),), "", (), "", (), (), False)
        assert own.find(submission).name == name


def test_names_that_are_not_ascii(tmp_path):
    """Each student gets their own plan, not that of another one whose letters are lost, too."""
    assert make(tmp_path, "--seed", 7, students="name\n\u674e\u660e\n") == 0
    own = own_plans.OwnPlans(str(tmp_path / "plans"))
    for name in ("\u674e\u660e", "\u738b\u82b3"):
        fill(tmp_path / "class" / name, {"path_publisher.py": b""})
    one, other = collect([str(tmp_path / "class")], str(tmp_path / "workspace"))
    assert own.find(one).name == one.name == "submission-aa2271"
    assert own.find(one._replace(name="x")).name == one.name  # by the name of its student
    assert own.find(other) is None


def test_a_plan_that_hits_a_wall_is_refused():
    """Otherwise all students fail."""
    plans = Plans(parse_arguments(["class", "--plans", "slalom", "--out", "out"], ""))
    others = {"remap": (), "timeout": 9.0, "tolerances": {}, "sandbox": Sandbox(), "ros": {}}
    for name in ("sandbox", "none"):
        plans.check_map(read_setting(PACKAGE, "ideal", name, None, **others))
    with pytest.raises(
        UserError, match=r"slalom.txt:\d+:1: the car hits a wall at .*\. No node can"
    ):
        plans.check_map(read_setting(PACKAGE, "ideal", "rooms", None, **others))
