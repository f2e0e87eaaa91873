"""Plan files that are written: the text, the name of the file, and files that fail."""

import os
import resource

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mushr_ros_intro.authoring.plan_file import PlanFile, plan_text
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.parse import parse_plan, read_plan
from mushr_ros_intro.plan.plan import Plan, Row, as_float32

SECOND = 1_000_000_000

ends = st.sampled_from(["\n", "\r\n", " \n", " # 1, 2\n", "\n\n", "\n\t# caf\u00e9\r\n"])
DAYS = 10**15
"""Longest duration drawn [ns]; up to here a float of seconds is good to a nanosecond."""


lines = st.tuples(st.floats(-1e3, 1e3), st.floats(-1.57, 1.57), st.integers(1, DAYS), ends)


@given(st.tuples(*[st.floats(-1e6, 1e6)] * 3), st.lists(lines, min_size=1, max_size=8))
@example((0.0, 0.0, 0.0), [(1.1094741225242617, -1.1094741225242617, 1, "\n")])
def test_a_plan_has_the_numbers_of_its_file_and_when_written(start, rows):
    text = "{!r}, {!r}, {!r}\n".format(*start)
    for speed, angle, duration, end in rows:
        text += f"{speed!r},{angle!r} , {duration // SECOND}.{duration % SECOND:09d}{end}"
    written = plan_text(start, [Row(*row[:3]) for row in rows])
    expected = [(as_float32(v), as_float32(angle), duration) for v, angle, duration, _ in rows]
    for each in (text, written):
        plan = parse_plan(each.encode(), "plan")
        assert plan.start == start
        assert [row[:3] for row in plan.rows] == expected


ROWS = [Row(2.0, 0.3400000035762787, 250_000_001), Row(-0.5, -0.0, 10 * SECOND)]

NOBODY = 65534
"""A user without rights."""


def test_text_of_a_plan():
    assert plan_text((0.0, -1.5, 0.785), ROWS) == (
        "# x [m], y [m], theta [rad]\n"
        "0.0, -1.5, 0.785\n"
        "# speed [m/s], steering angle [rad], duration [s]\n"
        "2.0, 0.34, 0.250000001\n"
        "-0.5, 0.0, 10.0\n"
    )


@pytest.fixture(name="file")
def _file(tmp_path):
    return PlanFile(Parameters({"folder": str(tmp_path)}), "mine.txt")


def save(file, x=0.0, rows=ROWS):
    """Save a plan that starts at `x`; return the path of the new file."""
    return file.save(Plan("", Pose(x, 0.0, 0.0), tuple(rows)), "").split()[1].rstrip(";")


def test_no_file_is_overwritten(file, tmp_path):
    (tmp_path / "mine_2.txt").mkdir()
    paths = [save(file, x) for x in range(3)]
    assert [os.path.basename(path) for path in paths] == ["mine.txt", "mine_3.txt", "mine_4.txt"]
    assert [read_plan(path).start[0] for path in paths] == [0.0, 1.0, 2.0]


def test_a_folder_without_write_access(file, tmp_path):
    tmp_path.chmod(0o555)
    user = os.geteuid()
    if user == 0:
        os.seteuid(NOBODY)  # root may write anywhere
    try:
        with pytest.raises(UserError, match=r"mine.txt cannot be written \(Permission denied\)"):
            save(file)
    finally:
        os.seteuid(user)
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
