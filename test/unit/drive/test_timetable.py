"""Test when the commands of a plan are due, with a clock that the test sets."""

import pytest
import rospy
from rospy.rostime import switch_to_wallclock

from mushr_ros_intro.drive.timetable import LEAD, Timetable
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.stamps import COMMAND_PERIOD, MAX_LEAD, STAMP_TOLERANCE

SECOND = 1_000_000_000
MS = SECOND // 1000
BEGIN = 5 * SECOND
PLAN = parse_plan(b"# 3 rows\n0,0,0\n1,0,0.25\n2,0,0.1\n3,0,0.05\n", "plan.txt")


pytestmark = pytest.mark.usefixtures("set_clock")


def drive(timetable, set_clock):
    """Return the due times of each row, with a clock that follows them."""
    rows, begin = [], timetable.due
    for row in PLAN.rows:
        rows.append([])
        for due in timetable.instants(row):
            rows[-1].append((due - begin) // MS)
            set_clock(due)
    return rows


def test_the_stamp_of_an_initial_pose():
    """As far ahead of a simulated clock as is obeyed; in wall-clock time, the present."""
    assert Timetable(PLAN).begin() == BEGIN + MAX_LEAD
    switch_to_wallclock()
    before = rospy.get_rostime().to_nsec()
    assert before <= Timetable(PLAN).begin() <= rospy.get_rostime().to_nsec()


@pytest.mark.parametrize(
    "stamp, first",
    [
        (BEGIN, BEGIN + COMMAND_PERIOD),
        (BEGIN - COMMAND_PERIOD, BEGIN),
        (BEGIN - COMMAND_PERIOD // 2, BEGIN + COMMAND_PERIOD // 2),
        (BEGIN - SECOND // 2, BEGIN),
    ],
)
def test_the_first_command_is_due_one_period_after_the_report_or_now(stamp, first):
    timetable = Timetable(PLAN)
    timetable.start_after(stamp)
    assert timetable.due == first
    assert timetable.end == first + PLAN.duration


def test_every_row_and_every_drive_begins_when_the_last_one_ends(set_clock):
    timetable = Timetable(PLAN)
    timetable.start_after(BEGIN)
    assert drive(timetable, set_clock) == [[0, 100, 200], [250], [350]]
    assert timetable.due == timetable.end
    set_clock(timetable.end)
    assert timetable.begin() == timetable.end + MAX_LEAD
    timetable.start_after(timetable.end)
    assert drive(timetable, set_clock) == [[0, 100, 200], [250], [350]]


@pytest.mark.parametrize("offset", [0, 1, STAMP_TOLERANCE])
def test_a_command_is_sent_two_periods_early_and_up_to_a_second_late(offset, set_clock):
    timetable = Timetable(PLAN)
    timetable.start_after(BEGIN)
    set_clock(timetable.due - LEAD + offset)
    assert next(timetable.instants(PLAN.rows[0])) == BEGIN + COMMAND_PERIOD


@pytest.mark.parametrize(
    ("offset", "words"),
    [
        (STAMP_TOLERANCE + 1, "the next command was due 1.0 s ago; expected at most 1 s"),
        (-STAMP_TOLERANCE - 1, "the next command is due in 1.0 s; expected at most 1 s"),
    ],
)
def test_a_clock_that_jumps_ends_the_plan(offset, words, set_clock):
    timetable = Timetable(PLAN)
    timetable.start_after(BEGIN)
    set_clock(timetable.due - LEAD + offset)
    with pytest.raises(UserError, match=words):
        next(timetable.instants(PLAN.rows[0]))
