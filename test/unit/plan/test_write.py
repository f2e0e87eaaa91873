"""The text of plans."""

from hypothesis import example, given
from hypothesis import strategies as st

from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.plan import Row, as_float32
from mushr_ros_intro.plan.write import plan_text

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


def test_text_of_a_plan():
    rows = [Row(2.0, 0.3400000035762787, 250_000_001), Row(-0.5, -0.0, 10 * SECOND)]
    assert plan_text((0.0, -1.5, 0.785), rows) == (
        "# x [m], y [m], theta [rad]\n"
        "0.0, -1.5, 0.785\n"
        "# speed [m/s], steering angle [rad], duration [s]\n"
        "2.0, 0.34, 0.250000001\n"
        "-0.5, 0.0, 10.0\n"
    )
