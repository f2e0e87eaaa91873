"""The comparison of a drive with its prediction, against values computed by hand."""

import math
import random

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.drive_log import compare
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import plan_of
from support.geometry import closed_form
from support.recorded_drive import driven

NEAR = 1e-6
"""[m, rad] Poses without noise; float32 speeds and angles."""

EXACT = {"position": 0.0, "heading": 0.0, "delay": 0.0}


def compared(text, car):
    """Return the log of a drive, and its comparison with the ideal car."""
    log = driven(plan_of(text), car, random.Random(1), **EXACT)
    return log, compare(log, Car(), 0.0)


def test_a_slow_car_on_a_straight_line_falls_short():
    log, found = compared("1, 2, 0\n0.5, 0, 4\n-0.5, 0, 2", Car(speed_gain=0.9))
    assert found.predicted[-1] == pytest.approx((2.0, 2.0, 0.0), abs=NEAR)
    assert found.driven[-1] == pytest.approx((1.9, 2.0, 0.0), abs=NEAR)
    assert found.distances.max() == pytest.approx(0.2, abs=NEAR)
    text = "\n".join(diagnosis.comparison_text(log, found, "ideal"))
    assert "final error     0.100 m" in text
    assert "largest error   0.200 m, 4.00 s after" in text


def test_the_last_pose_is_measured_when_the_car_has_come_to_rest():
    """Not before: the localisation may lag behind the car."""
    log, _ = compared("0, 0, 0\n0.5, 0, 4", Car())
    lag = (log.stamps > 4.0 * NANOSECONDS) & (log.stamps < 4.25 * NANOSECONDS)
    poses = log.poses - np.outer(lag, (0.1, 0.0, 0.0))
    found = compare(log._replace(poses=poses), Car(), 0.0)
    assert found.driven[-1] == pytest.approx((2.0, 0.0, 0.0), abs=NEAR)


def test_a_car_that_steers_to_the_left():
    _, found = compared("0, 0, 0.7\n1, 0.1, 1", Car(steering_offset=0.02))
    expected = closed_form((0.0, 0.0, 0.7), [(1.0, 0.1, 1.0)])
    true = closed_form((0.0, 0.0, 0.7), [(1.0, 0.12, 1.0)])
    assert found.predicted[-1] == pytest.approx(expected, abs=NEAR)
    assert found.driven[-1] == pytest.approx(true, abs=NEAR)
    assert found.distances[-1] == pytest.approx(math.dist(true[:2], expected[:2]), abs=NEAR)


def test_the_heading_may_pass_pi():
    _, found = compared("0, 0, 3\n1, 0.3, 6", Car())
    assert found.distances.max() < NEAR
    turn = found.driven[-1, 2] - found.driven[0, 2]
    assert turn == pytest.approx(6.0 * math.tan(0.3) / 0.33, abs=1e-5)


def test_headings_may_differ_by_whole_turns():
    """A car that stands with the heading pi may report pi first, and then -pi."""
    log, _ = compared("0, 0, 3.1\n1, 0.3, 1", Car())
    log.poses[0, 2] -= math.tau
    found = compare(log, Car(), 0.0)
    assert abs(found.driven - found.predicted).max() < NEAR


def test_a_recording_that_ends_before_the_plan():
    log, _ = compared("0, 0, 0\n0.5, 0, 3\n0.5, 0.1, 3", Car())
    count = sum(log.stamps < 4_000_000_000)
    found = compare(log._replace(stamps=log.stamps[:count], poses=log.poses[:count]), Car(), 0.0)
    assert found.times[-1] < 4.0
    assert found.distances.max() < NEAR
