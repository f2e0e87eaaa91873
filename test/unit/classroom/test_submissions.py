"""Check that the submissions of a class are found, with their students and unique names."""

import os
import shutil

import pytest

from mushr_ros_intro.classroom.grades import Student
from mushr_ros_intro.errors import UserError
from support.submissions import (
    NODE,
    PACKAGE,
    PUBLISHER,
    XML,
    collected,
    fill,
    inside,
    only,
    unchecked,  # noqa: F401
    zip_bytes,
    zipped,
)

pytestmark = pytest.mark.usefixtures("unchecked")


@pytest.mark.parametrize(
    ("files", "path", "name", "place"),
    [
        (inside("intro"), "intro", "intro", PUBLISHER),
        (inside("intro/src/intro"), "intro", "intro", f"src/intro/{PUBLISHER}"),
        ({"path_publisher.py": NODE}, "path_publisher.py", "path_publisher", "path_publisher.py"),
        ({"class/alice.py": NODE}, "class", "alice", "path_publisher.py"),
        (
            inside("class/alice/catkin_ws/src/intro"),
            "class",
            "alice",
            f"catkin_ws/src/intro/{PUBLISHER}",
        ),
        ({"class/alice/a/path_publisher.py": NODE}, "class", "alice", "a/path_publisher.py"),
        (
            {"class/Zoe  Muller_1_file_/path_publisher.py": NODE},
            "class",
            "Zoe_Muller_1_file",
            "path_publisher.py",
        ),
        ({"class/a/.git/path_publisher.py": NODE, **inside("class/a")}, "class", "a", PUBLISHER),
        ({"class/a/build/path_publisher.py": NODE, **inside("class/a")}, "class", "a", PUBLISHER),
        ({**inside("class/a"), "class/notes.txt": b""}, "class", "a", PUBLISHER),
        (
            {
                **inside("class/a"),
                "class/a/old/path_publisher.py": NODE,
                "class/a/old/package.xml": XML,
            },
            "class",
            "a",
            PUBLISHER,
        ),
    ],
)
def test_folders_and_files(tmp_path, files, path, name, place):
    fill(tmp_path, files)
    found = only(tmp_path, path)
    assert (found.fault, found.name) == ("", name)
    assert found.command == (str(tmp_path / "workspace" / name / place),)
    assert os.access(found.command[0], os.X_OK)
    package = place[: -len(PUBLISHER)] if place.endswith(PUBLISHER) else None
    top = tmp_path / "workspace" / name
    assert found.packages == (() if package is None else (str(top / package),))
    assert not list(top.rglob(".git")) and not list(top.rglob("build"))


@pytest.mark.parametrize(
    "files",
    [
        PACKAGE,
        inside("intro"),
        {**inside("./intro"), "__MACOSX/intro/src/._path_publisher.py": b"", ".DS_Store": b""},
        {name.replace("/", "\\"): content for name, content in inside("intro").items()},
    ],
)
def test_zips(tmp_path, files):
    found = only(tmp_path, zipped(tmp_path / "my intro.ZIP", files))
    assert (found.fault, found.name, found.notes) == ("", "my_intro", ())
    assert found.command[0] == f"{found.packages[0]}/{PUBLISHER}"
    os.mkdir(tmp_path / "class")
    shutil.copy(tmp_path / "my intro.ZIP", tmp_path / "class" / "bob.zip")
    fill(tmp_path / "class" / "Eve_1_file_", {"a.zip": zip_bytes(tmp_path, files)})
    shutil.rmtree(tmp_path / "workspace" / "my_intro")
    assert [(each.name, each.fault) for each in collected(tmp_path, "class")] == [
        ("Eve_1_file", ""),
        ("bob", ""),
    ]


METADATA = b"""---
submission_1:
  :submitters:
  - :name: Ann Lee
    :sid: 17
    :email: ann@x.org
  - :name: Bo
    :sid:
    :email:
  :created_at: !ruby/object:ActiveSupport::TimeWithZone
    utc: 2024-01-01 10:00:00.000000000 Z
  :score: 0.0
submission_3:
  :submitters: []
"""
EXPORT = {**inside("submission_1"), **inside("submission_3"), "submission_metadata.yml": METADATA}


