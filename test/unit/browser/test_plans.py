"""Check what the page gets: plans and the map."""

import io
import json
import math
import os

import numpy as np
import pytest
from PIL import Image

from mushr_ros_intro.browser import plans
from mushr_ros_intro.browser.map import png
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import read_profile
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.world.grid import Grid
from support.paths import PACKAGE


def test_plans_are_found_by_name(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
        (folder / "both.txt").write_text("0, 0, 0\n")
    (one / "a.txt").write_text("0, 0, 0\n")
    (one / "b.yaml").write_text("0, 0, 0\n")
    (one / "CMakeLists.txt").write_text("0, 0, 0\n")
    (two / "folder.txt").mkdir()
    (two / "huge.txt").write_text("#" * (plans.MAX_LISTED_SIZE + 1))
    expected = {"a": str(one / "a.txt"), "both": str(two / "both.txt")}
    assert plans.find_plans([str(one), str(two)]) == expected
    assert [*plans.find_plans([str(one), str(two)])] == ["a", "both"]
    assert plans.find_plans([str(tmp_path / "unreadable"), str(one), str(two)]) == expected


def test_versions_of_plans(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("0, 0, 0\n")
    os.utime(path, (0, 12.5))
    assert plans.versions([str(tmp_path)]) == {"a": 12.5}


@pytest.mark.parametrize(
    "path, name",
    [
        *(("a", "a"), ("a.txt", "a"), ("b", None), ("", None)),
        *(("{}/own/a.txt", "a"), ("./own/a.txt", "a"), ("~/link/a.txt", "a")),
        *(("{}/other/a.txt", None), ("other/a.txt", None), ("{}/own/b.txt", None)),
    ],
)
def test_the_name_of_a_plan(tmp_path, monkeypatch, path, name):
    """A file of the same name in another folder is another plan."""
    for folder in ("own", "other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.txt").write_text("0, 0, 0\n")
    (tmp_path / "link").symlink_to("own")
    monkeypatch.setenv("PWD", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert plans.name_of(path.format(tmp_path), [str(tmp_path / "own")]) == name


@pytest.mark.parametrize(
    ("profile", "hand"),
    [
        (None, (2.0, 0.34)),
        ("ideal", (2.0, 0.34)),
        ("mushr_nano", (0.9286, 0.3158)),
    ],
)
def test_what_a_car_can_do(profile, hand):
    """The commands of driving by hand are those of MuSHR's joystick, within the car's limits."""
    values = read_profile(f"{PACKAGE}/config/cars/{profile}.yaml") if profile else {}
    speed, steering_angle = hand
    expected = {"speed": speed, "steering_angle": steering_angle}
    limits = plans.car_limits(Parameters(values))
    assert limits.pop("car") != plans.car_limits(Parameters({"wheelbase": 0.5}))["car"]
    assert limits == {"hand": expected}


def summary(tmp_path, text, grid=None, **car):
    path = tmp_path / "plan.txt"
    path.write_text(text)
    answer = plans.describe("plan", str(path), "car", Car(**car), grid)
    return json.loads(json.dumps(answer, allow_nan=False))


def test_a_plan(tmp_path):
    answer = summary(tmp_path, "1, 2, 0\n\n2.0, 0\n0.5, 0.1, 20\n")
    assert (answer["name"], answer["start"]) == ("plan", [1.0, 2.0, 0.0])
    assert answer["start_line"] == 1
    assert answer["rows"] == [
        {"line": 3, "speed": 2.0, "steering_angle": 0.0, "duration": 1.0},
        {"line": 4, "speed": 0.5, "steering_angle": 0.1, "duration": 20.0},
    ]
    assert (answer["row_count"], answer["faults"], answer["fault_count"]) == (2, [], 0)
    assert answer["length"] == pytest.approx(12.0)
    assert (answer["duration"], answer["wall"]) == (21.0, None)
    turned = 10.0 * math.tan(0.1) / 0.33
    assert answer["final_pose"] == pytest.approx(
        [3.0 + math.sin(turned) * 0.33 / math.tan(0.1), answer["final_pose"][1], turned], abs=1e-6
    )
    assert len(answer["path"]) <= plans.MAX_PATH_POINTS + 1
    assert answer["path"][0] == [1.0, 2.0]
    assert answer["path"][-1] == answer["final_pose"][:2]
    assert answer["ignores_noise"] is False
    noisy = summary(tmp_path, "1, 2, 0\n\n2.0, 0\n0.5, 0.1, 20\n", speed_noise=0.1)
    assert noisy == {**answer, "ignores_noise": True}, "the prediction is the same"


def test_a_plan_with_faults(tmp_path):
    answer = summary(tmp_path, "1, 2, 0\n2.0, x\n")
    assert [(each["line"], each["column"]) for each in answer["faults"]] == [(2, 6)]
    assert answer["faults"][0]["text"].startswith("steering angle")
    assert (answer["start"], answer["rows"], answer["path"]) == (None, [], [])


def test_a_long_plan(tmp_path):
    """The page gets a part of it."""
    answer = summary(tmp_path, "0, 0, 0\n" + 5000 * "1, 0, 0.1\n")
    assert (len(answer["rows"]), answer["row_count"]) == (1000, 5000)
    assert answer["rows"][-1]["line"] == 1001
    assert answer["duration"] == pytest.approx(500.0)
    answer = summary(tmp_path, "0, 0, 0\n" + 5000 * "fast, 0\n")
    assert (len(answer["faults"]), answer["row_count"]) == (1000, 0)
    assert answer["fault_count"] > 1000


def test_a_plan_that_hits_a_wall(tmp_path):
    cells = np.zeros((10, 100), np.int8)
    cells[:, 60] = 100
    answer = summary(tmp_path, "1, 0.5, 0\n1.0, 0, 9\n", Grid(cells, 0.1))
    assert [each["line"] for each in answer["faults"]] == [2]
    assert "wall" in answer["faults"][0]["text"]
    assert answer["final_pose"] == pytest.approx([5.62, 0.5, 0.0])
    assert answer["wall"] == pytest.approx(4.62)
    assert (answer["length"], answer["duration"]) == (pytest.approx(4.62), 9.0)


def test_the_image_of_a_map():
    cells = np.array([[0, -1], [100, 51], [50, 0]], np.int8)
    image = Image.open(io.BytesIO(png(Grid(cells, 0.1))))
    assert np.asarray(image).tolist() == [[254, 254], [0, 0], [254, 205]]
