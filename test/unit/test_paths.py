"""Find files by the names that users type."""

import os

import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import find_file, user_path


def test_a_relative_path_starts_where_the_user_is(monkeypatch, tmp_path):
    monkeypatch.setenv("PWD", str(tmp_path))
    monkeypatch.setenv("HOME", "/home/student")
    assert user_path("plans/a.txt") == str(tmp_path / "plans" / "a.txt")
    assert user_path("~/a.txt") == "/home/student/a.txt"
    assert user_path("/a.txt") == "/a.txt"


@pytest.fixture
def folders(tmp_path):
    """Return a folder of plans, and the user's directory with other files."""
    plans, here = tmp_path / "plans", tmp_path / "here"
    for path in ("plans/circle.txt", "plans/eight.txt", "here/circle.txt", "here/own.txt"):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).touch()
    return plans, here


def test_files_are_found_by_name_and_by_path(folders, monkeypatch):
    plans, here = folders
    for folder in (plans, here):
        (folder / "eight").mkdir()  # a folder does not hide a file
    monkeypatch.setenv("HOME", str(here))
    monkeypatch.setenv("PWD", str(here))
    for name, expected in {
        "circle": here / "circle.txt",
        "circle.txt": here / "circle.txt",
        "eight.txt": plans / "eight.txt",
        "eight": plans / "eight.txt",
        "./circle.txt": here / "circle.txt",
        "own.txt": here / "own.txt",
        "~/own.txt": here / "own.txt",
        "../plans/eight.txt": plans / "eight.txt",
        str(here / "circle.txt"): here / "circle.txt",
        str(here): here,
    }.items():
        found = find_file(name, str(plans), ".txt")
        assert os.path.realpath(found) == str(expected)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("eigth", "eigth: no such file; did you mean eight? (searched: HERE, PLANS, "),
        ("eighty_one", "eighty_one: no such file (searched: HERE, PLANS, "),
        ("x", "x: no such file (searched: HERE, PLANS, "),
        ("x", "); expected a path, or one of circle, eight"),
        ("cirlce.txt", "; did you mean circle? (searched: HERE, PLANS"),
        ("wave", "wave: no such file with the ending .txt, only wave.csv (searched: HERE, PLANS"),
        ("here/own", "here/own: no such file (searched: HERE/here, "),
        ("/nowhere/own.txt", "/nowhere/own.txt: no such file (searched: /nowhere); expected"),
        ("circle\0", ": no such file; did you mean circle?"),
        ("folder", "folder: not a file (searched: HERE, PLANS"),
        ("pipe", "pipe: not a file (searched: HERE, PLANS"),
        ("here/own.txt/x", "here/own.txt/x: no such file (searched: HERE"),
    ],
)
def test_a_missing_file(folders, name, expected, monkeypatch):
    plans, here = folders
    monkeypatch.setenv("PWD", str(here))
    (here / "folder").mkdir()
    (plans / "wave.csv").touch()
    os.mkfifo(here / "pipe")
    with pytest.raises(UserError) as caught:
        find_file(name, str(plans), ".txt")
    expected = expected.replace("PLANS", str(plans)).replace("HERE", str(here))
    assert expected in str(caught.value)


def test_a_folder_that_may_not_be_entered(folders, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr(os, "stat", refuse)
    with pytest.raises(UserError, match="own: permission denied"):
        find_file(str(folders[1] / "missing" / "own"), str(folders[0]), ".txt")
