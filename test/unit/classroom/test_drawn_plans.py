"""Check the drawn plans: as difficult as the given plan, never symmetric, on free places."""

import math
import os
from functools import partial

import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.classroom import drawn_plans
from mushr_ros_intro.classroom.arguments import parse_arguments
from mushr_ros_intro.classroom.assignment import Plans
from mushr_ros_intro.classroom.drawn_plans import draw_plan
from mushr_ros_intro.classroom.submissions import Submission
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.plan.parse import parse_plan, read_plan
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.replay.setting import read_setting
from mushr_ros_intro.stamps import COMMAND_PERIOD
from mushr_ros_intro.world.map_file import read_map
from support.geometry import closed_form
from support.paths import PACKAGE

LIKE = "0,0,0.5\n1.0,0.1,2\n2.0,-0.1\n2.0,-0.1,2\n1.5,0.2,2\n1.0,0,1\n"
TEST_DRIVE = os.path.join(PACKAGE, "plans", "test_drive.txt")


def drawn(name, like=LIKE, secret="7", map_name="sandbox", car=None):
    """Return the plan of a submission."""
    plan = read_plan(like) if os.path.exists(like) else parse_plan(like.encode(), "like.txt")
    grid = read_map(os.path.join(PACKAGE, "maps", f"{map_name}.yaml"))
    report = partial(check, car_name="ideal", car=car or Car(), map_name=map_name, grid=grid)
    return draw_plan(plan, secret, name, report, grid)


def parts(rows):
    """Return speed, absolute angle and duration of all rows, in an order that does not matter."""
    return sorted((row.speed, abs(row.steering_angle), row.duration) for row in rows)


def test_a_drawn_plan_is_another_one_and_not_symmetric():
    like = parse_plan(LIKE.encode(), "like.txt")
    orders = set()
    for name in ("ann", "bob", "eve"):
        plan = drawn(name)
        assert parts(plan.rows) == parts(like.rows) and plan.start != like.start
        commands = [(*each[:2], each.duration) for each in plan.rows]
        back = commands[::-1]
        assert commands not in (back, [(speed, -angle, time) for speed, angle, time in back])
        orders.add(tuple(commands))
    assert len(orders) == 3


@pytest.mark.parametrize(
    ("name", "secret", "start", "commands"),
    [
        ("ann", "7", (1.3, -2.5, 2.51), "1.5 -0.1; 2.5 -0.05; 1 0; 2 0.2; 0.5 0.25; -1 -0.3"),
        ("bob", "7", (1.2, -2.3, -2.15), "1.5 0.1; 0.5 -0.25; 2.5 -0.05; 1 0; -1 -0.3; 2 0.2"),
        (
            *("Zoe-3f2a1b", "a secret of 2026", (2.7, -1.3, 1.78)),
            "1.5 0.1; 1 0; 2 -0.2; 0.5 0.25; 2.5 0.05; -1 0.3",
        ),
    ],
)
def test_the_same_on_every_machine_and_in_every_version(name, secret, start, commands):
    """A course that grades again gets the same plans: these numbers never change."""
    plan = drawn(name, TEST_DRIVE, secret)
    rows = [f"{row.speed:.6g} {row.steering_angle:.6g}" for row in plan.rows]
    assert (plan.start, "; ".join(rows)) == (start, commands)


def test_angles_with_the_wrong_sign_do_not_pass():
    """Without this rule, a quarter of these submissions gets a plan for which they do."""
    for number in range(8):
        plan = drawn(f"s{number}", "0,0,0\n1,0.02\n2,0.02\n3,-0.02\n", map_name="sandbox")
        rows = [(*each[:2], each.duration / 1e9) for each in plan.rows]
        wrong = [(speed, -angle, seconds) for speed, angle, seconds in rows]
        end, other = closed_form(plan.start, rows), closed_form(plan.start, wrong)
        rate = max(abs(speed * math.tan(angle)) for speed, angle, _ in rows) / 0.33
        turn = abs(math.remainder(end[2] - other[2], math.tau))
        far = math.dist(end[:2], other[:2])
        assert far > 0.001 + 0.2 * 3.0 or turn > 0.001 + 0.2 * rate


