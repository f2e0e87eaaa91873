"""Recording: the rows and the start pose of a drive."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.authoring.recorder import Recording
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.plan.plan import as_float32
from mushr_ros_intro.plan.write import plan_text
from mushr_ros_intro.preview.prediction import rest
from mushr_ros_intro.stamps import STAMP_TOLERANCE

MS = 1_000_000
"""[ns]"""

T0 = 1_000_000 * MS
"""The instant from which the tests count [ns]: a stamp of 0 has a meaning of its own."""

CAR = Car()
START = Pose(1.0, -2.0, 0.7)

REPLAY_TOLERANCE = 1e-9
"""[m, rad] Between a drive and its replay: the same arcs, divided differently."""


def record(events, tolerance=STAMP_TOLERANCE):
    """Return a recording of events such as "pose 40 7; drive 100 1 0.3 @ 250".

    Each has a stamp [ms]; a pose and an initial pose ("place") have an x [m], and a command may
    have a speed and a steering angle; an arrival [ms] other than the stamp follows "@".
    """
    recording = Recording(CAR.command_timeout, tolerance)
    for event in events.split(";"):
        text, _, arrival = event.partition("@")
        kind, stamp, *values = text.split()
        now = T0 + int(arrival or stamp) * MS
        stamp = T0 + int(stamp) * MS
        numbers = [float(each) for each in values]
        if kind == "drive":
            recording.add_command(Command(stamp, *(numbers or (1.0, 0.0))), now)
        elif kind == "pose":
            recording.add_pose(stamp, Pose(*numbers, 0.0, 0.0), now)
        else:
            recording.place(InitialPose(stamp, Pose(*numbers, 0.0, 0.0)), now)
    return recording


def rows(plan):
    """Return (speed, steering angle, duration [ms]) of each row."""
    return [(row.speed, row.steering_angle, row.duration / MS) for row in plan.rows] if plan else []


@pytest.mark.parametrize(
    "commands, expected",
    [
        ("", []),
        # A row for every change; the last command is valid for 200 ms.
        ("drive 0 1 0; drive 100 1 0; drive 200 1 0.3", [(1, 0, 200), (1, 0.3, 200)]),
        ("drive 0 1 0.3; drive 150 -1 0.3; drive 200 0 0", [(1, 0.3, 150), (-1, 0.3, 50)]),
        # Nothing while the car stands, except steering before it drives.
        ("drive 0 0 0; drive 100 0 0", []),
        ("drive 0 0 0.3", []),
        ("drive 0 0 0; drive 500 1 0.1; drive 600 0 0; drive 900 0 0", [(1, 0.1, 100)]),
        ("drive 0 0 0.3; drive 100 1 0.3", [(0, 0.3, 100), (1, 0.3, 200)]),
        # A gap, and the mux's own stop before a pause of 10 s.
        (
            "drive 0 1 0.1; drive 150 1 0.1; drive 900 1 0",
            [(1, 0.1, 350), (0, 0.1, 550), (1, 0, 200)],
        ),
        (
            "drive 0 1 0; drive 200 0 0; drive 10200 -1 0",
            [(1, 0, 200), (0, 0, 10000), (-1, 0, 200)],
        ),
        ("drive 0 1 0.1; drive 200 1 0.1", [(1, 0.1, 400)]),
        # A stop that comes after the last command has expired, and one without a valid stamp that
        # comes before a late command.
        (
            "drive 0 1 0.1; drive 204 0 0; drive 900 1 0",
            [(1, 0.1, 200), (0, 0.1, 700), (1, 0, 200)],
        ),
        (
            "drive 0 1 0.1; drive -5000 0 0 @ 250; drive 150 1 0.1 @ 260; drive 340 1 0",
            [(1, 0.1, 340), (1, 0, 200)],
        ),
        # Of commands with the same stamp the last one counts.
        ("drive 0 1 0.1; drive 0 2 0.2", [(2, 0.2, 200)]),
        ("drive 0 1 0.1; drive 100 2 0; drive 100 0.5 0", [(1, 0.1, 100), (0.5, 0, 200)]),
        # A late command is inserted at its stamp, also before the first one.
        ("drive 100 1 0; drive 200 0 0; drive 0 2 0 @ 900", [(2, 0, 100), (1, 0, 100)]),
    ],
)
def test_rows(commands, expected):
    assert rows(record("pose 0 5;" + (commands or "pose 1 5")).plan()) == expected


commands = st.tuples(
    st.integers(0, 400),
    st.sampled_from([0.0, 1.0, 2.0, -1.5]),
    st.sampled_from([0.0, 0.3, -0.1]),
    st.integers(-900, 900),
)


@given(st.lists(commands, min_size=1, max_size=30))
def test_the_replay_ends_where_the_drive_ended(steps):
    """Commands some [ms] apart, each delivered early or late, to the car and to the recorder."""
    stamp, drive = T0, []
    for pause, speed, angle, late in steps:
        stamp += pause * MS
        drive.append((stamp + late * MS, Command(stamp, as_float32(speed), as_float32(angle))))
    recording = Recording(CAR.command_timeout, STAMP_TOLERANCE)
    recording.add_pose(T0 - 1, START, T0 - 1)
    history = History(CAR, at_rest(0, START))
    for arrival, command in sorted(drive, key=lambda each: each[0]):
        assert recording.add_command(command, arrival)
        history.add(command, arrival)
    end = history.state_at(stamp + 10_000 * MS).pose
    plan = recording.plan()
    if plan is None:
        assert end == START
        return
    assert plan.rows[-1].speed != 0.0
    for each in (plan, parse_plan(plan_text(START, plan.rows).encode(), "recorded.txt")):
        assert math.dist(rest(each, CAR)[1], end) < REPLAY_TOLERANCE


STANDING = "pose -40 5; pose -20 5; "
DRIVE = "drive 100; drive 200"
"""Lasts 300 ms."""


@pytest.mark.parametrize(
    "events, x, duration, is_exact",
    [
        (STANDING + DRIVE, 5.0, 300, True),
        # The last pose at or before the first command, whatever arrives first.
        ("pose 99 5; pose 100 7; pose 101 9;" + DRIVE, 7.0, 300, False),
        (DRIVE + "; pose 90 7 @ 220", 7.0, 300, True),
        (STANDING + DRIVE + "; pose 90 5 @ 220", 5.0, 300, True),
        (STANDING + DRIVE + "; pose 90 7 @ 220; pose 210 8", 7.0, 300, False),
        (STANDING + "pose 70 7;" + DRIVE + "; drive 50 @ 300", 5.0, 350, True),
        # No pose, or none before the first command: the drive begins later.
        (DRIVE, None, None, False),
        (DRIVE + "; pose 110 7 @ 220", 7.0, 200, False),
        ("drive 100; pose 1200 7; drive 1300", 7.0, 200, True),
        # After an initial pose older events do not count, whatever arrives first.
        (STANDING + "place 0 7;" + DRIVE, None, None, False),
        (STANDING + "place 0 7;" + DRIVE + "; pose 90 7 @ 220", 7.0, 300, True),
        (STANDING + "place 0 7; pose 10 5; pose 90 7;" + DRIVE, 7.0, 300, True),
        (STANDING + "place 0 7; pose 10 5; pose 90 8;" + DRIVE, 8.0, 300, False),
        ("pose 100 7;" + DRIVE + "; place 100 7 @ 220", 7.0, 300, True),
        ("pose 0 5; pose 150 7;" + DRIVE + "; place 150 7 @ 220", 7.0, 200, True),
        ("place 50 7 @ 10; pose 49 5; drive 60; pose 70 7; drive 100", 7.0, 200, False),
        ("place 50 7 @ 10; pose 49 5; drive 49; pose 60 7;" + DRIVE, 7.0, 300, True),
    ],
)
def test_start(events, x, duration, is_exact):
    recording = record(events)
    plan = recording.plan()
    assert (plan and plan.start) == (x and (x, 0.0, 0.0))
    assert sum(each[2] for each in rows(plan)) == (duration or 0)
    assert recording.is_start_exact == is_exact
    assert (recording.begin is None) == (x is None)


def test_commands_dropped_without_a_pose():
    """They are kept as long as a pose from before them may arrive."""
    recording = record("drive 100")
    stamp = T0 + 100 * MS + STAMP_TOLERANCE
    assert recording.add_command(Command(stamp, 0.0, 0.0), stamp)
    recording.add_pose(stamp, START, stamp)
    assert not recording.add_command(Command(stamp + 1, 1.0, 0.0), stamp + 1)
    for now in range(stamp + 2, stamp + 2 * STAMP_TOLERANCE, 100 * MS):
        assert recording.add_command(Command(now, 0.0, 0.0), now)
    assert recording.begin == stamp + 1


@pytest.mark.parametrize(
    "stamp, ended, after", [(0, 0, 300), (100, 0, 300), (150, 200, 200), (500, 300, 0)]
)
def test_place_returns_the_drive_that_it_ends(stamp, ended, after):
    recording = record(STANDING + DRIVE)
    plan = recording.place(InitialPose(T0 + stamp * MS, START), T0 + 600 * MS)
    assert sum(each[2] for each in rows(plan)) == ended
    recording.add_pose(T0 + stamp * MS, START, T0 + 600 * MS)
    assert sum(each[2] for each in rows(recording.plan())) == after


def test_the_start_pose_is_kept_as_long_as_it_can_be_needed():
    """While the car waits, while it drives, and for a command that is late."""
    recording = Recording(CAR.command_timeout, STAMP_TOLERANCE)

    def report(*span):
        for now in range(*(T0 + each * MS for each in span), MS):
            recording.add_pose(now, Pose(float(now), 0.0, 0.0), now)

    report(0, 3000)
    for stamp in (2900, 2100):
        recording.add_command(Command(T0 + stamp * MS, 1.0, 0.0), T0 + 3000 * MS)
        assert recording.plan().start.x == T0 + stamp * MS
        assert not recording.is_start_exact
    report(3000, 6000)
    assert recording.plan().start.x == T0 + 2100 * MS


@pytest.mark.parametrize(
    "tolerance, duration", [(STAMP_TOLERANCE, 300), (60 * STAMP_TOLERANCE, 10200)]
)
def test_implausible_stamps_mean_the_arrival(tolerance, duration):
    late = "place 0 7 @ 40000; pose 50 7 @ 40000; drive 100 @ 40000; drive 10100 @ 40100"
    assert sum(each[2] for each in rows(record(late, tolerance).plan())) == duration
