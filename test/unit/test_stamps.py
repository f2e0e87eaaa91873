"""Test what stamps mean."""

import pytest

from mushr_ros_intro.stamps import (
    MAX_LEAD,
    STAMP_TOLERANCE,
    CurrentTime,
    effective_stamp,
    from_seconds,
)

NOW = 10**18


@pytest.mark.parametrize("offset", [0, 1, -1, MAX_LEAD, STAMP_TOLERANCE, -STAMP_TOLERANCE])
def test_a_stamp_within_the_tolerance_is_kept(offset):
    assert effective_stamp(NOW + offset, NOW) == NOW + offset


@pytest.mark.parametrize("stamp", [0, NOW + STAMP_TOLERANCE + 1, NOW - STAMP_TOLERANCE - 1])
def test_any_other_stamp_means_now(stamp):
    assert effective_stamp(stamp, NOW) == NOW


def test_the_tolerance_may_be_another():
    assert effective_stamp(NOW + 5, NOW, 5) == NOW + 5
    assert effective_stamp(NOW + 6, NOW, 5) == NOW


@pytest.mark.parametrize(
    "seconds, nanoseconds",
    [(0.58, 580_000_000), (1e-9, 1), (0.0, 0), (1.5e-9, 2), (3.0, 3 * 10**9)],
)
def test_seconds_become_nanoseconds(seconds, nanoseconds):
    assert from_seconds(seconds) == nanoseconds


def test_the_time_never_runs_back_unless_the_clock_was_set_back():
    time = CurrentTime(NOW)
    for now, expected, was_set_back in (
        (NOW + 5, NOW + 5, False),
        (NOW + 4, NOW + 5, False),
        (NOW + 5 - STAMP_TOLERANCE, NOW + 5, False),
        (NOW + 4 - STAMP_TOLERANCE, NOW + 4 - STAMP_TOLERANCE, True),
        (NOW, NOW, False),
    ):
        assert time.update(now) == was_set_back
        assert time.now == expected
