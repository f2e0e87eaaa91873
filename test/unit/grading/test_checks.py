"""Check what the test nodes find in series of messages."""

import math

import pytest

from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.grading.checks import (
    Motion,
    Series,
    as_number,
    odometry_faults,
    pose_fault,
    rate_faults,
    wait_for,
)

SECOND = 1_000_000_000
TENTH = SECOND // 10
JITTER = TENTH // 2


def test_rate():
    even = list(range(0, 2 * SECOND, TENTH))
    assert rate_faults(even, [SECOND, SECOND], TENTH, JITTER) == []
    assert rate_faults(even[:-1], [SECOND, SECOND], TENTH, JITTER) == [
        "row 2 (1 s) has 9 messages; expected 10"
    ]
    jittery = [stamp + (JITTER // 3 if k % 2 else 0) for k, stamp in enumerate(even)]
    assert rate_faults(jittery, [SECOND, SECOND], TENTH, JITTER) == []
    assert "0.2 s between the stamps of messages 5 and 6" in str(
        rate_faults(even[:5] + even[6:], [], TENTH, JITTER)
    )
    back = rate_faults([0, TENTH, TENTH // 2], [], TENTH, JITTER)
    assert back == ["message 3 is stamped 0.05 s before the one before it"]
    assert rate_faults([0, 0, TENTH], [], TENTH, JITTER) == []
    quarters = [k * SECOND // 4 + due for k in range(3) for due in (0, TENTH, 2 * TENTH)]
    quarters.append(3 * SECOND // 4)  # the stop
    assert rate_faults(quarters, 3 * [SECOND // 4], TENTH, JITTER) == []
    assert rate_faults([], [SECOND], TENTH, JITTER) == ["row 1 (1 s) has 0 messages; expected 10"]


def drive(speeds, rates):
    """Return the odometry of a drive with a speed and a turn rate for each tenth of a second."""
    pose, motions = Pose(1.0, -2.0, 3.0), []
    for k, (speed, rate) in enumerate(zip(speeds, rates)):
        motions.append(Motion(k * TENTH, pose, speed, 0.0, rate))
        pose = drive_arc(pose, 0.1 * speed, rate / speed if speed else 0.0)
    return motions


def faults(motions):
    return odometry_faults(motions, 2 * TENTH, 1e-9, 1e-9)


def test_odometry():
    motions = drive([1.0, 1.0, 2.0, 2.0, -1.5, -1.5, 0.0, 0.0], [0.5, 0.5, 3.0, 3.0, -1, -1, 0, 0])
    assert faults(motions) == []
    assert faults([motions[0], motions[1]._replace(stamp=motions[0].stamp)]) == []
    wrapped = [
        each._replace(pose=each.pose._replace(theta=math.remainder(each.pose.theta, math.tau)))
        for each in motions
    ]
    assert faults(wrapped) == []
    spoilt = {
        "the twist says 0.1 m/s": [each._replace(speed=0.1 * each.speed) for each in motions],
        "the twist says 0.25 rad/s": [
            each._replace(turn_rate=0.5 * each.turn_rate) for each in motions
        ],
        "m/s to the left": [each._replace(side_speed=0.1) for each in motions],
        "sideways": [
            each._replace(pose=each.pose._replace(theta=each.pose.theta + 0.3)) for each in motions
        ],
        "moves by 3": [
            each._replace(pose=each.pose._replace(x=each.pose.x - 3.0 * (k > 0)))
            for k, each in enumerate(motions)
        ],
    }
    for message, wrong in spoilt.items():
        assert message in faults(wrong)[0]
    assert odometry_faults(spoilt["sideways"], TENTH // 2, 1e-9, 1e-9) == []
    assert "0.1 m/s to the right" in faults([motions[0]._replace(side_speed=-0.1), *motions[1:]])[0]


def test_odometry_where_a_turn_begins():
    """While the turn rate rises evenly, the heading goes by the square of the time."""
    headings = [0.05 * ((k + 0.5) / 1000) ** 2 for k in range(1000)]
    x = sum(map(math.cos, headings)) * 1e-4
    y = sum(map(math.sin, headings)) * 1e-4
    begin = Motion(0, Pose(0.0, 0.0, 0.0), 1.0, 0.0, 0.0)
    end = Motion(TENTH, Pose(x, y, 0.05), 1.0, 0.0, 1.0)
    assert odometry_faults([begin, end], TENTH, 1e-5, 1e-6) == []


def test_pose():
    wanted = Pose(1.0, 2.0, math.pi)
    assert pose_fault(Pose(1.0, 2.1, -math.pi), wanted, 0.2, 0.1) == ""
    assert pose_fault(Pose(1.0, 2.1, 0.0), wanted, 0.2, None) == ""
    assert "3.14 rad" in pose_fault(Pose(1.0, 2.0, 0.0), wanted, 0.2, 0.1)
    assert "0.3 m" in pose_fault(Pose(1.3, 2.0, math.pi), wanted, 0.2, 0.1)
    assert "no pose" in pose_fault(None, wanted, 0.2, 0.1)


def test_series():
    series = Series()
    assert not series.covers(SECOND, 100 * SECOND)
    series.add(5 * SECOND, "a")
    assert not series.covers(SECOND, 5 * SECOND)
    series.add(6 * SECOND, "b")
    assert series.covers(SECOND, 0)
    assert not series.covers(2 * SECOND, 100 * SECOND)  # more may be on its way
    wait_for(lambda: series.covers(2 * SECOND, 100 * SECOND), "quiet", 60.0)
    assert not series.covers(2 * SECOND, 7 * SECOND - 1)
    assert series.covers(2 * SECOND, 7 * SECOND)
    assert series.entries == [(5 * SECOND, "a"), (6 * SECOND, "b")]


def test_wait_for():
    assert wait_for(lambda: 3, "three", 0.0) == 3
    with pytest.raises(AssertionError, match="waited 0.1 s for a miracle"):
        wait_for(lambda: False, "a miracle", 0.1)


def test_as_number():
    assert as_number("1e-6") == 1e-6
    assert as_number("wide") == "wide"
    assert as_number(None) is None
