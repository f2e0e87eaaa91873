"""Check when the test node posetest.py has received what it waits for."""

from mushr_ros_intro.replay.series import Series
from support.helpers import wait_for

SECOND = 1_000_000_000


def test_series():
    series = Series()
    assert not series.covers(SECOND, 100 * SECOND)
    series.add(5 * SECOND, "a")
    assert not series.covers(SECOND, 5 * SECOND)
    series.add(6 * SECOND, "b")
    assert series.covers(SECOND, 0)
    assert not series.covers(2 * SECOND, 100 * SECOND)  # more may be in transit
    wait_for(lambda: series.covers(2 * SECOND, 100 * SECOND), "the topic to be quiet")
    assert not series.covers(2 * SECOND, 7 * SECOND - 1)
    assert series.covers(2 * SECOND, 7 * SECOND)
    assert series.entries == [(5 * SECOND, "a"), (6 * SECOND, "b")]