@pytest.mark.parametrize("system", [3, 0])
@pytest.mark.parametrize("form", ["folder", "zip", "zip with a folder"])
def test_gradescope(tmp_path, form, system):
    files = EXPORT if form != "zip with a folder" else inside("assignment_1_export", EXPORT)
    if form == "folder":
        fill(tmp_path / "export", files)
    else:
        zipped(tmp_path / "export.zip", files, system)
    found = collected(tmp_path, "export" if form == "folder" else "export.zip")
    assert [each.name for each in found] == ["submission_1", "submission_3"]
    assert found[0].students == (Student("Ann Lee", "17", "ann@x.org"), Student("Bo", "", ""))
    assert found[1].students == () and [each.fault for each in found] == ["", ""]
    assert bool(found[0].notes) == (system == 0 and form != "folder")


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_canvas(tmp_path, form):
    files = {
        "doejane_LATE_1234_9876_my_package.zip": zip_bytes(tmp_path),
        "leeann_22_9877_path_publisher-1.py": NODE,
        "leebo_23_9878_package.xml": XML,
        "leebo_23_9879_path_publisher-3.py": NODE,
        "poe_24_9880_report.pdf": b"",
        "carlo_13_text.html": b"",  # a text that was handed in has no number of an upload
        "anon_Ab1cD_101_path_publisher.py": NODE,
        "anon_Ef2gH_102_path_publisher-1.py": NODE,
    }
    fill(tmp_path / "class", files, 0o644)
    zipped(tmp_path / "class.zip", files)
    found = collected(tmp_path, "class" if form == "folder" else "class.zip")
    *anonymous, jane, ann, bo, poe = found
    assert [each.name for each in anonymous] == ["anon_Ab1cD", "anon_Ef2gH"]
    assert [each.name for each in (jane, ann, bo, poe)] == [
        "doejane_1234",
        "leeann_22",
        "leebo_23",
        "poe_24",
    ]
    assert jane.students == (Student("doejane", "", "", "1234"),)
    assert ann.students == (Student("leeann", "", "", "22"),)
    assert [each for each in found if each.fault] == [poe]
    assert len(bo.packages) == 1 and "found 'report.pdf'" in poe.fault
    assert [each for each in found if any("late" in note for note in each.notes)] == [jane]


@pytest.mark.parametrize(
    ("student", "older", "newest"),
    [
        ("ann_7", ["ann_7_9999_path_publisher.py"], "ann_7_10001_path_publisher-1.py"),
        ("x_108", ["x_LATE_108_5001_path_publisher.py"], "x_108_5002_path_publisher-1.py"),
        (
            "bo_8",
            ["bo_8_90_path_publisher-1.py", "bo_8_9_path_publisher.py"],
            "bo_8_100_path_publisher-2.py",
        ),
    ],
)
def test_canvas_with_several_versions_of_a_file(tmp_path, student, older, newest):
    """The newest one is used, which is not the last one in the order of the names."""
    files = {**dict.fromkeys(older, NODE), newest: NODE + b"# newest"}
    fill(tmp_path / "class", {**files, f"{student}_1_helper.py": b""})
    found = only(tmp_path, "class")
    assert found.name == student and "helper.py" in os.listdir(found.folder)
    with open(found.command[0], encoding="ascii") as file:
        assert file.read().endswith("# newest")
    assert not any("late" in note for note in found.notes)  # the one that is used is not


@pytest.mark.parametrize(
    ("one", "other", "name"),
    [
        ("a/Ann Lee", "a/Ann_Lee", "Ann_Lee"),
        ("a/Ann", "a/Ann.py", "Ann"),
        ("a/X", "a/x.py", "x"),
        ("a/x", "b/x", "x"),
    ],
)
def test_equal_names_are_refused(tmp_path, one, other, name):
    """If one of them had a number, its points would move to another student when one leaves."""
    for each in (one, other):
        fill(tmp_path, {each: NODE} if each.endswith(".py") else inside(each))
    with pytest.raises(UserError) as caught:
        collected(tmp_path, *(["a"] if other.startswith("a/") else [one, other]))
    shown = ", ".join(
        f"{os.path.splitext(os.path.basename(each))[0]!r} of {tmp_path}/{os.path.dirname(each)}"
        for each in (one, other)
    )
    text = f"two submissions have the name {name} in the results: {shown}; rename or remove one"
    assert str(caught.value).startswith(text)


