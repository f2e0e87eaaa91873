"""Clicked points: the arc that ends there, the command that drives it, and what is refused."""

import math
import random

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mushr_ros_intro.authoring.clicks import (
    MAX_DISTANCE,
    ClickError,
    arc_to,
    path,
    pose_after,
    row_to,
)
from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.model import Row, as_float32
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.prediction import final_pose
from support.helpers import closed_form

CAR = Car(steering_limit_left=0.34, steering_limit_right=0.25)

ARC_TOLERANCE = 1e-9
"""[m] Between the click and the end of the arc in doubles."""

CLICK_TOLERANCE = 1e-3
"""[m] Between the click and where the car stops; float32 commands miss by 1e-7 of the way."""

SECOND = 1_000_000_000

coordinates = st.floats(-100.0, 100.0)
poses = st.builds(Pose, coordinates, coordinates, st.floats(-10.0, 10.0))
points = st.tuples(coordinates, coordinates)


def off(pose, point):
    return math.hypot(pose[0] - point[0], pose[1] - point[1])


@given(poses, points)
def test_the_arc_ends_at_the_click(pose, point):
    arc = arc_to(pose, point)
    assert off(drive_arc(pose, *arc), point) < ARC_TOLERANCE
    # No more than half a circle, and forward unless the point is behind.
    assert abs(arc.distance * arc.curvature) <= math.pi + 1e-6
    ahead = math.cos(pose.theta) * (point[0] - pose.x) + math.sin(pose.theta) * (point[1] - pose.y)
    assume(abs(ahead) > 1e-8)
    assert math.copysign(1.0, arc.distance) == math.copysign(1.0, ahead)


@pytest.mark.parametrize(
    "point, distance, curvature",
    [
        ((3.0, 0.0), 3.0, 0.0),
        ((-3.0, 0.0), -3.0, 0.0),
        ((0.0, 2.0), math.pi, 1.0),  # half a circle, forward
        ((0.0, -2.0), math.pi, -1.0),
        ((1.0, 1.0), math.pi / 2, 1.0),  # a quarter
        ((1.0, -1.0), math.pi / 2, -1.0),
        ((-1.0, 1.0), -math.pi / 2, 1.0),  # a quarter in reverse
        ((-1.0, -1.0), -math.pi / 2, -1.0),
        ((0.0, 0.0), 0.0, 0.0),
    ],
)
def test_arcs_by_hand(point, distance, curvature):
    assert arc_to(Pose(0.0, 0.0, 0.0), point) == pytest.approx((distance, curvature), abs=1e-12)
    turned = arc_to(Pose(5.0, 6.0, math.pi / 2), (5.0 - point[1], 6.0 + point[0]))
    assert turned == pytest.approx((distance, curvature), abs=1e-12)


def test_the_command_by_hand():
    # A quarter circle of radius 2 m at 0.5 m/s.
    row = row_to(Pose(0.0, 0.0, 0.0), (2.0, 2.0), 0.5, CAR)
    assert row.speed == 0.5
    assert row.steering_angle == as_float32(math.atan(0.33 / 2.0))
    assert row.duration == pytest.approx(2.0 * math.pi * SECOND, abs=1)
    row = row_to(Pose(0.0, 0.0, 0.0), (-2.0, 2.0), 0.5, CAR)
    assert (row.speed, row.steering_angle) == (-0.5, as_float32(math.atan(0.33 / 2.0)))


def test_speeds_are_rounded_as_they_travel():
    start = Pose(0.0, 0.0, 0.0)
    assert row_to(start, (5.0, 0.0), 0.7, CAR).speed == as_float32(0.7)
    driven = pose_after(start, Row(0.1, 0.0, 1000 * SECOND, 0), CAR)
    assert driven.x == as_float32(0.1) * 1000


