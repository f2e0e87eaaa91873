"""Test how a drive is followed beside its plan, by its commands and reports alone."""

import pytest
import rospy
from geometry_msgs.msg import PoseStamped

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.monitor.car_watch import CarWatch
from mushr_ros_intro.monitor.drive import Drive, Expectation, PlannedDrive, Report
from mushr_ros_intro.monitor.watched_drive import WatchedDrive
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.plan import as_float32

MS = 10**6
BEGIN = 5000 * MS
PLAN = parse_plan(b"0,0,0\n1,0.1\n1,0.1\n0,0,0.5\n-1,0.2\n", "plan.txt")
"""The rows end after 1, 2, 2.5 and 3.5 s."""


def sent(*rows, begin=BEGIN):
    """Return commands at 10 Hz: of each row, its speed, steering angle and duration [ms]."""
    commands = []
    for speed, angle, duration in rows:
        end = begin + duration * MS
        stamps = range(begin, end, 100 * MS)
        commands += [Command(s, as_float32(speed), as_float32(angle)) for s in stamps]
        begin = end
    return [*commands, Command(begin, 0.0, 0.0)]


def driven(commands, plan=PLAN):
    drive = Drive(commands[0], [])
    for command in commands[1:]:
        drive.add(command)
    return PlannedDrive(Expectation(plan, (), None, True, True), drive)


EXACT = sent((1, 0.1, 2000), (0, 0, 500), (-1, 0.2, 1000))


def test_commands_that_come_late():
    """The car was where it was when the first one was due, not where it waits for the second."""
    car = CarWatch("/car/car_pose")
    for milliseconds, x in ((-1700, 0.8), (-1300, 0.9), (-10, 1.0), (300, 1.2)):
        stamp = BEGIN + milliseconds * MS
        msg = PoseStamped()
        msg.header.stamp = rospy.Time(0, stamp)
        msg.pose.position.x, msg.pose.orientation.w = x, 1.0
        car.report(msg, stamp)
    assert [each.pose.x for each in WatchedDrive(EXACT[0], car).drive.before] == [1.0]
    assert [each.pose.x for each in car.before(BEGIN - 500 * MS)] == [0.9]
    assert [each.pose.x for each in car.before(BEGIN - 50 * MS)] == [0.9]
    assert [each.pose.x for each in car.before(BEGIN - 900 * MS)] == [0.8, 0.9]
    assert not CarWatch("/car/car_pose").before(BEGIN)


def test_an_exact_drive():
    planned = driven(EXACT)
    assert planned.is_complete and not planned.difference()
    assert planned.end == BEGIN + PLAN.duration


@pytest.mark.parametrize(
    ("elapsed", "line"), [(0, 2), (999, 2), (1000, 3), (2000, 4), (2499, 4), (2500, 5), (9000, 5)]
)
def test_the_position_names_the_line_of_the_file(elapsed, line):
    count = max(1, sum(command.stamp <= BEGIN + elapsed * MS for command in EXACT))
    assert driven(EXACT[:count]).position(BEGIN + elapsed * MS) == f"line {line} of 5"


def test_the_position_of_an_earlier_instant():
    """A wall can be reported when all commands have arrived already."""
    found = [driven(EXACT).position(BEGIN + elapsed * MS) for elapsed in (500, 2200, 3000)]
    assert found == ["line 2 of 5", "line 4 of 5", "line 5 of 5"]


def test_the_position_follows_rows_that_last_longer():
    """The tutorial's listing sends eleven commands instead of ten in some rows."""
    commands = sent((1, 0.1, 2300), (0, 0, 500), (-1, 0.2, 100))
    assert driven(commands[:-1]).position(BEGIN + 2850 * MS) == "line 5 of 5"
    assert driven(commands[:23]).position(BEGIN + 2200 * MS) == "line 3 of 5"


