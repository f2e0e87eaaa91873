"""Check the verdicts on computed drives of controllers."""

import math

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose, compose, curvature, drive_arc, inverse
from mushr_ros_intro.replay.following import FOLLOW_CHECK_NAMES, judge_drive
from mushr_ros_intro.replay.recording import Sent
from mushr_ros_intro.replay.reference import read_references, resampled
from support import recorded
from support.geometry import float32
from support.paths import CHECKOUT

REFERENCES = read_references(
    ["line", "circle", "wave", "left_turn", "saw", "figure_8", "closed_figure_8"],
    f"{CHECKOUT}/plans",
)
STEP = 10_000_000
SECOND = 1_000_000_000


def drive(name, offset=0.0, part=1.0, speed=2.0, angles=(0.1,), **changes):
    """Return a drive on a part of a path, `offset` to the left of it [m], 100 poses per second."""
    reference = REFERENCES[name]
    path = resampled(np.array(reference.poses), speed / 100.0)
    path = path[: max(1, round(part * len(path)))]
    x, y, theta = path.T
    poses = np.column_stack([x - offset * np.sin(theta), y + offset * np.cos(theta), theta])
    poses = np.vstack([np.repeat(poses[:1], 50, axis=0), poses, np.repeat(poses[-1:], 50, axis=0)])
    stamps = recorded.BEGIN + STEP * np.arange(len(poses))
    sent = [
        Sent(int(stamp), False, speed, float32(angles[index % len(angles)]), int(stamp), 0)
        for index, stamp in enumerate(stamps[50:-50:5])
    ]
    seen = recorded.replay(sent=sent, grid=None, stamps=stamps, poses=poses)
    return seen._replace(plan=reference, start=reference.start, **changes)


def failed(seen, **tolerances):
    """Return the messages of the failed checks, by name."""
    judgement = judge_drive(seen, tolerances)
    assert tuple(each.name for each in judgement.checks) == FOLLOW_CHECK_NAMES
    return {each.name: each.message for each in judgement.checks if not each.passed}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_drive_on_the_path(name):
    """Also if the path crosses itself, or ends where it began."""
    exact = {"path": 0.05, "cross_track": 0.011, "rms": 0.006, "position": 1e-3}
    assert failed(drive(name), **exact) == {}


def test_a_car_that_drives_beyond_the_end_of_a_closed_path():
    """The start of the path is nearer to it than the end, but does not count as the nearest."""
    seen = drive("closed_figure_8")
    begin, beyond = seen.poses[:50], seen.poses[51:61]
    seen.poses[-50:] = np.vstack([beyond, np.repeat(beyond[-1:], 40, axis=0)])
    assert math.dist(seen.poses[-1, :2], begin[0, :2]) == pytest.approx(0.2, abs=0.01)
    assert failed(seen) == {}


def test_a_drive_beside_a_path_that_crosses_itself():
    """Where the car crosses the other part of the path, it does not count as being there."""
    found = judge_drive(drive("closed_figure_8", 0.1), {}).drive
    assert found.distances == pytest.approx(0.1, abs=0.01)


def test_a_car_that_drives_back_for_a_while():
    """It is beside the path as if it drove forward."""
    seen = drive("line")
    back = seen.poses[200:180:-1]  # 0.4 m
    poses = np.vstack([seen.poses[:200], back, seen.poses[180:]])
    stamps = recorded.BEGIN + STEP * np.arange(len(poses))
    exact = {"cross_track": 0.011, "rms": 0.011}
    assert failed(seen._replace(poses=poses, stamps=stamps), **exact) == {}


def test_a_drive_beside_the_path():
    assert failed(drive("line", 0.19)) == {}
    messages = failed(drive("line", 0.25))
    assert messages == {
        "cross_track": "the distance from the path is at most 0.250 m, rms 0.250 m; "
        "tolerances 0.4 m and 0.2 m"
    }
    assert set(failed(drive("line", 0.55))) == {
        *("path", "cross_track", "final_pose", "time", "smoothness")
    }