TURNS = "0,0,0\n2,0.2,0.8\n2,-0.2,1.5\n2,0.2,1.5\n2,-0.2,1.5\n2,0.2,0.8\n2,0\n"


def test_a_command_more_or_less_hits_no_wall():
    """Without this rule, each of these submissions gets a plan on which it does.

    So it is for s320 without shorter parts, s12 without shifted borders, s181 without longer parts.
    """
    grid = read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml"))
    for name in ("s320", "s12", "s181"):
        plan = drawn(name, TURNS)
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


def test_a_straight_plan():
    assert drawn("ann", "0,0,0\n1,0,1\n2,0,1\n1.5,0,1\n")


@pytest.mark.parametrize(
    ("like", "options", "said"),
    [
        ("0,0,0\n1,0.1\n1,-0.1\n", {}, "because every other order of its rows is symmetric"),
        (LIKE + "1,0.3,0.75\n", {}, "like.txt:7:7: duration is 0.75 s; expected whole tenths"),
        (LIKE + "6,0,9\n", {"map_name": "rooms"}, "like.txt: found no plan for ann in 20 att"),
        ("0,0,0\n9,0\n8,0\n7,0\n", {"car": Car(speed_limit=1.0)}, "found no plan for ann"),
    ],
)
def test_a_plan_that_cannot_be_drawn_from(monkeypatch, like, options, said):
    monkeypatch.setattr(drawn_plans, "ATTEMPTS", 20)
    with pytest.raises(UserError) as error:
        drawn("ann", like, **options)
    assert said in str(error.value)


def setting(map_name):
    others = {"remap": (), "tolerances": {}, "sandbox": Sandbox(), "ros": {}}
    return read_setting(PACKAGE, "ideal", map_name, **others)


@pytest.mark.parametrize(
    ("named", "like"), [(["slalom"], ""), (["turns"], "turns"), ([], "test_drive")]
)
def test_each_submission_has_its_own_plan(tmp_path, monkeypatch, named, like):
    """Its rows are those of the first named plan, or of test_drive."""
    (tmp_path / "turns.txt").write_text(LIKE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PWD", str(tmp_path))
    words = ["class", "--plans", *named, "drawn", "--secret", "7", "--out", "out"]
    plans = Plans(parse_arguments(words, ""))
    assert plans.names == [*named, "drawn"]
    (tmp_path / "workspace").mkdir()
    found = {}
    for name in ("ann", "bob"):
        folder = str(tmp_path / "workspace" / name)
        submission = Submission(name, (), "", (), folder)
        if not like:
            with pytest.raises(UserError, match="expected whole tenths of a second"):
                plans.of(submission, setting("sandbox"))
            return
        found[name] = plans.of(submission, setting("sandbox"))
        assert list(found[name]) == [*named, "drawn"]
        rows = read_plan(f"{like}.txt" if named else TEST_DRIVE).rows
        assert parts(found[name]["drawn"].rows) == parts(rows)
        path = found[name]["drawn"].path
        assert os.path.basename(path) == "drawn.txt"
        assert os.stat(os.path.dirname(path)).st_mode & 0o777 == 0o700
    assert found["ann"]["drawn"].rows != found["bob"]["drawn"].rows


def test_a_secret_and_drawn_belong_together(tmp_path, monkeypatch, capsys):
    for words in (["--plans", "drawn"], ["--plans", "test_drive", "--secret", "7"]):
        with pytest.raises(SystemExit):
            parse_arguments(["class", "--out", "out", *words], "")
        assert "--secret" in capsys.readouterr().err
    (tmp_path / "drawn.txt").write_text(LIKE)
    words = ["class", "--plans", str(tmp_path / "drawn.txt"), "drawn", "--secret", "7"]
    with pytest.raises(UserError, match="two plans with the name 'drawn'"):
        Plans(parse_arguments([*words, "--out", "out"], ""))


def test_a_plan_that_hits_a_wall_is_refused():
    """Otherwise all students fail."""
    plans = Plans(parse_arguments(["class", "--plans", "slalom", "--out", "out"], ""))
    for name in ("sandbox", "none"):
        plans.check_map(setting(name))
    with pytest.raises(
        UserError, match=r"slalom.txt:\d+:1: the car hits a wall at .*\. No node can"
    ):
        plans.check_map(setting("rooms"))
