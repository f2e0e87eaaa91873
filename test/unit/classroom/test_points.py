"""Check the points of results, and the messages about a bad points.yaml."""

import json
import sys

import numpy as np
import pytest

from mushr_ros_intro.classroom.grader import judge_and_draw
from mushr_ros_intro.classroom.grades import PlanGrade
from mushr_ros_intro.classroom.points import PlanPoints, Points, read_points
from mushr_ros_intro.classroom.store import from_json, to_json
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.replay.judge import CHECK_NAMES
from mushr_ros_intro.replay.reference import read_references, resampled
from support.grades import graded, submission
from support.paths import CHECKOUT
from support.recorded import BEGIN, ROWS, STOP, commands, replay

PLANS = ("circle", "secret")
ALL = len(CHECK_NAMES)
"""The points of a plan whose checks give one point each."""


def read(folder, text):
    path = folder / "points.yaml"
    path.write_text(text)
    return read_points(str(path), PLANS)


def test_without_a_file_each_check_gives_one_point():
    points = read_points(None, PLANS)
    assert points.max_score() == 2 * ALL and points.max_score(["circle"]) == ALL
    assert points.points("circle", "topics") == 1 and not points.is_hidden("circle")
    result = submission(graded("circle", ["path", "rate"]), graded("secret"))
    assert points.score(result) == Points().score(result) == 2 * ALL - 2
    assert points.score(submission(fault="no file")) == 0


@pytest.mark.parametrize(
    ("text", "circle", "secret"),
    [
        ("", ALL, ALL),
        ("{}", ALL, ALL),
        ("plans:", ALL, ALL),
        ("default: {hidden: true}", ALL, ALL),
        ("default: {commands: 2, path: 3}", 5, 5),
        ("default: {path: 0.1, map: 0.2}", 0.3, 0.3),  # not 0.30000000000000004
        ("default: {path: 1e1}", 10, 10),
        ("plans: {circle: {path: 4}}", ALL + 3, ALL),
        ("default: {commands: 2}\nplans: {circle: {path: 4, commands: 0}}", 4, 2),
        ("default: {commands: 2}\nplans: {circle: {path: 4}, secret: {commands: 0}}", 6, 0),
    ],
)
def test_points_of_plans(tmp_path, text, circle, secret):
    points = read(tmp_path, text)
    assert points.max_score(["circle"]) == circle and points.max_score(["secret"]) == secret
    result = submission(*(graded(plan) for plan in PLANS))
    assert points.score(result) == points.max_score() == circle + secret


def test_checks_that_are_not_judged():
    """They cost nothing."""
    crashed = graded("circle", ["node", "path"], unjudged=["rate"])
    assert Points().plan_score(crashed) == ALL - 2 and not crashed.passed
    strict = Points(plans={"circle": PlanPoints(all_or_nothing=True)})
    assert strict.plan_score(crashed) == 0
    assert strict.loss(crashed).endswith("because 2 checks failed: node, path.")


def test_hidden_plans(tmp_path):
    by_default = read(tmp_path, "default: {hidden: true}\nplans: {circle: {hidden: false}}")
    for points in (by_default, read(tmp_path, "plans: {secret: {hidden: true}}")):
        assert points.is_hidden("secret") and not points.is_hidden("circle")