@given(poses, st.floats(0.1, 6.6), st.integers(0, 2**32))
def test_fifty_clicks(start, speed, seed):
    """The car ends at each click, driven from the file, by arithmetic of the tests' own."""
    numbers = random.Random(seed)
    pose, rows, clicks = start, [], []
    while len(rows) < 50:
        way, bearing = numbers.uniform(0.1, 30.0), numbers.uniform(-math.pi, math.pi)
        point = (pose.x + way * math.cos(bearing), pose.y + way * math.sin(bearing))
        try:
            row = row_to(pose, point, speed, CAR)
        except ClickError:
            continue
        pose = pose_after(pose, row, CAR)
        rows.append(row)
        clicks.append(point)
        assert off(pose, point) < CLICK_TOLERANCE
    plan = parse_plan(plan_text(start, rows).encode(), "clicked.txt")
    assert off(final_pose(plan, CAR), clicks[-1]) < CLICK_TOLERANCE
    read = [(row.speed, row.steering_angle, row.duration / SECOND) for row in plan.rows]
    for count in (1, 10, 50):
        assert off(closed_form(start, read[:count]), clicks[count - 1]) < CLICK_TOLERANCE


def test_the_furthest_click():
    start = Pose(1e6, -1e6, 1.0)
    for bearing in (-1.5, -0.3, 0.0, 1e-7, 1.57):
        point = (
            start.x + 0.999 * MAX_DISTANCE * math.cos(1.0 + bearing),
            start.y + 0.999 * MAX_DISTANCE * math.sin(1.0 + bearing),
        )
        row = row_to(start, point, 0.7, CAR)
        assert off(pose_after(start, row, CAR), point) < CLICK_TOLERANCE


@pytest.mark.parametrize(
    "point, expected",
    [
        (
            (0.0, 1.0),
            "the point (0.000, 1.000) needs a steering angle of 0.5834 rad (a circle of radius "
            "0.500 m); the nearest that the car has is 0.3400 rad to the left (a radius of "
            "0.933 m)",
        ),
        ((0.0, -2.0), "needs a steering angle of -0.3187 rad (a circle of radius 1.000 m); the n"),
        ((0.0, -2.0), "the nearest that the car has is -0.2500 rad to the right (a radius of 1.2"),
        ((-0.1, 0.1), "to the left"),
        ((0.0, 0.0), "the point (0.000, 0.000) is where the car will be already"),
        ((1e-10, 0.0), "is where the car will be already"),
        ((800.0, 800.0), "is 1131 m away from where the car will be; expected 1000 m at most"),
    ],
)
def test_refused(point, expected):
    with pytest.raises(ClickError) as caught:
        row_to(Pose(0.0, 0.0, 0.0), point, 1.0, CAR)
    assert expected in str(caught.value)


def test_the_limit_itself_is_driven():
    radius = 0.33 / math.tan(0.34)
    row_to(Pose(0.0, 0.0, 0.0), (0.0, 2.0 * radius * (1.0 + 1e-9)), 1.0, CAR)
    straight = Car(steering_limit_left=0.0, steering_limit_right=0.0)
    assert row_to(Pose(0.0, 0.0, 0.0), (1.0, 0.0), 1.0, straight).duration == SECOND
    with pytest.raises(ClickError, match="a radius of infinite m"):
        row_to(Pose(0.0, 0.0, 0.0), (1.0, 0.1), 1.0, straight)


def test_path():
    start = Pose(1.0, 2.0, 0.5)
    rows = [Row(1.0, 0.2, 250_000_000, 0), Row(-2.0, 0.0, SECOND, 0)]
    states = list(path(start, rows, CAR, 100_000_000))
    assert [state.stamp for state in states] == [
        *(0, 83_333_333, 166_666_666, 250_000_000),
        *(250_000_000 + number * SECOND // 10 for number in range(1, 11)),
    ]
    for state in states:
        seconds = [min(0.25, state.stamp / SECOND), max(0.0, state.stamp / SECOND - 0.25)]
        driven = [(row.speed, row.steering_angle, part) for row, part in zip(rows, seconds)]
        assert state.pose == pytest.approx(closed_form(start, driven), abs=ARC_TOLERANCE)
    assert [state.pose for state in path(start, [], CAR, SECOND)] == [start]
