"""Plan files: reading good ones, and the faults of bad ones."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.plan import parse
from mushr_ros_intro.plan.parse import parse_plan, read_plan
from mushr_ros_intro.plan.plan import PlanError, as_float32, fault_lines, shortest_decimal
from support.paths import FIXTURES, PLANS

BROKEN_PLANS = os.path.join(FIXTURES, "broken_plans")

SECOND = 1_000_000_000

FAULTS = {
    "decimal_commas": [
        "1:4: the line has a semicolon; expected a start pose 'x, y, theta' in m, m, rad, "
        "separated by commas; decimals have a point",
        "2:4: the line has a semicolon; expected 'speed, steering angle' or 'speed, steering "
        "angle, duration' in m/s, rad, s, separated by commas; decimals have a point",
    ],
    "copied": [
        "2:6: the line has the character MINUS SIGN (U+2212); type '-' instead",
        "3:4: the line has the character NO-BREAK SPACE (U+00A0); type ' ' instead",
        "4:6: the line has the character EN DASH (U+2013); type '-' instead",
        "5:4: the line has the character FULLWIDTH COMMA (U+FF0C); type ',' instead",
        "6:6: steering angle is '0.1\u00b2', which is not a number; expected one such as 0.1",
    ],
    "duration_negative": ["2:12: duration '-1' is out of range; expected seconds, from 1e-09"],
    "duration_too_large": ["2:12: duration '1e300' is out of range; expected seconds, from"],
    "duration_too_small": ["2:12: duration '0.5e-9' is out of range; expected seconds, from"],
    "duration_zero": ["2:12: duration '0.0' is out of range"],
    "empty": ["1:1: the file has no line with numbers; expected a start pose"],
    "empty_cell": ["2:1: speed is missing; expected a number"],
    "four_columns": ["2:17: 4 columns; expected 'speed, steering angle' or"],
    "infinity": ["2:1: speed is '-Infinity'; expected a finite number"],
    "many": [
        "1:1: x is 'x', which is not a number",
        "1:7: theta '1e400' is out of range; expected radians, from -1e+06 to 1e+06",
        "4:2: speed is 'fast', which is not a number",
        "4:8: steering angle is 'ninety', which is not a number",
        "4:16: duration '-1' is out of range; expected seconds, from 1e-09",
        "5:4: 1 column; expected",
        "6:15: 4 columns; expected",
    ],
    "nan": ["2:6: steering angle is 'nan'; expected a finite number"],
    "no_command": ["4:1: no command after the start pose; expected 'speed, steering angle'"],
    "not_a_number": ["2:6: steering angle is 'left', which is not a number; expected one such as"],
    "nul_byte": ["2:6: steering angle is '0\\x00.09', which is not a number"],
    "one_column": ["2:4: 1 column; expected 'speed, steering angle' or"],
    "only_comments": ["1:1: the file has no line with numbers; expected a start pose"],
    "overflow": ["2:6: steering angle '1e400' is out of range; expected radians, from -1.57 to"],
    "semicolons": ["2:4: the line has a semicolon; expected 'speed, steering angle' or"],
    "speed_too_large": ["2:1: speed '2000' is out of range; expected m/s, from -1000 to 1000"],
    "start_pose_missing": ["1:10: 2 columns; expected a start pose 'x, y, theta' in m, m, rad"],
    "start_pose_too_far_away": ["1:4: y '-2e6' is out of range; expected metres, from -1e+06 to"],
    "start_pose_with_four_columns": ["1:10: 4 columns; expected a start pose"],
    "steering_angle_in_degrees": ["2:6: steering angle '-30' is out of range; expected radians"],
    "tabs": [
        "1:6: 1 column; expected a start pose 'x, y, theta' in m, m, rad, separated by commas"
    ],
    "too_long": ["3:1: here the plan exceeds 1000000000 s; expected a shorter plan"],
    "trailing_comma": ["2:11: duration is missing; expected a number"],
    "underscore": ["2:1: speed is '1_0.0', which is not a number"],
    "unit": ["2:12: duration is '3s', which is not a number"],
    "utf_16": ["1:1: the file is UTF-16; expected UTF-8"],
}
"""Each broken plan with LINE:COLUMN of every fault and how its message begins."""


def faults_of(path):
    """Return the faults of a plan file as text, in the order in which they are reported."""
    with pytest.raises(PlanError) as caught:
        read_plan(str(path))
    assert str(caught.value) == "\n".join(map(str, caught.value.faults))
    return [str(fault) for fault in caught.value.faults]


def rows_of(text):
    """Return the rows of a plan that starts at the origin and goes on with `text`."""
    return parse_plan(f"0,0,0\n{text}".encode(), "plan").rows


@pytest.mark.parametrize("name", sorted(FAULTS))
def test_broken_plan(name):
    path = os.path.join(BROKEN_PLANS, name + ".txt")
    found = faults_of(path)
    assert len(found) == len(FAULTS[name]), found
    for fault, expected in zip(found, FAULTS[name]):
        assert fault.startswith(f"{path}:{expected}")


def test_every_broken_plan_is_in_the_table():
    assert sorted(os.listdir(BROKEN_PLANS)) == sorted(name + ".txt" for name in FAULTS)


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "file").touch()
    with open(tmp_path / "huge", "wb") as file:
        file.truncate(parse.MAX_FILE_SIZE + 1)
    for name, expected in {
        "missing": "the file cannot be read (No such file or directory); expected a plan",
        ".": "the file cannot be read (Is a directory); expected a plan",
        "loop": "the file cannot be read (Too many levels of symbolic links)",
        "file/plan": "the file cannot be read (Not a directory)",
        "n" * 300: "the file cannot be read (File name too long)",
        "huge": "the file has more than 100000000 bytes; expected a plan file",
    }.items():
        path = os.path.join(str(tmp_path), name)
        (fault,) = faults_of(path)
        assert fault.startswith(f"{path}: {expected}")


def test_only_the_first_faults_are_shown_and_too_many_end_the_search():
    with pytest.raises(PlanError) as caught:
        rows_of("nan, 0\n" * 25)
    assert str(caught.value).splitlines()[20:] == ["... and 5 more faults"]
    faults = caught.value.faults
    assert [len(fault_lines(faults[:count])) for count in (20, 21, 22)] == [20, 21, 21]
    with pytest.raises(PlanError) as caught:
        rows_of("nan, 0\n" * 100_000)
    assert len(caught.value.faults) == parse.MAX_FAULTS + 1
    assert "too many faults; the rest is not checked" in caught.value.faults[-1].text


@pytest.mark.parametrize(
    "line",
    ["1" * 100_000 + "x", "1e" + "1" * 100_000 + "x", "1" + " " * 100_000 + "x", "," * 1_000_000],
    ids=["digits", "exponent", "spaces", "commas"],
)
def test_a_long_line_takes_no_more_than_linear_time(line):
    with pytest.raises(PlanError) as caught:  # quadratic time would be half an hour
        rows_of(line)
    (fault,) = caught.value.faults
    assert len(str(fault)) < 200


@pytest.mark.parametrize(
    "text",
    [
        b"2.0,0.09\n-1,.5,0.25\n",
        b"2.0,0.09\r\n-1,.5,0.25\r\n",
        b"2.0,0.09\r-1,.5,0.25",
        b"\n  \t 2. , +9e-2\t\n\n -1.0E0 ,\t0.5 , 25e-2  \n\n\x1e",
        b"\x1e2.0,0.09\n-1,.5,\xc2\xa00.25\n",
        b"# a comment\n2.0,0.09# 1, 2, 3, 4\n  # nan\n-1,.5,0.25 # caf\xc3\xa9\n#",
        b"2.0,0.09 # caf\xe9\n-1,.5,0.25\n",
    ],
    ids=["plain", "CRLF", "CR", "spaces", "odd spaces", "comments", "Latin-1"],
)
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["", "BOM"])
def test_forms_of_the_same_plan(text, mark):
    plan = parse_plan(mark + b"# start\n\n1, -2.5, 0.785 # x, y, theta\n" + text, "plan")
    assert plan.start == (1.0, -2.5, 0.785)
    assert [row[:3] for row in plan.rows] == [
        (2.0, as_float32(0.09), SECOND),
        (-1.0, 0.5, 250_000_000),
    ]
    assert plan.duration == 1_250_000_000
    assert plan.path == "plan"


@pytest.mark.parametrize("begin", [b"PK\3\4\x14", b"\x89PNG\r", b"%PDF-1.7", b"{\\rtf1"])
def test_a_file_that_is_not_plain_text(begin):
    with pytest.raises(PlanError) as caught:
        parse_plan(begin + b"\n0,0,0\n1,0\n", "plan")
    assert str(caught.value) == (
        "plan:1:1: the file is a document, a picture or an archive; expected plain text"
    )


def test_a_line_that_begins_with_a_semicolon():
    with pytest.raises(PlanError) as caught:
        parse_plan(b"0,0,0\n;1,0\n", "plan")
    assert [str(each)[:40] for each in caught.value.faults] == [
        "plan:2:1: the line has a semicolon; expe"
    ]


@pytest.mark.parametrize("text", ["1,5, 0, 0\n1,0\n", "0,0,0\n0,5, 0,1\n"])
def test_decimal_commas(text):
    with pytest.raises(PlanError) as caught:
        parse_plan(text.encode(), "plan")
    (fault,) = caught.value.faults
    assert fault.text.startswith("4 columns; expected ")
    assert fault.text.endswith("; decimals have a point")


def test_rows_and_the_start_pose_know_their_line_and_columns():
    data = b"\xef\xbb\xbf# c\n\n  1,\t2 ,3\r\n1,0\r\n# \r\r  1 , -.5  ,1e3 # 7, 7\n"
    plan = parse_plan(data, "plan")
    assert (plan.start_line, plan.start_columns) == (3, (3, 6, 9))
    assert [(row.line, row.columns) for row in plan.rows] == [(4, (1, 3)), (7, (3, 7, 13))]
    assert str(plan.fault(-1, 1, "text")) == "plan:3:6: text"
    assert str(plan.fault(0, 1, "text")) == "plan:4:3: text"
    assert str(plan.fault(2, 0, "text")) == "plan:7:3: text"  # the stop after the last row


def test_commands_are_rounded_to_float32():
    (row,) = rows_of("0.3, 0.09")
    assert row[:2] == (0.30000001192092896, 0.09000000357627869)
    assert as_float32(1e-46) == 0.0
    assert as_float32(2.0**24 + 1) == 2.0**24


@given(st.floats(-1e3, 1e3))
def test_the_shortest_decimal_has_the_same_float32(value):
    shown = shortest_decimal(value)
    assert as_float32(shown) == as_float32(value)
    assert len(repr(abs(shown)).strip("0.").replace(".", "").split("e")[0]) <= 9


def test_durations_are_whole_nanoseconds():
    for text, expected in {
        "0.58": 580_000_000,
        "0.1": 100_000_000,
        "1e-9": 1,
        "86400.000000001": 86_400_000_000_001,
        "1e9": 1_000_000_000 * SECOND,
    }.items():
        (row,) = rows_of(f"1, 0, {text}")
        assert row.duration == expected and isinstance(row.duration, int)


def test_the_plans_of_the_tutorial_are_shipped_byte_for_byte():
    for name, expected in {
        "straight_line": ["0,0,0"] + [f"{v},0.0" for v in (2, 3, 4, 5, 6, 6, 6, 5, 4, 3, 2)],
        "figure_8": ["0,0,0.785"] + ["2.0,0.09"] * 11 + ["2.0,-0.09"] * 11,
    }.items():
        with open(os.path.join(PLANS, name + ".txt"), "rb") as file:
            assert file.read().decode() == "\n".join(expected) + "\n"


def test_a_header_is_one_fault(tmp_path):
    """The line after it is the start pose."""
    path = tmp_path / "plan.txt"
    path.write_text("x,y,theta\n0,0,0\n2.0,0.1\n")
    (fault,) = faults_of(path)
    assert (
        ":1:1: the line has no number; expected a start pose 'x, y, theta' in m, m, rad, and # "
        in fault
    )