@pytest.mark.parametrize(
    ("text", "failed", "score", "loss"),
    [
        ("", [], ALL, ""),
        ("", ["path", "map"], ALL - 2, ""),
        ("", ["topics"], 0, "check topics failed"),
        ("default: {path: 3}", ["topics"], 0, "check topics failed"),
        ("default: {all_or_nothing: true}", ["path", "map"], 0, "2 checks failed: path, map."),
        ("default: {all_or_nothing: true}", [], ALL, ""),
        (
            *("default: {all_or_nothing: true}\nplans: {circle: {map: 2}}", ["path"], 0),
            "1 check failed: path.",
        ),
        ("plans: {secret: {all_or_nothing: true}}", ["path"], ALL - 1, ""),
        ("default: {path: 3, all_or_nothing: true}", ["map"], 3, ""),  # map gives no points
    ],
)
def test_failed_checks(tmp_path, text, failed, score, loss):
    points, plan = read(tmp_path, text), graded("circle", failed)
    assert points.plan_score(plan) == sum(points.earned(plan)) == score
    assert loss in points.loss(plan) and bool(points.loss(plan)) == bool(loss)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3", "the file has no keys; expected keys such as 'default"),
        ("defaults: {}", ": unknown key defaults; expected one of default, plans, tol"),
        ("default: 3", ": default: the value is 3; expected keys of node, topics"),
        ("default: 0", ": default: the value is 0; expected"),
        ("default: {paht: 3}", ": default: unknown key paht; expected one of node, topics, start_"),
        ("plans: [circle]", ": plans: the value is ['circle']; expected keys of circle, secret"),
        (
            "plans: {oval: {path: 3}}",
            ": plans: unknown key oval; expected one of circle, secret, or another file for "
            "--points; {} gives one point for each check",
        ),
        ("plans: {circle: 3}", ": plans: circle: the value is 3; expected keys of node"),
        ("plans: {circle: {path: -1}}", "plans: circle: path is -1; expected a number from 0 to 1"),
        ("default: {path: .inf}", ": default: path is inf; expected a number from 0"),
        ("default: {path: .nan}", ": default: path is nan; expected a number from 0"),
        ("default: {path: true}", ": default: path is True; expected a number from 0"),
        ("default: {path: many}", ": default: path is 'many'; expected a number from 0"),
        ("tolerances: {path: -1}", "tolerances: path is -1; expected a number from 0 to 1e+06"),
        ("tolerances: {path: .nan}", "tolerances: path is nan; expected a number from 0"),
        ("tolerances: {rms: 1}", "unknown key rms; expected one of position, angle, path"),
        ("default: {hidden: 1}", ": default: hidden is 1; expected true or false"),
        ("default: {path: 0}", ": all checks give 0 points; expected points for at least one"),
    ],
)
def test_bad_files(tmp_path, text, said):
    with pytest.raises(UserError) as error:
        read(tmp_path, text)
    assert said in str(error.value) and "points.yaml" in str(error.value)


def test_tolerances(tmp_path):
    """They are those of plans, or of paths; a number may have the form of YAML 1.2."""
    assert read(tmp_path, "tolerances: {path: 1e-9}").tolerances == {"path": 1e-9}
    path = tmp_path / "points.yaml"
    path.write_text("tolerances: {rms: 0.1}")
    assert read_points(str(path), PLANS, follows=True).tolerances == {"rms": 0.1}


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the picture out, which takes most of the time."""
    monkeypatch.setitem(sys.modules, "mushr_ros_intro.replay.pictures", None)


def sent_by(rows):
    """Return the points of a right node that sends other rows than those of the plan."""
    return Points().plan_score(
        PlanGrade("circle", *judge_and_draw(replay(sent=commands(rows)), {}))
    )


@pytest.mark.parametrize(
    ("rows", "low", "high"),
    [
        ([*ROWS, STOP], ALL, ALL),
        ([(0.001, 0.0, 0.1)], 0, 0),
        ([(0.0, 0.0, 3.0)], 0, 0),
        ([(speed, -angle, seconds) for speed, angle, seconds in ROWS], 0, 0),
        ([(2.0, 0.1, 0.1)], 0.01, 0.06 * ALL),
        ([*ROWS[:1], (1.0, 0.1, 0.75)], 0.2 * ALL, 0.58 * ALL),
        ([(2.0, 0.1, 60.0)], 0.2 * ALL, 0.58 * ALL),
    ],
)
def test_a_node_that_does_not_drive_the_plan(undrawn, rows, low, high):
    """It gets the points of its other checks by the share of the plan that it has driven."""
    assert low <= sent_by(rows) <= high


def test_the_share_is_explained():
    part = graded("circle", ["commands"], share=0.17)
    assert Points().plan_score(part) == pytest.approx(0.17 * (ALL - 1))
    assert "17 %" in Points().loss(part) and Points().loss(graded("circle", ["path"])) == ""


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_a_controller_that_stops_on_the_way(undrawn, share):
    """It gets the points by the share of the path that the car has followed."""
    (path,) = read_references(["wave"], f"{CHECKOUT}/plans").values()
    poses = resampled(np.array(path.poses), 0.04)
    poses = poses[: max(1, round(share * len(poses)))]
    stamps = BEGIN + 20_000_000 * np.arange(len(poses))
    seen = replay(grid=None, stamps=stamps, poses=poses)._replace(plan=path, start=path.start)
    seen = from_json(json.loads(json.dumps(to_json(seen))))  # as it is stored
    assert PlanGrade("wave", *judge_and_draw(seen, {})).share == pytest.approx(share, abs=0.02)