def test_files_that_are_no_submissions(tmp_path, capsys):
    """They are named; a student may upload a report, and a class may contain a text."""
    others = ("README.md", "ann.pdf", "bob.DOCX", "eve.rar")
    fill(tmp_path / "class", {"ann.py": NODE, **dict.fromkeys([*others, ".hidden"], b"")})
    assert only(tmp_path, "class").name == "ann"
    left_out = ", ".join(map(repr, others))
    text = f"{tmp_path}/class: left out, not taken for submissions: {left_out}; expected a package"
    assert capsys.readouterr().err.startswith(text)


def test_several_paths(tmp_path, capsys):
    """They count as a folder with only these entries; the metadata of an entry have no effect."""
    fill(tmp_path / "class" / "karl_empty", {"README": b""})
    os.mkdir(tmp_path / "class" / "lea_empty")
    canvas = {"jo_7_90_path_publisher.py": NODE, "jo_7_91_helper.py": b""}
    fill(tmp_path / "class", {**inside("ann/my_ros_intro"), "notes.txt": b"", **canvas})
    fill(tmp_path / "class", {**inside("eve/bob"), "eve/submission_metadata.yml": b"{bob: {}}"})
    found = {}
    for paths in (["class"], [f"class/{each}" for each in os.listdir(tmp_path / "class")]):
        submissions = collected(tmp_path, *paths)
        found[len(paths)] = [(each.name, each.fault, each.students) for each in submissions]
        assert f"{tmp_path}/class: left out" in capsys.readouterr().err
        shutil.rmtree(tmp_path / "workspace")
    assert found[7] == found[1]
    names = [name for name, _, _ in found[7]]
    assert names == ["ann", "eve", "jo_7", "karl_empty", "lea_empty"]
    assert [bool(fault) for _, fault, _ in found[7]] == [False, False, False, True, True]
    for others, said in (("a", "/a: No such file"), ("class/notes.txt", "no submission in ")):
        with pytest.raises(UserError) as caught:
            collected(tmp_path, "class/notes.txt", others)
        assert said in str(caught.value)


def test_several_paths_of_an_export(tmp_path):
    """A pattern such as export/* also names the metadata."""
    fill(tmp_path / "export", EXPORT)
    entries = sorted(os.listdir(tmp_path / "export"))
    found = collected(tmp_path, *(f"export/{each}" for each in entries))
    shutil.rmtree(tmp_path / "workspace")
    one = collected(tmp_path, "export")
    assert [each.students for each in found] == [each.students for each in one]
    assert any(each.students for each in found)


FOREIGN = {
    "Zoe\u0308": "Zoe-c106d1",  # the first digits of sha256sum
    "\u674e\u660e": "submission-aa2271",
    "\u738b\u82b3": "submission-8ac954",
    "\udcff": "submission-8f1d0f",  # a byte that is not UTF-8
    120 * "a": f"{100 * 'a'}-2f3d33",
    "Pat O'Hara": "Pat_O_Hara",
}


def test_a_name_whose_characters_are_replaced(tmp_path):
    """It does not depend on the other submissions; its page shows the original name."""
    for original, name in FOREIGN.items():
        fill(tmp_path / "class" / original, PACKAGE)
        found = only(tmp_path, f"class/{original}")
        assert (found.name, found.fault) == (name, "")
        assert [each.name for each in found.students] == [original]
        shutil.rmtree(tmp_path / "workspace")
        fill(tmp_path / "all" / original, PACKAGE)
    found = collected(tmp_path, "all")
    assert {each.name for each in found} == set(FOREIGN.values())


def test_a_name_with_blanks(tmp_path):
    """A page shows it as its student writes it."""
    fill(tmp_path / "class" / "Ann  Lee", PACKAGE)
    found = only(tmp_path, "class")
    assert (found.name, [each.name for each in found.students]) == ("Ann_Lee", ["Ann  Lee"])


@pytest.mark.parametrize(
    ("files", "path", "said"),
    [
        ({}, "a", "a: No such file or directory"),
        ({"a/README": b""}, "a", "no submission in "),
        ({"a.txt": b""}, "a.txt", "a.txt is not a submission; expected a package folder"),
        ({"a/submission_metadata.yml": b"- 1"}, "a", "expected the metadata of Gradescope"),
        ({**inside("a"), "workspace/a/b": b""}, "a", "workspace/a: File exists"),
    ],
)
def test_paths_that_are_no_submissions(tmp_path, files, path, said):
    fill(tmp_path, files)
    with pytest.raises(UserError) as caught:
        collected(tmp_path, path)
    assert said in str(caught.value)