def test_half_a_drive_proves_nothing():
    messages = failed(drive("wave", part=0.5))
    assert set(messages) == {"path", "cross_track", "final_pose", "time", "smoothness"}
    assert messages["time"] == "the car did not stop at the end of the path"
    assert "6.2" in messages["final_pose"] or "6.3" in messages["final_pose"]


def test_no_command():
    judgement = judge_drive(drive("line", part=0.0)._replace(sent=(), outcome="it hangs"), {})
    assert [each.name for each in judgement.checks if each.is_judged] == ["node"]
    assert (judgement.checks[0].passed, judgement.checks[0].message) == (False, "it hangs")
    assert judgement.checks[1].message == "not judged: the node sent no command"


def test_no_command_but_other_actions():
    """What the node did is judged; the other checks are not."""
    seen = drive("line", part=0.0, actions=("sends commands on /other",))._replace(sent=[])
    judged = [each for each in judge_drive(seen, {}).checks if each.is_judged]
    assert [each.name for each in judged] == ["node", "topics"]
    assert "sends commands on /other" in judged[1].message


def test_a_slow_drive():
    assert failed(drive("line", speed=0.5))["time"] == (
        "the drive takes 20.00 s; the path 5.00 s, at most 12.50 s allowed"
    )
    assert failed(drive("line", speed=0.5), time=3.1) == {}


def test_a_shaking_wheel():
    """Two angles in turn, every 0.05 s: 0.2 rad / 0.05 s, which MuSHR's servo cannot follow."""
    message = failed(drive("line", angles=(0.11, -0.11)))["smoothness"]
    assert message.startswith("the mean steering rate is 4.40 rad/s, tolerance 3.2 rad/s")
    assert failed(drive("line", angles=(0.11, -0.11)), steering_rate=4.5) == {}


def controlled(name, control, order=1, period=5 * STEP):
    """Return the drive of a pure pursuit, changed by `control`, which an ideal car obeys.

    Args:
        name: of the path.
        control: returns the speed [m/s] and the steering angle [rad], given the right angle.
        order: -1 for a controller that has the points of the path in reverse order.
        period: of the commands [ns].
    """
    reference, car, index = REFERENCES[name], Car(), 0
    points, pose, sent, poses = reference.poses[::order], reference.start, [], []
    stamps = np.arange(recorded.BEGIN, recorded.BEGIN + 3 * reference.duration, STEP)
    for stamp in stamps.tolist():
        while index < len(points) - 1 and pose.distance_to(points[index]) < 0.8:
            index += 1
        ahead = compose(inverse(pose), points[index])
        if (stamp - recorded.BEGIN) % period == 0:
            angle = math.atan2(2.0 * car.wheelbase * ahead.y, ahead.x**2 + ahead.y**2)
            speed, angle = control(max(-0.34, min(0.34, angle)))
            if index == len(points) - 1 and ahead.x < 0.1:
                break
            sent.append(Sent(stamp, False, speed, float32(angle), stamp, 0))
        pose = drive_arc(pose, speed * STEP / SECOND, curvature(angle, car.wheelbase))
        poses.append(pose)
    poses += 50 * [pose]
    stamps = recorded.BEGIN + STEP * np.arange(1, len(poses) + 1)
    seen = recorded.replay(sent=sent, grid=None, stamps=stamps, poses=np.array(poses))
    return seen._replace(plan=reference, start=reference.start)


@pytest.mark.parametrize("name", ["circle", "wave"])
def test_smooth_and_full_lock(name):
    """A good controller has 0.3 rad/s; one with only two angles, at 10 Hz or more, is refused."""
    assert failed(controlled(name, lambda angle: (2.0, angle)), steering_rate=0.5) == {}
    for period in (5 * STEP, 10 * STEP):
        full_lock = controlled(name, lambda angle: (2.0, math.copysign(0.34, angle)), period=period)
        assert set(failed(full_lock)) == {"smoothness"}


