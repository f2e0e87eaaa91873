"""Poses, and the arc that a bicycle drives, against results by hand and general properties."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.geometry import ORIGIN, Pose, compose, curvature, drive_arc, inverse

WHEELBASE = 0.33
"""[m] MuSHR's."""

ROUNDING = 1e-12
"""[m, rad] For some operations on doubles of the size of 100, which are accurate to 1e-14."""

poses = st.builds(Pose, st.floats(-20, 20), st.floats(-20, 20), st.floats(-7, 7))
distances = st.floats(-20, 20)
curvatures = st.floats(-4, 4)


def close(one, other, tolerance=ROUNDING):
    """Return whether two poses are equal, also in the number of full turns."""
    return all(abs(a - b) <= tolerance for a, b in zip(one, other))


@pytest.mark.parametrize(
    "distance, bend, expected",
    [
        (math.pi, 0.5, (2.0, 2.0, math.pi / 2)),
        (math.pi, -0.5, (2.0, -2.0, -math.pi / 2)),
        (-math.pi, 0.5, (-2.0, 2.0, -math.pi / 2)),
        (-math.pi, -0.5, (-2.0, -2.0, math.pi / 2)),
        (4 * math.pi, 0.5, (0.0, 0.0, 2 * math.pi)),
        (7.0, 0.0, (7.0, 0.0, 0.0)),
        (0.0, 0.5, (0.0, 0.0, 0.0)),
    ],
)
def test_quarter_circles_of_2_m(distance, bend, expected):
    assert close(drive_arc(ORIGIN, distance, bend), expected)


def test_curvature_is_left_positive():
    assert curvature(math.atan(0.33), 0.33) == pytest.approx(1.0, abs=ROUNDING)
    assert curvature(-math.atan(0.33), 0.66) == pytest.approx(-0.5, abs=ROUNDING)


@given(poses, distances, curvatures, st.floats(0, 1))
def test_two_parts_of_an_arc_give_the_whole_arc(pose, distance, bend, share):
    once = drive_arc(pose, distance, bend)
    for part in (0.5, share):
        first = part * distance
        assert close(drive_arc(drive_arc(pose, first, bend), distance - first, bend), once)


@given(poses, distances, curvatures)
def test_reverse_undoes_forward(pose, distance, bend):
    assert close(drive_arc(drive_arc(pose, distance, bend), -distance, bend), pose)


@given(poses, distances, curvatures)
def test_the_arc_does_not_depend_on_the_frame(pose, distance, bend):
    assert close(drive_arc(pose, distance, bend), compose(pose, drive_arc(ORIGIN, distance, bend)))


@given(distances, curvatures)
def test_right_mirrors_left(distance, bend):
    x, y, theta = drive_arc(ORIGIN, distance, bend)
    assert drive_arc(ORIGIN, distance, -bend) == (x, -y, -theta)


@given(poses, poses, poses)
def test_poses_compose(one, two, three):
    assert close(compose(one, ORIGIN), one) and close(compose(ORIGIN, one), one)
    assert close(compose(one, inverse(one)), ORIGIN) and close(compose(inverse(one), one), ORIGIN)
    assert close(compose(compose(one, two), three), compose(one, compose(two, three)))


def test_a_pose_as_text():
    assert str(Pose(1.00004, -1e-9, math.tau + 0.5)) == "(1.0000 m, 0.0000 m, 0.5000 rad)"


def test_poses_by_hand():
    assert close(compose(Pose(1, 2, math.pi / 2), Pose(3, 4, 0.5)), (-3, 5, math.pi / 2 + 0.5))
    assert close(inverse(Pose(1, 2, math.pi / 2)), (-2, 1, -math.pi / 2))
    assert Pose(1, 2, 3).distance_to(Pose(4, -2, 0)) == 5.0
    assert str(Pose(1.0, -2.5, 3.0)) == "(1.0000 m, -2.5000 m, 3.0000 rad)"
    assert str(Pose(0.0, 0.0, 4.0)) == "(0.0000 m, 0.0000 m, -2.2832 rad)"


@pytest.mark.parametrize("angle", [5e-324, 1e-300, 1e-15, 1e-9, 0.0099, -0.0099, -1e-15])
def test_small_steering_angles_count(angle):
    """Drive 44 m, the length of figure_8. MuSHR's own car ignores 0.0099 rad."""
    pose = drive_arc(ORIGIN, 44.0, curvature(angle, WHEELBASE))
    radius = WHEELBASE / math.tan(angle) if abs(angle) >= 1e-300 else math.inf
    turn = 44.0 / radius
    assert pose.theta == pytest.approx(turn, rel=ROUNDING, abs=1e-300)
    aside = 2 * (radius * math.sin(turn / 2)) * math.sin(turn / 2) if turn else 0.0
    assert pose.y == pytest.approx(aside, rel=ROUNDING, abs=1e-300)
    ahead = radius * math.sin(turn) if turn else 44.0
    assert pose.x == pytest.approx(ahead, rel=ROUNDING)
