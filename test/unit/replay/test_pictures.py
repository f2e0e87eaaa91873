"""Check the pictures of a drive."""

import io
import math

import numpy as np
import pytest

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.pictures import picture
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.world.grid import Grid

ARC = np.array([[math.cos(a), math.sin(a), a + math.pi / 2] for a in np.linspace(0.0, 1.5, 30)])
DRIVE = Drive(np.arange(30.0), ARC + (0.4, 0.3, 0.0), ARC, 0.5)  # 0.5 m away
STILL = np.zeros((1, 3))


def test_paths_and_distances():
    axes, key, away, apart = picture(DRIVE, "my.txt: $x^$", 0.3, 0.2).axes
    assert axes.get_title() == r"my.txt: \$x^\$"
    assert [text.get_text() for text in key.get_legend().get_texts()] == [
        *("driven path", "driven start", "driven end"),
        *("predicted path", "predicted start", "predicted end"),
        "tolerance of the final position: 0.3 m",
    ]
    (circle,) = axes.patches
    assert circle.get_radius() == 0.3
    assert circle.get_center() == pytest.approx(ARC[-1, :2])
    headings = [np.arctan2(each.V, each.U) for each in axes.collections]
    assert np.concatenate(headings) == pytest.approx(2 * [math.pi / 2, 1.5 + math.pi / 2])
    assert axes.get_aspect() in ("equal", 1.0)
    driven, predicted = (line.get_ydata() for line in away.lines)
    assert predicted == pytest.approx(2.0 * np.sin(np.linspace(0.0, 0.75, 30)))  # chords
    assert driven[0] == pytest.approx(0.5)
    distances, tolerance = (line.get_ydata() for line in apart.lines)
    assert distances == pytest.approx(np.full(30, 0.5)) and tolerance[0] == 0.2


@pytest.mark.parametrize(
    ("x", "value", "labels"), [(0.0, 100, ["wall"]), (0.0, 0, []), (100.0, 100, [])]
)
def test_a_wall_is_in_the_legend_if_it_is_seen(x, value, labels):
    cells = np.zeros((20, 20), np.int8)
    cells[3:5] = value
    _, key, *_ = picture(DRIVE, grid=Grid(cells, 0.1, Pose(x, 0.0, 0.5))).axes
    texts = [text.get_text() for text in key.get_legend().get_texts()]
    assert texts[6:] == labels


@pytest.mark.parametrize("poses", [STILL, 1e6 * ARC])
def test_unusual_drives(poses):
    drive = Drive(np.arange(float(len(poses))), poses, poses, 0.0)
    picture(drive).savefig(io.BytesIO(), format="svg")
