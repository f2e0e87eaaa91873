"""What is recorded of a drive: rows that the car follows to where the drive ended."""

import math

import pytest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.authoring.recording import Recording
from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.plan.model import Plan, as_float32
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.prediction import final_pose
from mushr_ros_intro.sim.stamps import STAMP_TOLERANCE
from support.fake_ros import Ros
from support.helpers import module

MS = 1_000_000
"""[ns]"""

CAR = Car()
START = Pose(1.0, -2.0, 0.7)

REPLAY_TOLERANCE = 1e-9
"""[m, rad] Between a drive and its replay: the same arcs, cut elsewhere."""


def recorded(*commands):
    """Return the rows (speed, angle, duration [ms]) of commands (at [ms], speed, angle)."""
    recording = Recording(CAR.command_timeout)
    for at, speed, angle in commands:
        recording.add(Command(at * MS, speed, angle), at * MS)
    return [(row.speed, row.steering_angle, row.duration / MS) for row in recording.rows()]


def test_every_change_becomes_a_row():
    drive = [(1000 + 100 * k, 1.0, 0.0 if k < 3 else 0.3) for k in range(6)]
    assert recorded(*drive) == [(1.0, 0.0, 300.0), (1.0, 0.3, 400.0)]
    assert recorded(*drive, (1550, -1.0, 0.3), (1600, 0.0, 0.0)) == [
        (1.0, 0.0, 300.0),
        (1.0, 0.3, 250.0),
        (-1.0, 0.3, 50.0),
    ]


def test_nothing_is_recorded_while_the_car_stands():
    assert recorded() == []
    assert recorded((0, 0.0, 0.0), (100, 0.0, 0.0)) == []
    assert recorded((0, 0.0, 0.3)) == []
    stop = (0.0, 0.0)
    assert recorded((0, *stop), (500, 1.0, 0.1), (600, *stop), (900, *stop)) == [(1.0, 0.1, 100.0)]
    assert recorded((0, 0.0, 0.3), (100, 1.0, 0.3)) == [(0.0, 0.3, 100.0), (1.0, 0.3, 200.0)]


def test_a_gap_becomes_a_stop():
    assert recorded((0, 1.0, 0.1), (150, 1.0, 0.1), (1000, 1.0, 0.1)) == [
        (1.0, 0.1, 350.0),
        (0.0, 0.1, 650.0),
        (1.0, 0.1, 200.0),
    ]
    # The mux's own stop, 0.2 s after the last command, and a pause of 10 s.
    assert recorded((0, 1.0, 0.1), (200, 0.0, 0.0), (10200, -1.0, 0.0)) == [
        (1.0, 0.1, 200.0),
        (0.0, 0.0, 10000.0),
        (-1.0, 0.0, 200.0),
    ]
    # A command at the very end of the last one leaves none.
    assert recorded((0, 1.0, 0.1), (200, 1.0, 0.1)) == [(1.0, 0.1, 400.0)]


def test_of_commands_with_the_same_stamp_the_last_one_counts():
    assert recorded((0, 1.0, 0.1), (0, 2.0, 0.2)) == [(2.0, 0.2, 200.0)]
    assert recorded((0, 1.0, 0.1), (100, 2.0, 0.0), (100, 0.5, 0.0), (2000, 0.0, 0.0)) == [
        (1.0, 0.1, 100.0),
        (0.5, 0.0, 200.0),
    ]


def test_begin():
    recording = Recording(CAR.command_timeout)
    assert recording.begin is None
    recording.add(Command(1000 * MS, 0.0, 0.0), 1000 * MS)
    assert recording.begin is None
    recording.add(Command(1500 * MS, 1.0, 0.0), 1500 * MS)
    assert recording.begin == 1500 * MS
    recording.add(Command(1400 * MS, 1.0, 0.0), 1500 * MS)  # late
    assert recording.begin == 1400 * MS
    for at in range(1600, 9000, 100):
        recording.add(Command(at * MS, 1.0, 0.0), at * MS)
        assert recording.begin == 1400 * MS