def test_a_plan_that_begins_with_a_stop():
    plan = parse_plan(b"0,0,0\n0,0,2\n1,0\n", "plan.txt")
    planned = driven(sent((1, 0, 1000)), plan)
    assert planned.begin == BEGIN - 2000 * MS
    assert planned.is_complete and not planned.difference()


@pytest.mark.parametrize(
    "rows",
    [
        [(1, 0.1, 700)],
        [(1, 0.1, 2000)],
        [(1, 0.1, 2000), (0, 0, 500), (-1, 0.2, 700)],
    ],
)
def test_a_drive_that_ends_early_is_not_complete(rows):
    assert not driven(sent(*rows)).is_complete


def test_a_drive_is_not_complete_before_the_stop():
    assert not driven(EXACT[:-1]).is_complete


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([(1, -0.1, 2000), (0, 0, 500), (-1, 0.2, 1000)], ["lines 2 to 3", "1 m/s, -0.1 rad came"]),
        ([(1, 0.1, 2300), (0, 0, 500), (-1, 0.2, 1000)], ["lines 2 to 3", "2.30 s", "for 2 s"]),
        # The mux stops the car if the node is late.
        (
            [(1, 0.1, 700), (0, 0, 100), (1, 0.1, 1200), (0, 0, 500), (-1, 0.2, 1000)],
            ["lines 2 to 3", "0.70 s", "Then a stop came"],
        ),
        (
            [(1, 0.1, 2000), (0, 0, 500), (-1, 0.2, 1000), (2, 0, 100)],
            ["2 m/s, 0 rad", "after the end"],
        ),
    ],
)
def test_the_first_difference_is_named(rows, words):
    difference = driven(sent(*rows)).difference()
    for each in words:
        assert each in difference


def test_the_car_is_placed_during_the_drive():
    """The pose changes by more than the car can drive; a skipped report does not."""
    drive = driven(EXACT[:10]).drive
    drive.report(Report(BEGIN, Pose(0.0, 0.0, 0.0)))
    drive.report(Report(BEGIN + 20 * MS, Pose(0.02, 0.0, 0.0)))
    drive.report(Report(BEGIN + 2000 * MS, Pose(2.0, 0.0, 0.0)))
    assert not drive.placed
    drive.add(EXACT[10])
    drive.report(Report(BEGIN + 2020 * MS, Pose(0.02, 0.0, 0.0)))
    assert drive.placed.pose.x == 0.02


def test_a_plan_that_ends_with_a_stop():
    """The stop of the plan, and that at its end, are one command."""
    plan = parse_plan(b"0,0,0\n1,0.1\n1,0.1\n0,0,1\n", "plan.txt")
    assert not driven(sent((1, 0.1, 2000), (0, 0, 1000)), plan).difference()


def test_a_slow_drive_ends_with_its_last_row():
    """The stop of row 21 comes when the whole plan would have been driven."""
    rows = [(1, 0.1), (1, -0.1)] * 10 + [(0, 0), (-1, 0)]
    text = "0,0,0\n" + "\n".join(f"{speed},{angle}" for speed, angle in rows)
    plan = parse_plan(text.encode(), "plan.txt")
    slow = sent(*((speed, angle, 1100) for speed, angle in rows))
    is_complete = [driven(slow[:count], plan).is_complete for count in range(1, len(slow) + 1)]
    assert is_complete.index(True) == len(slow) - 1
    assert "line 2 lasted 1.10 s" in driven(slow, plan).difference()


@pytest.mark.parametrize(
    ("poses", "stands"),
    [([], False), ([1], False), ([1, 1.1], False), ([1.1, 1, 1], True), ([1, 1, 1.1], False)],
)
def test_when_the_car_stands(poses, stands):
    drive = driven(EXACT).drive
    for number, x in enumerate(poses):
        drive.report(Report(EXACT[-1].stamp + number * 20 * MS, Pose(x, 0.0, 0.0)))
    assert drive.stands is stands
