"""Check the paths that controllers follow, and the messages about bad files."""

import math

import numpy as np
import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.reference import read_references, refuse_walls, resampled
from mushr_ros_intro.world.grid import Grid
from support.paths import CHECKOUT

PLANS = f"{CHECKOUT}/plans"
CSV = "\ufeffx,y,heading,speed\n# a comment\n0,0,0,1\n3,0,0,2\n\n3,0,0,2\n3,-4,-1.5,0.01\n"


def read(folder, text):
    path = folder / "path.csv"
    path.write_text(text)
    (reference,) = read_references([str(path)], PLANS).values()
    return reference


def test_a_file(tmp_path):
    """The second of two equal lines is left out; the lowest speed is 0.1 m/s."""
    reference = read(tmp_path, CSV)
    assert reference.poses == (Pose(0, 0, 0), Pose(3, 0, 0), Pose(3, -4, -1.5))
    assert reference.stamps == (0, 1_500_000_000, 41_500_000_000)
    assert (reference.name, reference.start) == ("path", Pose(0, 0, 0))
    assert reference.speed == 2.0


def test_a_turn_on_the_spot(tmp_path):
    """No car can drive it: the second pose is left out."""
    reference = read(tmp_path, "0,0,0,1\n0,0,1,1\n3,0,0,1\n")
    assert reference.poses == (Pose(0, 0, 0), Pose(3, 0, 0))


def test_a_path_in_reverse(tmp_path):
    assert read(tmp_path, "0,0,0,-1\n-2,0,0,-1\n").stamps == (0, 2_000_000_000)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0,0,1\n1,0,0\n", r"path.csv:2: found '1,0,0'; expected four numbers: x \[m\], y"),
        ("0,0,0,1\nx,y,heading,speed\n", "path.csv:2: found"),
        ("0,0,0,1\n1,nan,0,1\n", "path.csv:2: found"),
        ("0,0,0,1\n2e6,0,0,1\n", "path.csv:2: found"),
        ("0,0,0,1\n", "path.csv: expected a path of at least two different poses"),
        ("", "path.csv: expected a path"),
    ],
)
def test_a_bad_file(tmp_path, text, message):
    with pytest.raises(UserError, match=message):
        read(tmp_path, text)


HEADINGS = "expected the columns x"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "# x_m, y_m, w_tr_right_m, w_tr_left_m\n0,0,1,1\n1,0,1,1\n",
            "expected one column heading",
        ),
        ("0,0,1.1,1.2\n1,0,1.1,1.2\n2,0,1.1,1.2\n", f"differ by 1.1 rad .*{HEADINGS}"),
        ("0,0,90,1\n0,1,90,1\n", "expected radians, not degrees"),
        ("x,y,theta,yaw,v\n0,0,0,0,1\n1,0,0,0,1\n", "expected one column heading"),
        ("0,0,0,1\n-2,0,0,1\n", "differ by 3.1 rad"),
    ],
)
def test_a_file_with_other_columns(tmp_path, text, message):
    with pytest.raises(UserError, match=message):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        "# s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps\n0;1;2;1.5;9;3\n1;1;4;1.6;9;3\n",
        "# The track of x and y.\nspeed,heading,y,x\n3,1.5,2,1\n3,1.6,4,1\n",
    ],
)
def test_a_header(tmp_path, text):
    """Also behind #; the columns are found by their names."""
    reference = read(tmp_path, text)
    assert reference.poses == (Pose(1, 2, 1.5), Pose(1, 4, 1.6))
    assert reference.speed == pytest.approx(3.0)


def test_a_long_line(tmp_path):
    with pytest.raises(UserError, match="path.csv:2: found '1{80}'; expected four numbers"):
        read(tmp_path, "0,0,0,1\n" + 200_000 * "1")


def test_the_paths_of_the_courses():
    """Each begins at the origin, and is smooth except for saw."""
    names = ["line", "circle", "left_turn", "right_turn", "wave", "saw"]
    references = read_references(names, PLANS)
    assert [*references] == names
    for name, reference in references.items():
        poses = np.array(reference.poses)
        headings = np.arctan2(*np.diff(poses[:, :2], axis=0).T[::-1])
        middle = (poses[1:, 2] + poses[:-1, 2]) / 2.0
        off = np.abs(np.remainder(headings - middle + math.pi, math.tau) - math.pi)
        assert poses[0, :2].tolist() == [0, 0]
        assert off.max() < (2.0 if name == "saw" else 0.04), name
        assert reference.speed == pytest.approx(2.0, rel=1e-3)


def test_a_plan_is_its_predicted_path():
    (reference,) = read_references(["figure_8"], PLANS).values()
    assert reference.start == Pose(0, 0, 0.785)
    assert reference.poses[-1].is_close_to(Pose(-1.547709, -1.180325, 0.785), 1e-5)
    assert reference.duration == pytest.approx(22e9, rel=1e-3)


def test_a_plan_that_stops(tmp_path):
    """The car stands at the end, and this is no part of the path."""
    path = tmp_path / "plan.txt"
    path.write_text("0,0,0\n1,0\n0,0\n0,0\n")
    (reference,) = read_references([str(path)], PLANS).values()
    assert reference.poses[-1].is_close_to(Pose(1, 0, 0), 1e-9)
    assert len(set(reference.poses)) == len(reference.poses)
    assert reference.duration == pytest.approx(1e9, abs=1e8)


def test_unknown_and_equal_names(tmp_path):
    with pytest.raises(UserError, match=r"waves: no such file; did you mean wave\?"):
        read_references(["waves"], PLANS)
    (tmp_path / "wave.csv").write_text(CSV)
    with pytest.raises(UserError, match="two paths with the name 'wave'"):
        read_references(["wave", str(tmp_path / "wave.csv")], PLANS)


def test_resampling_keeps_the_ends_and_the_turns():
    path = resampled(np.array([[0, 0, 3.1], [1, 0, -3.1]]), 0.25)
    assert path[:, 0].tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert path[:, 2] == pytest.approx(np.linspace(3.1, math.tau - 3.1, 5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # The wall begins at x = 2 m, and the front end of the car is 0.38 m before the rear axle.
        ("0,0,0,1\n3,0,0,1\n", r"path.csv: a car on the path hits a wall after 1.62 m, at \(1.62"),
        ("0,0,0,1\n-3,0,0,-1\n", r"path.csv: a car on the path leaves the map after 1.94 m, at "),
        ("2,0,0,1\n3,0,0,1\n", "path.csv: the start pose is in a wall, at least in part, at "),
        ("-2,0,0,1\n0,0,0,1\n", "path.csv: the start pose is off the map, at least in part, at "),
        ("1.5,0,1.57,1\n1.5,1,1.57,1\n", ""),
        ("1.4,0,3.1,-1\n1.9,0,-3.1,-1\n", ""),  # turns by 0.08 rad; the heading is never 0
    ],
)
def test_a_path_that_hits_a_wall(tmp_path, text, message):
    cells = np.zeros((40, 50), np.int8)
    cells[:, 40:] = 100
    grid = Grid(cells, 0.1, Pose(-2.0, -2.0, 0.0))
    reference = read(tmp_path, text)
    refuse_walls([reference], {}, None)
    if message:
        with pytest.raises(UserError, match=f"{message}.*; expected another path, or another map$"):
            refuse_walls([reference], {}, grid)
    else:
        refuse_walls([reference], {}, grid)
