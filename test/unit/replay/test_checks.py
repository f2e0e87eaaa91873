"""Check what the test nodes find in series of messages."""

import math

import pytest

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.checks import (
    Series,
    compare,
    plan_faults,
    rate_faults,
)
from support.helpers import wait_for

SECOND = 1_000_000_000
TENTH = SECOND // 10
JITTER = TENTH // 2
EVEN = list(range(0, 2 * SECOND, TENTH))
JITTERY = [stamp + (JITTER // 3 if k % 2 else -JITTER // 3) for k, stamp in enumerate(EVEN)]
JITTERY[0] = 0
QUARTERS = [k * SECOND // 4 + due for k in range(3) for due in (0, TENTH, 2 * TENTH)]
QUARTERS += [3 * SECOND // 4]  # the stop


@pytest.mark.parametrize(
    ("stamps", "fault"),
    [
        (EVEN, ""),
        (JITTERY, ""),
        (EVEN[:-2], ""),
        ([*EVEN, EVEN[-1]], ""),
        (EVEN[:-3], "17 messages received in 2 s; expected at least 18"),
        ([], "0 messages received in 2 s; expected at least 18"),
        (EVEN[:5] + EVEN[6:], "0.2 s between the stamps of messages 5 and 6; expected 0.1 s"),
        ([*EVEN, 18 * TENTH], "message 21 is stamped 0.1 s before message 20; expected rising st"),
    ],
)
def test_rate(stamps, fault):
    faults = rate_faults(stamps, 2 * SECOND, TENTH, JITTER)
    assert len(faults) == bool(fault) and fault in "".join(faults)
    assert "at least 2" in rate_faults(stamps[:1], 0, TENTH, JITTER)[0]


@pytest.mark.parametrize(
    ("stamps", "rows", "fault"),
    [
        (EVEN, [SECOND, SECOND], ""),
        (JITTERY, [SECOND, SECOND], ""),
        (QUARTERS, 3 * [SECOND // 4], ""),
        (QUARTERS + [2 * SECOND, SECOND], 3 * [SECOND // 4], ""),
        (EVEN[:-1], [SECOND, SECOND], "row 2 (1 s): 9 messages received; expected 10"),
        (EVEN[:1], [TENTH * 3 // 2], "row 1 (0.15 s): 1 message received; expected 2"),
        (EVEN[:5] + EVEN[6:], [SECOND], "0.2 s between the stamps of messages 5 and 6; expected 0"),
        ([], [SECOND], "no message received"),
    ],
)
def test_rate_of_a_plan(stamps, rows, fault):
    begin = 1_700_000_000 * SECOND
    faults = plan_faults([begin + stamp for stamp in stamps], rows, TENTH, JITTER)
    assert bool(faults) == bool(fault) and fault in "".join(faults[:1])


@pytest.mark.parametrize(
    ("pose", "angle", "is_right", "said"),
    [
        ((1.0, 2.1, -math.pi), 0.1, True, "2.1000 m, -3.1416 rad), 0.1 m and 0 rad from"),
        ((1.0, 2.1, 0.0), math.pi, True, "; tolerances 0.2 m and 3.14 rad"),
        ((1.0, 2.0, 0.0), 0.1, False, "0 m and 3.14 rad from the expected (1.0000 m, 2.0000 m"),
        ((1.3, 2.0, math.pi), 0.1, False, "0.3 m and 0 rad from the expected (1.0000 m, 2.0000 m"),
        ((1.3, 2.0, math.pi), 0.1, False, "; tolerances 0.2 m and 0.1 rad"),
        ((1.3, 2.0, math.pi), math.pi, False, "; tolerances 0.2 m"),
    ],
)
def test_pose(pose, angle, is_right, said):
    passed, difference = compare(Pose(*pose), Pose(1.0, 2.0, math.pi), 0.2, angle)
    assert passed == is_right and said in difference


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
