"""Check the defaults of the command line of grade.py, and what a results folder remembers."""

import os

import pytest

from mushr_ros_intro.classroom.arguments import parse_arguments
from mushr_ros_intro.classroom.store import Store
from mushr_ros_intro.errors import UserError


def test_replays_at_the_same_time(monkeypatch):
    """They share the processors that this process may use, not all of the machine."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 7, 8})
    words = ["plan.txt", "--node", "my_ros_intro", "path_publisher.py"]
    assert parse_arguments(words, "").jobs == 6


def remembered(folder, *words):
    """Save the settings of a run with some words in a results folder."""
    arguments = parse_arguments(["class", "--plans", "circle", "--out", "none", *words], "")
    Store(str(folder)).save_settings(arguments.settings)


def test_a_later_run_uses_the_options_of_the_earlier_one(tmp_path, capsys):
    """Without them, all pages and tables would be written again with other points."""
    points, out = tmp_path / "points.yaml", tmp_path / "out"
    points.write_text("default: {path: 3}")
    remembered(out, "--points", str(points), "--car", "mushr_nano", "--remap", "a:=b")
    points.unlink()
    words = ["class", "--plans", "circle", "--out", str(out)]
    capsys.readouterr()
    for _ in range(2):
        found = parse_arguments(words, "")
        said = capsys.readouterr().err
        assert "--car mushr_nano" in said and "--remap a:=b" in said
        assert f"--points {out}/data/points.yaml" in said and "--map" not in said
        assert (found.car, found.remap) == ("mushr_nano", ["a:=b"])
        with open(found.points) as file:
            assert file.read() == "default: {path: 3}"
        Store(str(out)).save_settings(found.settings)
    found = parse_arguments([*words, "--car", "ideal"], "")
    assert (found.car, found.map) == ("ideal", "sandbox")
    remembered(out)
    capsys.readouterr()
    assert parse_arguments(words, "").points is None and not capsys.readouterr().err


def test_folders_with_other_options_are_not_merged(tmp_path):
    """Their results cannot be compared, until the command line says which option counts."""
    for name in ("1", "2"):
        points = tmp_path / f"{name}.yaml"
        points.write_text(f"tolerances: {{path: {name}}}")
        remembered(tmp_path / name, "--points", str(points))
    words = ["--merge", str(tmp_path / "1"), str(tmp_path / "2"), "--out", str(tmp_path / "all")]
    with pytest.raises(UserError, match="different values of --points"):
        parse_arguments(words, "")
    assert parse_arguments([*words, "--points", str(points)], "").points == str(points)


@pytest.mark.parametrize(
    "words", [["class"], ["--plans", "circle"], ["--jobs", "1"], ["--node", "a", "b"]]
)
def test_merge_grades_nothing(words, capsys):
    with pytest.raises(SystemExit):
        parse_arguments([*words, "--merge", "one", "--out", "all"], "")
    assert "it grades nothing" in capsys.readouterr().err


def test_points_in_another_encoding(tmp_path):
    """That of PowerShell's > in Windows."""
    points = tmp_path / "points.yaml"
    points.write_text("default: {path: 3}", encoding="utf-16")
    for _ in range(2):
        remembered(tmp_path / "out", "--points", str(points))
    words = ["class", "--plans", "circle", "--out", str(tmp_path / "out")]
    with open(parse_arguments(words, "").points, encoding="utf-16") as file:
        assert file.read() == "default: {path: 3}"
