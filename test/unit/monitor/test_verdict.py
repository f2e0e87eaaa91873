"""Test how a drive is judged, with commands and reports that a test makes."""

from types import SimpleNamespace

import pytest

from mushr_ros_intro.car.model import Car, Command
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.monitor import watched_drive
from mushr_ros_intro.monitor.drive import Drive, Expectation, PlannedDrive, Report
from mushr_ros_intro.monitor.verdict import settled, start_fault, verdict
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview.prediction import trajectory

MS = 10**6
BEGIN = 5000 * MS
PLAN = parse_plan(b"1,2,0.5\n1,0.1\n-0.5,0.2\n", "plan.txt")
STATES = tuple(trajectory(PLAN, Car()))
END = STATES[-1].pose
AWAY = Pose(7.0, 8.0, 0.0)
NAME = "/ann"


def expected(is_placed=True, is_exact=True):
    return Expectation(PLAN, STATES, 1.5, is_placed, is_exact)


def planned(seconds=2.0, before=PLAN.start, expectation=None):
    """Return a drive whose node sends the commands of the plan for some time, and then a stop."""
    rows = [(BEGIN + i * 100 * MS, PLAN.rows[i // 10]) for i in range(round(10 * seconds))]
    first, *others = (Command(stamp, row.speed, row.steering_angle) for stamp, row in rows)
    drive = Drive(first, [Report(BEGIN - 10 * MS, before)])
    for each in others:
        drive.add(each)
    drive.add(Command(BEGIN + round(seconds * 1000) * MS, 0.0, 0.0))
    return PlannedDrive(expectation or expected(), drive)


def judged(drive, at):
    report = Report(BEGIN + 2500 * MS, at) if at else None
    return verdict(NAME, drive, report, is_reported=True)


def test_a_plan_that_has_been_driven():
    result = judged(planned(), END)
    assert result.is_good
    assert result.lines[0] == f"the plan has been driven; the car should end at {END}"
    assert result.lines[1].startswith(f"the car drove 1.50 m and stopped at {END}; difference 0.0")


def test_a_drive_that_ends_early():
    """Its node is named, and the line; the car is not blamed."""
    drive = planned(0.7)
    for stamp in (800, 820):
        drive.drive.report(Report(BEGIN + stamp * MS, AWAY))
    result = judged(drive, None)
    assert not result.is_good
    assert result.lines == [f"the drive of {NAME} ended in line 2 of 3; the car stopped at {AWAY}"]


@pytest.mark.parametrize(
    ("is_placed", "is_exact", "is_good"), [(True, True, False), (True, False, True)]
)
def test_another_final_pose(is_placed, is_exact, is_good):
    """It is an error if the parameters of the car are known, and it has no noise."""
    result = judged(planned(expectation=expected(is_placed, is_exact)), AWAY)
    assert result.is_good is is_good
    if not is_good:
        assert f"the car was at {AWAY}, but it should have ended at {END}" in result.lines[0]
        assert "commands for the car were those of the plan" in result.lines[0]
    else:
        assert "has been driven" not in "".join(result.lines)


def test_who_is_named_for_a_wrong_pose():
    """What has been observed, before the commands of the node."""
    facts = {"others": {"/bob", "the input teleop"}, "lost": "line 3 of 3"}
    named = {"others": "/bob, the input teleop also published", "lost": "In line 3"}
    while facts:
        drive = planned()
        vars(drive.drive).update(facts)
        text = judged(drive, AWAY).lines[0]
        name = next(iter(facts))
        assert named[name] in text and "commands for the car" not in text
        del facts[name]


def test_a_car_that_was_placed_during_the_drive():
    drive = planned()
    drive.drive.placed = Report(BEGIN + 1200 * MS, AWAY)
    assert (
        f"In line 3 of 3, the car was placed at another pose: it was at {AWAY}"
        in (judged(drive, AWAY).lines[0])
    )


def test_a_wall():
    for is_placed in (True, False):
        drive = planned(expectation=expected(is_placed))
        drive.drive.wall = Report(BEGIN + 1200 * MS, AWAY)
        wall = f"the car stopped at a wall in line 3 of 3 at {AWAY}"
        assert judged(drive, END)[:2] == (False, [wall])


def test_a_car_that_is_lost():
    drive = planned()
    drive.drive.lost = "line 2 of 3"
    result = judged(drive, None)
    assert not result.is_good and "since line 2 of 3, so it is not known" in result.lines[0]


def test_without_a_start_pose_the_end_is_relative_to_the_start():
    result = judged(planned(expectation=expected(is_placed=False)), None)
    assert result.is_good
    assert "the car should stand 0.4" in result.lines[0] and "ahead of its start" in result.lines[0]


@pytest.mark.parametrize(
    ("before", "since", "fault"),
    [
        (Report(BEGIN - 10 * MS, PLAN.start), None, False),
        (Report(BEGIN - 10 * MS, AWAY), None, True),
        # No report at the start: the next one is compared with the prediction.
        (None, Report(BEGIN + 1000 * MS, STATES[100].pose), False),
        (None, Report(BEGIN + 1000 * MS, AWAY), True),
        # The clock of the node is late, so a report before the first command has a later stamp.
        (Report(BEGIN + 300 * MS, PLAN.start), None, False),
        (Report(BEGIN - 900 * MS, AWAY), Report(BEGIN + 1000 * MS, STATES[100].pose), False),
        # The tutorial's listing: the start pose comes between two reports, with the first command.
        (Report(BEGIN - 10 * MS, AWAY), Report(BEGIN + 10 * MS, STATES[1].pose), False),
        (Report(BEGIN - 10 * MS, AWAY), Report(BEGIN + 10 * MS, AWAY), True),
        (None, None, False),
    ],
)
def test_where_the_car_was_at_the_start(before, since, fault):
    drive = planned()
    drive.drive.before, drive.drive.since = [*filter(None, [before])], since
    text = start_fault(drive)
    assert bool(text) is fault
    assert not fault or f"the car was not at the start pose {PLAN.start}" in text


def test_a_first_command_without_a_stamp_that_arrives_late():
    drive = planned()
    drive.drive.before = [Report(BEGIN - 400 * MS, PLAN.start), Report(BEGIN, AWAY)]
    assert not start_fault(drive)
    drive.drive.before[0] = Report(BEGIN - 400 * MS, Pose(9.0, 9.0, 0.0))
    assert f"it was at {AWAY}" in start_fault(drive)


def test_a_start_pose_that_comes_late():
    drive = planned(before=AWAY)
    drive.drive.placed = Report(BEGIN + 240 * MS, PLAN.start)
    text = judged(drive, AWAY).lines[0]
    assert f"it was at {AWAY}, and was placed at the start pose 0.24 s later" in text


def test_a_start_pose_just_after_the_first_command():
    """ROS does not order topics. The final pose shows what it changes."""
    drive = planned(before=AWAY)
    drive.drive.since = Report(BEGIN + 10 * MS, AWAY)
    drive.drive.placed = Report(BEGIN + 120 * MS, PLAN.start)
    assert judged(drive, END).is_good
    assert judged(drive, AWAY).lines[0].endswith("The start pose came after the first command")
    drive.drive.runs[-1] = drive.drive.runs[-1]._replace(begin=BEGIN + 2100 * MS)
    assert "of line 3 lasted 1.10 s" in judged(drive, AWAY).lines[0]


@pytest.mark.parametrize("is_exact", [True, False])
def test_a_car_that_was_not_at_the_start_pose(is_exact):
    """An exact final pose proves that it was there."""
    drive = planned(before=AWAY, expectation=expected(is_exact=is_exact))
    assert judged(drive, END).is_good
    near = END._replace(x=END.x + 0.09)  # as if a slow car is placed one second late
    text = judged(drive, near).lines[0]
    assert f"not at the start pose {PLAN.start} when the first command came: it was at" in text
    drive.drive.wall = Report(BEGIN + 1200 * MS, AWAY)
    text = judged(drive, AWAY).lines[0]
    wall = f"the car stopped at a wall in line 3 of 3 at {AWAY}"
    assert text.startswith(f"{wall}; the car was not at the start pose {PLAN.start}")


@pytest.mark.parametrize(
    ("reports", "found"),
    [
        ([(2100, END)], None),
        ([(2200, END)], 2200),
        ([(2200, AWAY), (3100, AWAY)], None),
        ([(2200, AWAY), (3200, AWAY)], 3200),
        ([(2200, AWAY), (2500, END), (3200, AWAY)], 2500),
    ],
)
def test_when_the_car_has_come_to_rest(reports, found):
    """At the predicted pose 0.2 s after the end; elsewhere, late commands may come for 1 s."""
    drive = planned()
    for stamp, pose in reports:
        drive.drive.report(Report(BEGIN + stamp * MS, pose))
    report = settled(drive)
    assert (report and (report.stamp - BEGIN) // MS) == found


@pytest.mark.parametrize("factor", [1.0, 0.1])
def test_a_slow_clock_changes_no_verdict(monkeypatch, factor):
    """The car reports a wrong pose all the time."""
    now = BEGIN
    monkeypatch.setattr(watched_drive.ros_time, "now", lambda: now)
    monkeypatch.setattr(watched_drive.time, "monotonic", lambda: now / 1e9 / factor)
    commands = [
        Command(BEGIN + i * 100 * MS, row.speed, row.steering_angle)
        for i, row in enumerate(row for row in PLAN.rows for _ in range(10))
    ]
    start = Report(BEGIN - 10 * MS, PLAN.start)
    car = SimpleNamespace(before=lambda _: [start], last=start, lost_since=None)
    watched = watched_drive.WatchedDrive(commands[0], car)
    watched.identified(expected())
    for command in [*commands[1:], Command(BEGIN + 2000 * MS, 0.0, 0.0)]:
        now = command.stamp
        watched.add(command)
    result = None
    while not result:
        now += 20 * MS
        watched.begins_again(Report(now, AWAY))
        result = watched.ended()
    assert f"after the plan, the car was at {AWAY}" in result.lines[0]
