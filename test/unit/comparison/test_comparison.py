"""The comparison of a drive with its prediction, against values computed by hand."""

import math
import random

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.comparison import compare
from mushr_ros_intro.comparison.drive_log import with_rows_of
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import plan_of
from support.geometry import closed_form
from support.recorded_drive import driven

NEAR = 1e-6
"""[m, rad] Poses without noise; float32 speeds and angles."""

EXACT = {"position": 0.0, "heading": 0.0, "delay": 0.0}


def compared(text, car, **options):
    log = driven(plan_of(text), car, random.Random(1), **{**EXACT, **options})
    return compare(log, Car(), 0.0)


def test_a_slow_car_on_a_straight_line_falls_short():
    found = compared("1, 2, 0\n0.5, 0, 4\n-0.5, 0, 2", Car(speed_gain=0.9))
    there, back = found.rows
    assert there.distance == pytest.approx((2.0, 1.8), abs=NEAR)
    assert back.distance == pytest.approx((-1.0, -0.9), abs=NEAR)
    assert there.driven == pytest.approx((2.8, 2.0, 0.0), abs=NEAR)
    assert there.error == pytest.approx(0.2, abs=NEAR)
    assert back.error == pytest.approx(0.1, abs=NEAR)
    assert found.errors[-1] == pytest.approx([-0.1, 0.0], abs=NEAR)
    assert found.sizes.max() == pytest.approx(0.2, abs=NEAR)
    assert found.distances[-1] == pytest.approx(3.0, abs=NEAR)
    text = "\n".join(diagnosis.as_text(found, "ideal"))
    assert "final error     0.100 m: 0.100 m short" in text
    assert "largest error   0.200 m, 4.00 s after" in text


@pytest.mark.parametrize("delay", [-1e-6, 1e-6, 0.013])
def test_the_first_row_begins_at_the_start_pose(delay):
    """Also if the first pose of the drive comes some time after the first command."""
    log = driven(plan_of("1, 2, 3\n0.5, 0.1, 4"), Car(), random.Random(1), **EXACT)
    assert compare(log, Car(), delay).rows[0].distance == pytest.approx((2.0, 2.0), abs=1e-3)


def test_the_last_pose_is_measured_when_the_car_has_come_to_rest():
    """Not before: the localisation may lag behind the car."""
    log = driven(plan_of("0, 0, 0\n0.5, 0, 4"), Car(), random.Random(1), **EXACT)
    lag = (log.stamps > 4.0 * NANOSECONDS) & (log.stamps < 4.25 * NANOSECONDS)
    poses = log.poses - np.outer(lag, (0.1, 0.0, 0.0))
    found = compare(log._replace(poses=poses), Car(), 0.0)
    assert found.driven[-1] == pytest.approx((2.0, 0.0, 0.0), abs=NEAR)


def test_the_distance_in_a_curve_with_few_poses():
    """It is the sum of the chords, which are 1 percent shorter than the arc here."""
    (row,) = compared("0, 0, 0\n1, 0.3, 10", Car(), rate=2.0).rows
    assert row.distance == pytest.approx((9.9, 9.9), abs=0.1)


def compared_until(seconds):
    """Return a drive whose rows end after 4 and 5 s; its poses end after `seconds`."""
    log = driven(plan_of("0, 0, 0\n0.5, 0, 4\n0.25, 0, 1"), Car(), random.Random(1), **EXACT)
    count = int(np.searchsorted(log.stamps, seconds * NANOSECONDS, side="right"))
    return compare(log._replace(stamps=log.stamps[:count], poses=log.poses[:count]), Car(), 0.0)


@pytest.mark.parametrize("seconds", [6.0, 5.1, 5.0])
def test_the_last_row_is_shown_if_the_poses_end_just_after_it(seconds):
    found = compared_until(seconds)
    assert [row.end for row in found.rows] == [4.0, 5.0]
    assert found.rows[1].driven == pytest.approx((2.25, 0.0, 0.0), abs=NEAR)
    assert "note" not in "\n".join(diagnosis.as_text(found, "ideal"))


def test_a_note_says_which_rows_have_no_result():
    found = compared_until(4.5)
    assert [row.end for row in found.rows] == [4.0]
    text = "\n".join(diagnosis.as_text(found, "ideal"))
    assert "note: the poses end too early for the last 1 row\n" in text


def test_a_car_that_steers_to_the_left_is_left_of_the_path():
    car = Car(steering_offset=0.02)
    found = compared("0, 0, 0.7\n1, 0.1, 1", car)
    rows = [(1.0, 0.1, 1.0)]
    expected = closed_form((0.0, 0.0, 0.7), rows)
    true = closed_form((0.0, 0.0, 0.7), [(1.0, 0.12, 1.0)])
    assert found.rows[0].predicted == pytest.approx(expected, abs=NEAR)
    assert found.rows[0].driven == pytest.approx(true, abs=NEAR)
    assert found.rows[0].turn == pytest.approx((expected[2] - 0.7, true[2] - 0.7), abs=NEAR)
    x, y = true[0] - expected[0], true[1] - expected[1]
    across = y * math.cos(expected[2]) - x * math.sin(expected[2])
    assert across > 0.0
    assert found.errors[-1][1] == pytest.approx(across, abs=NEAR)
    assert found.final_turn == pytest.approx(true[2] - expected[2], abs=NEAR)


def test_the_heading_may_pass_pi():
    found = compared("0, 0, 3\n1, 0.3, 6", Car())
    assert found.rms < NEAR
    assert found.rows[0].turn[1] == pytest.approx(6.0 * math.tan(0.3) / 0.33, abs=1e-5)


def test_headings_may_differ_by_whole_turns():
    """A car that stands with the heading pi may report pi first, and then -pi."""
    log = driven(plan_of("0, 0, 3.1\n1, 0.3, 1"), Car(), random.Random(1), **EXACT)
    log.poses[0, 2] -= math.tau
    found = compare(log, Car(), 0.0)
    assert abs(found.driven - found.predicted).max() < NEAR


def test_rows_beyond_the_limits_are_noted():
    car = Car(speed_limit=0.8)
    plan = plan_of("0, 0, 0\n0.5, 0, 1\n1, 0, 1")
    log = driven(plan, car, random.Random(1), **EXACT)
    found = compare(log, car, 0.0)
    assert found.limited_rows == (1,)
    assert "1 row, the first is row 2, exceed" in "\n".join(diagnosis.as_text(found, "slow"))
    text = [*diagnosis.as_text(compare(with_rows_of(log, plan), car, 0.0), "slow")]
    assert "1 row, the first is line 3, exceed" in "\n".join(text)
    (title,) = (index for index, line in enumerate(text) if line.startswith(" line   speed"))
    assert [line.split()[0] for line in text[title + 2 : title + 4]] == ["2", "3"]


def test_a_recording_that_ends_before_the_plan():
    log = driven(plan_of("0, 0, 0\n0.5, 0, 3\n0.5, 0.1, 3"), Car(), random.Random(1), **EXACT)
    count = sum(log.stamps < 4_000_000_000)
    found = compare(log._replace(stamps=log.stamps[:count], poses=log.poses[:count]), Car(), 0.0)
    assert len(found.rows) == 1
    assert found.rms < NEAR