AWAY = "until the car is 0.4 m from the path, 100% of the commands steer away from it: a positive"


@pytest.mark.parametrize(
    ("name", "control", "order", "expected"),
    [
        *((name, lambda angle: (2.0, -angle), 1, [AWAY]) for name in ("wave", "left_turn")),
        *((name, lambda angle: (2.0, angle), -1, [AWAY]) for name in ("left_turn", "saw")),
        ("closed_figure_8", lambda angle: (2.0, angle), -1, [AWAY]),
        ("line", lambda angle: (-2.0, angle), 1, ["the car drives backward at first; the path le"]),
        ("wave", lambda angle: (2.0, 0.1 * angle), 1, []),
        ("left_turn", lambda angle: (2.0, 0.0), 1, []),
        ("saw", lambda angle: (2.0, angle), 1, []),
        ("wave", lambda angle: (2.0, angle), 1, []),
        ("line", lambda angle: (0.0, angle), 1, ["the node sent only stops"]),
        ("wave", lambda angle: (2.0, math.degrees(angle)), 1, ["most steering angles are larger "]),
    ],
)
def test_a_mistake_is_named(name, control, order, expected):
    """Nothing is said of a controller that only is too weak, or too slow in sharp turns."""
    notes = judge_drive(controlled(name, control, order), {}).notes
    assert [note[: len(text)] for note, text in zip(notes, expected)] == expected
    assert len(notes) == len(expected), notes


@pytest.mark.parametrize(("period", "seconds"), [(100, "1"), (25, "0.25"), (20, "")])
def test_a_slow_controller(period, seconds):
    """A command is valid for 0.2 s."""
    notes = judge_drive(controlled("line", lambda _: (2.0, 0.0), period=period * STEP), {}).notes
    expected = f"the commands come every {seconds} s, but each is valid for 0.2 s: the car stops"
    assert [note[: len(expected)] for note in notes] == ([expected] if seconds else [])


def test_a_single_command():
    """There is no rate."""
    seen = drive("line")
    assert failed(seen._replace(sent=seen.sent[:1])) == {}


def test_a_short_deviation():
    """It hardly counts in the root mean square."""
    seen = drive("line")
    seen.poses[200:204, 1] = 0.5
    assert failed(seen)["cross_track"].startswith("the distance from the path is at most 0.500 m,")


def test_collisions_and_other_actions():
    seen = drive("line", collisions=(Pose(1, 0, 0),), actions=("jumps",), ignored="a message")
    messages = failed(seen)
    assert set(messages) == {"topics", "map"}
    assert messages["map"].startswith("the car hit a wall at (1.0000 m, 0.0000 m,")
    assert judge_drive(seen, {}).notes == ("the car ignored a message",)
    lacks = drive("line")._replace(outcome="it ended:\nModuleNotFoundError: No module named 'x'")
    assert judge_drive(lacks, {}).notes[0].startswith("the module x is neither in the node's files")


def test_the_nearest_point_is_near_along_the_path():
    """The circle ends 0.5 m before its start: the first pose is not at its end.

    The drive begins and ends with a move, and not when the car stands.
    """
    seen = drive("circle")
    found = judge_drive(seen, {}).drive
    assert len(found.driven) == len(seen.poses) - 100
    assert found.predicted[0] == pytest.approx([0, 0, 0], abs=0.02)
    assert math.dist(found.predicted[-1][:2], found.driven[-1][:2]) < 0.02


def test_a_controller_that_never_moves():
    """Also if the tolerance covers the whole path."""
    seen = drive("wave", part=0.0)
    seen = seen._replace(sent=(Sent(recorded.BEGIN, True, 0.0, 0.0, recorded.BEGIN, 0),))
    assert {"time", "smoothness"} <= set(failed(seen, position=1000.0))
