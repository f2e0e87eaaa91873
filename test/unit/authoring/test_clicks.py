"""Clicks: the arc to a point, the row that drives it, and the points that are refused."""

import math
import random

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mushr_ros_intro.authoring.clicks import arc_to, extend
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import ORIGIN, Pose, drive_arc
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.plan import Plan, as_float32
from mushr_ros_intro.plan.write import plan_text
from support.geometry import closed_form

CAR = Car(steering_limit_left=0.34, steering_limit_right=0.25)

ARC_TOLERANCE = 1e-9
"""[m] Between the click and the end of the arc, in double precision."""

CLICK_TOLERANCE = 1e-3
"""[m] Between the click and the car's final position; float32 commands miss by 1e-7 of the path."""

SECOND = 1_000_000_000

coordinates = st.floats(-100.0, 100.0)
poses = st.builds(Pose, coordinates, coordinates, st.floats(-10.0, 10.0))
points = st.tuples(coordinates, coordinates)


def end_of(start, rows):
    """Return the position [m, m] at the end of rows, by the closed form of the tests."""
    return closed_form(start, [(each[0], each[1], each[2] / SECOND) for each in rows])[:2]


@given(poses, points)
def test_the_arc_ends_at_the_click(pose, point):
    distance, curvature = arc_to(pose, point)
    assert math.dist(drive_arc(pose, distance, curvature)[:2], point) < ARC_TOLERANCE
    # At most half a circle, and forward unless the point is behind.
    assert abs(distance * curvature) <= math.pi + 1e-6
    ahead = math.cos(pose.theta) * (point[0] - pose.x) + math.sin(pose.theta) * (point[1] - pose.y)
    assume(abs(ahead) > 1e-8)
    assert math.copysign(1.0, distance) == math.copysign(1.0, ahead)


@pytest.mark.parametrize(
    "point, distance, curvature",
    [
        ((3.0, 0.0), 3.0, 0.0),
        ((-3.0, 0.0), -3.0, 0.0),
        ((0.0, 2.0), math.pi, 1.0),  # half a circle, forward
        ((0.0, -2.0), math.pi, -1.0),
        ((1.0, 1.0), math.pi / 2, 1.0),  # a quarter of a circle
        ((1.0, -1.0), math.pi / 2, -1.0),
        ((-1.0, 1.0), -math.pi / 2, 1.0),  # in reverse
        ((-1.0, -1.0), -math.pi / 2, -1.0),
        ((0.0, 0.0), 0.0, 0.0),
    ],
)
def test_arcs_by_hand(point, distance, curvature):
    assert arc_to(ORIGIN, point) == pytest.approx((distance, curvature), abs=1e-12)
    turned = arc_to(Pose(5.0, 6.0, math.pi / 2), (5.0 - point[1], 6.0 + point[0]))
    assert turned == pytest.approx((distance, curvature), abs=1e-12)


def row_to(point, speed, car):
    """Return the row from the origin to a point."""
    return extend(Plan("", ORIGIN, ()), point, speed, car).rows[0]


@pytest.mark.parametrize("x, speed", [(2.0, 0.7), (-2.0, -0.7)])
def test_rows_by_hand(x, speed):
    """A quarter of a circle of radius 2 m; numbers are rounded to float32, as messages are."""
    row = row_to((x, 2.0), 0.7, CAR)
    assert row.speed == as_float32(speed)
    assert row.steering_angle == as_float32(math.atan(0.33 / 2.0))
    assert row.duration == pytest.approx(math.pi / as_float32(0.7) * SECOND, abs=1)


@pytest.mark.parametrize("point", [(3.0, 1.0), (-2.0, -0.5), (4.0, 0.0)])
def test_the_gains_of_the_car(point):
    """The car multiplies the commands by its gains, and adds its offset."""
    car = CAR._replace(speed_gain=0.8, steering_gain=1.2, steering_offset=-0.03)
    row = row_to(point, 0.7, car)
    assert abs(row.speed) == as_float32(0.7)
    driven = (row.speed * 0.8, row.steering_angle * 1.2 - 0.03, row.duration)
    assert math.dist(end_of(ORIGIN, [driven]), point) < CLICK_TOLERANCE


@settings(max_examples=8)
@given(poses, st.floats(0.1, 6.6), st.integers(0, 2**32))
def test_fifty_clicks(start, speed, seed):
    """The car passes every click when it drives the saved file."""
    numbers = random.Random(seed)
    plan, clicks = Plan("", start, ()), []
    while len(clicks) < 50:
        x, y = clicks[-1] if clicks else start[:2]
        distance, bearing = numbers.uniform(0.1, 30.0), numbers.uniform(-math.pi, math.pi)
        point = (x + distance * math.cos(bearing), y + distance * math.sin(bearing))
        try:
            plan = extend(plan, point, speed, CAR)
        except UserError:
            continue
        clicks.append(point)
    rows = parse_plan(plan_text(start, plan.rows).encode(), "clicked.txt").rows
    for count in (1, 2, 10, 50):
        assert math.dist(end_of(start, rows[:count]), clicks[count - 1]) < CLICK_TOLERANCE


@pytest.mark.parametrize(
    "point, expected",
    [
        ((0.0, 1.0), "the point (0.000, 1.000) needs a steering angle of 0.5834 rad; click"),
        ((0.0, 1.0), "uses at most 0.3400 rad to the left"),
        ((0.0, -2.0), "of -0.3187 rad; click_planner uses at most 0.2500 rad to the right"),
        ((-0.1, 0.1), "rad to the left"),
        ((0.0, 0.0), "the plan already ends at the point (0.000, 0.000)"),
        ((1e-10, 0.0), "the plan already ends at the point"),
    ],
)
def test_refused(point, expected):
    with pytest.raises(UserError) as caught:
        row_to(point, 1.0, CAR)
    assert expected in str(caught.value)


def test_a_double_click():
    """The plan ends near the point, but not exactly there."""
    for point in ((2.37, -0.61), (4.0, 0.2)):
        plan = extend(Plan("", ORIGIN, ()), point, 1.0, CAR)
        with pytest.raises(UserError, match="the plan already ends at the point"):
            extend(plan, point, 1.0, CAR)


def test_the_limit_itself_is_driven():
    radius = 0.33 / math.tan(0.34)
    row_to((0.0, 2.0 * radius * (1.0 + 1e-9)), 1.0, CAR)
    straight = Car(steering_limit_left=0.0, steering_limit_right=0.0)
    assert row_to((1.0, 0.0), 1.0, straight).duration == SECOND
    with pytest.raises(UserError, match="at most 0.0000 rad"):
        row_to((1.0, 0.1), 1.0, straight)
