"""Check what the test nodes find in series of messages."""

import math

import pytest

from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.grading.checks import (
    Motion,
    Series,
    odometry_faults,
    plan_faults,
    pose_fault,
    rate_faults,
)
from mushr_ros_intro.grading.steps import Step, parse_steps
from mushr_ros_intro.parameters import ParameterError
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


def drive(speeds, rates):
    """Return the odometry of a drive with a speed and a turn rate for each tenth of a second."""
    pose, motions = Pose(1.0, -2.0, 3.0), []
    for k, (speed, rate) in enumerate(zip(speeds, rates)):
        motions.append(Motion(k * TENTH, pose, speed, 0.0, rate))
        pose = drive_arc(pose, 0.1 * speed, rate / speed if speed else 0.0)
    return motions


MOTIONS = drive([1.0, 1.0, 2.0, 2.0, -1.5, -1.5, 0.0, 0.0], [0.5, 0.5, 3.0, 3.0, -1, -1, 0, 0])


MOVES = "in the 0.1 s before 0.100 the pose moves by"


def changed(change):
    """Return the drive with fields and pose changed as `change(number, motion)` says."""
    motions = []
    for number, motion in enumerate(MOTIONS):
        values = change(number, motion)
        pose = {key: values.pop(key) for key in ("x", "theta") if key in values}
        motions.append(motion._replace(pose=motion.pose._replace(**pose), **values))
    return motions


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda _, each: {}, ""),
        (lambda _, each: {"theta": math.remainder(each.pose.theta, math.tau)}, ""),
        (
            lambda _, each: {"speed": 0.1 * each.speed},
            f"{MOVES} 0.1 m ahead, which is 1 m/s; the twist says 0.1 m/s",
        ),
        (
            lambda _, each: {"turn_rate": 0.5 * each.turn_rate},
            f"{MOVES} 0.05 rad counter-clockwise, which is 0.5 rad/s; the twist says 0.25 rad/s",
        ),
        (lambda _, each: {"lateral_speed": 0.1}, " m to the left, which is "),
        (lambda _, each: {"lateral_speed": -0.1}, " m/s; the twist says -0.1 m/s"),
        (lambda _, each: {"theta": each.pose.theta + 0.1}, " m to the left, which is -0.0998334"),
        (lambda k, each: {"x": each.pose.x - 3.0 * (k > 0)}, " m to the left, which is "),
    ],
)
def test_odometry(change, fault):
    faults = odometry_faults(changed(change), 2 * TENTH, 1e-9, 1e-9)
    assert bool(faults) == bool(fault)
    assert fault in "".join(faults[:1])


@pytest.mark.parametrize(
    "motions", [[], MOTIONS[:1], [MOTIONS[0], MOTIONS[0]], MOTIONS[::-1], MOTIONS[::3]]
)
def test_odometry_that_cannot_be_compared(motions):
    (fault,) = odometry_faults(motions, 2 * TENTH, 1e-9, 1e-9)
    assert fault.startswith("odometry not judged: ")
    assert fault.endswith(" received; expected at least two with stamps up to 0.2 s apart")


def test_odometry_where_a_turn_begins():
    """While the turn rate rises evenly, the heading goes by the square of the time."""
    headings = [0.05 * ((k + 0.5) / 1000) ** 2 for k in range(1000)]
    x = sum(map(math.cos, headings)) * 1e-4
    y = sum(map(math.sin, headings)) * 1e-4
    begin = Motion(0, Pose(0.0, 0.0, 0.0), 1.0, 0.0, 0.0)
    end = Motion(TENTH, Pose(x, y, 0.05), 1.0, 0.0, 1.0)
    assert odometry_faults([begin, end], TENTH, 1e-5, 1e-6) == []


@pytest.mark.parametrize(
    ("pose", "angle", "fault"),
    [
        ((1.0, 2.1, -math.pi), 0.1, ""),
        ((1.0, 2.1, 0.0), None, ""),
        ((1.0, 2.0, 0.0), 0.1, " is 0 m and 3.14 rad from (1.0000 m, 2.0000 m"),
        ((1.3, 2.0, math.pi), 0.1, "0.3 m and 0 rad from (1.0000 m, 2.0000 m, 3.1416 rad); "),
        ((1.3, 2.0, math.pi), 0.1, "; tolerance 0.2 m and 0.1 rad"),
        ((1.3, 2.0, math.pi), None, "; tolerance 0.2 m"),
    ],
)
def test_pose(pose, angle, fault):
    found = pose_fault(Pose(*pose), Pose(1.0, 2.0, math.pi), 0.2, angle)
    assert bool(found) == bool(fault) and fault in found


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


INPUTS = {"joystick": "/joy", "teleop": "/key"}
RIGHT = [{"send": ["joystick", "teleop"], "wins": "teleop"}, {"send": [], "wins": "idle"}]


def test_steps():
    inputs, steps = parse_steps({"inputs": INPUTS, "steps": RIGHT, "output": "/output"})
    assert inputs == INPUTS
    assert steps == [
        Step("step 1 (send: [joystick, teleop])", ["joystick", "teleop"], "teleop"),
        Step("step 2 (send: [])", [], "idle"),
    ]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"inputs": {}}, "~inputs is {}; expected {name: topic, ...}"),
        ({"inputs": "/joy"}, "~inputs is '/joy'; expected {name: topic, ...}"),
        ({"inputs": {"a": 3}, "steps": [{"send": [], "wins": "a"}]}, "~inputs/a is 3; expected"),
        ({"steps": []}, "~steps is []; expected a list of {send: [name, ...], wins: name}"),
        ({"steps": [*RIGHT, 3]}, "~steps[3]/wins is not set; expected one of joystick, teleop, id"),
        ({"steps": [{"send": [], "wins": "x"}]}, "~steps[1]/wins is 'x'; expected one of"),
        ({"steps": [{"send": ["x"], "wins": "idle"}]}, "~steps[1]/send is ['x']; expected a list"),
        ({"steps": [{"send": [[]], "wins": "idle"}]}, "~steps[1]/send is [[]]; expected a list"),
    ],
)
def test_steps_that_are_wrong(values, message):
    with pytest.raises(ParameterError) as caught:
        parse_steps({"inputs": INPUTS, "steps": RIGHT, **values})
    assert message in str(caught.value)