def test_forget_until():
    recording = Recording(CAR.command_timeout)
    for at in range(0, 5000, 100):
        recording.add(Command(at * MS, 1.0, 0.0), at * MS)
    recording.forget_until(4700 * MS)
    assert recording.begin == 4700 * MS
    recording.forget_until(4750 * MS)
    assert recording.begin == 4800 * MS
    assert [row.duration for row in recording.rows()] == [300 * MS]


def test_a_long_drive_takes_no_room():
    recording = Recording(CAR.command_timeout)
    for at in range(0, 100_000, 100):
        recording.add(Command(at * MS, 1.0, 0.0), at * MS)
    assert len(recording._changes) == 1 and len(recording._recent) <= 12


commands = st.tuples(
    st.integers(0, 400),
    st.sampled_from([0.0, 1.0, 2.0, -1.5]),
    st.sampled_from([0.0, 0.3, -0.1]),
    st.integers(-900, 900),
)


@given(st.lists(commands, min_size=1, max_size=30))
def test_the_replay_ends_where_the_drive_did(steps):
    """Commands some [ms] after one another, each delivered early or late, to car and recorder."""
    now, drive = 10_000 * MS, []
    for pause, speed, angle, late in steps:
        now += pause * MS
        drive.append((now + late * MS, Command(now, as_float32(speed), as_float32(angle))))
    recording = Recording(CAR.command_timeout)
    history = History(CAR, at_rest(0, START))
    for arrival, command in sorted(drive, key=lambda each: each[0]):
        recording.add(command, arrival)
        history.add(command, arrival)
    end = history.state_at(now + 10_000 * MS).pose
    rows = recording.rows()
    if not rows:
        assert end == START
        return
    assert rows[-1].speed != 0.0
    for plan in (
        Plan("", START, rows),
        parse_plan(plan_text(START, rows).encode(), "recorded.txt"),
    ):
        replayed = final_pose(plan, CAR)
        assert math.dist(replayed, end) < REPLAY_TOLERANCE


def message(kind, stamp, x=0.0):
    """Return a command to drive, or where the car is or is placed."""
    msg = kind()
    msg.header.stamp.secs, msg.header.stamp.nsecs = divmod(stamp, 1000 * MS)
    if kind is AckermannDriveStamped:
        msg.drive.speed = 1.0
        return msg
    msg.header.frame_id = "map"
    pose = msg.pose if kind is PoseStamped else msg.pose.pose
    pose.position.x, pose.orientation.w = x, 1.0
    return msg


@pytest.mark.parametrize(
    "pose, later, duration",
    [
        (None, 0, None),  # it may still come
        (90 * MS, 0, 300 * MS),
        (110 * MS, 0, 200 * MS),  # of the second command; where the first began is not known
        (None, STAMP_TOLERANCE + 110 * MS, None),
    ],
)
def test_a_pose_that_comes_after_the_first_command(monkeypatch, tmp_path, pose, later, duration):
    """The car is placed, and its pose from there is slower than the command after it."""
    ros = Ros(monkeypatch)
    begin, warnings = ros.now, []
    monkeypatch.setattr("rospy.logwarn_throttle", lambda _, text: warnings.append(text))
    recorder = module("plan_recorder.py").PlanRecorder()
    recorder._folder = str(tmp_path)
    recorder._on_pose(message(PoseStamped, begin - 20 * MS, x=5.0))
    recorder._on_placement(message(PoseWithCovarianceStamped, begin, x=7.0))
    recorder._on_command(message(AckermannDriveStamped, begin + 100 * MS))
    assert not warnings
    if pose:
        recorder._on_pose(message(PoseStamped, begin + pose, x=7.0))
    ros.now += later
    recorder._on_command(message(AckermannDriveStamped, begin + 200 * MS))
    answer = recorder._on_save(None)
    is_given_up = bool(later) or duration == 200 * MS
    unknown = "not recording: /car//car/car_pose has not said where the car is"
    assert warnings == [unknown] * is_given_up
    assert answer.success == bool(duration), answer.message
    if duration:
        plan = parse_plan((tmp_path / "recorded.txt").read_bytes(), "recorded.txt")
        assert plan.start == (7.0, 0.0, 0.0)
        assert [row.duration for row in plan.rows] == [duration]
    else:
        why = "the car has not been driven" if later else "has not said where the car was when"
        assert why in answer.message
