"""Instants and durations."""

import pytest

from mushr_ros_intro.sim.stamps import STAMP_TOLERANCE, effective_stamp, from_seconds

NOW = 1_700_000_000_000_000_000


def test_seconds_become_the_nearest_nanosecond():
    for seconds, expected in {
        0.58: 580_000_000,
        1.001: 1_001_000_000,
        1e-9: 1,
        3: 3 * 10**9,
    }.items():
        assert from_seconds(seconds) == expected and isinstance(from_seconds(seconds), int)


@pytest.mark.parametrize("off", [0, 1, -1, STAMP_TOLERANCE, -STAMP_TOLERANCE])
def test_a_stamp_near_now_is_taken_as_it_is(off):
    assert effective_stamp(NOW + off, NOW) == NOW + off


@pytest.mark.parametrize("stamp", [0, 1, NOW + STAMP_TOLERANCE + 1, NOW - STAMP_TOLERANCE - 1])
def test_any_other_stamp_means_now(stamp):
    assert effective_stamp(stamp, NOW) == NOW
    assert effective_stamp(0, 5) == 5
