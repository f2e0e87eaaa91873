"""Plan files that are written: the name of the file, and files that fail."""

import os
import resource

import pytest

from mushr_ros_intro.authoring.plan_file import PlanFile
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan, Row

SECOND = 1_000_000_000

ROWS = [Row(2.0, 0.3400000035762787, 250_000_001), Row(-0.5, -0.0, 10 * SECOND)]

NOBODY = 65534
"""A user without rights."""


@pytest.fixture(name="file")
def _file(tmp_path):
    return PlanFile(str(tmp_path), "mine.txt")


def save(file, x=0.0, rows=ROWS):
    """Save a plan that starts at `x`; return the path of the new file."""
    return file.save(Plan("", Pose(x, 0.0, 0.0), tuple(rows)), "").split()[1].rstrip(";")


def test_no_file_is_overwritten(file, tmp_path):
    (tmp_path / "mine_2.txt").mkdir()
    paths = [save(file, x) for x in range(3)]
    assert [os.path.basename(path) for path in paths] == ["mine.txt", "mine_3.txt", "mine_4.txt"]
    assert [read_plan(path).start[0] for path in paths] == [0.0, 1.0, 2.0]


def test_a_folder_without_write_access(file, tmp_path):
    """The node says so at its start, not only after the drive."""
    assert file.destination() == f"plans go to {tmp_path}"
    tmp_path.chmod(0o555)
    user = os.geteuid()
    if user == 0:
        os.setresuid(NOBODY, NOBODY, user)  # root may write anywhere
    try:
        with pytest.raises(UserError, match=r"mine.txt cannot be written \(Permission denied\)"):
            save(file)
        assert "cannot write there: choose another folder with _folder:=PATH" in file.destination()
        assert file.destination().endswith("or folder:=PATH of web.launch")
    finally:
        os.setresuid(user, user, user)
    assert os.listdir(str(tmp_path)) == []


def test_an_incomplete_file_is_removed(file, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50, limits[1]))
    try:
        with pytest.raises(UserError, match=r"mine.txt cannot be written \(File too large\)"):
            save(file)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert os.listdir(str(tmp_path)) == []


def test_plans_that_could_not_be_read_are_not_written(file, tmp_path):
    for row, expected in (
        (Row(1.0, 1.5705, SECOND), "mine.txt:4:6: steering angle '1.5705' is out of range"),
        (Row(1.0, 0.0, 10**19), "duration '10000000000.0' is out of range"),
    ):
        with pytest.raises(UserError, match=expected):
            save(file, rows=[row])
    assert os.listdir(str(tmp_path)) == []
