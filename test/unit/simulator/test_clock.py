"""Test how far the simulated clock may run."""

import pytest

from mushr_ros_intro.car.model import Command, InitialPose
from mushr_ros_intro.geometry import ORIGIN
from mushr_ros_intro.simulator.clock import (
    CLOCK_PATIENCE,
    CLOCK_PATIENCE_AT_REST,
    LONG_STEP,
    MAX_PERIOD,
    MIN_CLOCK_PATIENCE,
    Stream,
    first_report,
)
from mushr_ros_intro.simulator.sim_clock import shown
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

SECOND = NANOSECONDS
REPORT = 7 * SECOND
"""When the car reports an initial pose in these tests [ns]."""


def listen(*events, lock_step=True, stream=None):
    """Return the stream of (event, clock [ns], wall [s])."""
    stream = stream or Stream()
    for event, clock, wall in events:
        stream = stream.on_event(event, clock, wall, REPORT, lock_step)
    return stream


def now(*events, stream=None):
    """Return the stream of events that are stamped with the present."""
    return listen(*((event, event.stamp, 0.0) for event in events), stream=stream)


def go(stamp):
    return Command(stamp, 1.0, 0.1)


def stop(stamp):
    return Command(stamp, 0.0, 0.0)


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_stamp_ahead_of_the_clock_is_a_promise(lock_step):
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0), lock_step=lock_step)
    assert stream.holds(0.0) and stream.limit == 5 * SECOND
    stream = listen((go(6 * SECOND), 5 * SECOND, 1.0), lock_step=lock_step, stream=stream)
    assert stream.holds(1.0) and stream.limit == 6 * SECOND


def test_a_stamp_of_the_present_allows_one_period_in_lock_step_only():
    stream = now(go(5 * SECOND))
    assert stream.holds(0.0) and stream.limit == 5 * SECOND + COMMAND_PERIOD
    event = (go(5 * SECOND), 5 * SECOND, 0.0)
    assert not listen(event, lock_step=False).holds(0.0)
    promise = listen((go(5 * SECOND), 4 * SECOND, 0.0), lock_step=False)
    assert not listen((go(6 * SECOND), 6 * SECOND, 0.0), lock_step=False, stream=promise).holds(0.0)


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_late_command_changes_no_limit_but_renews_the_wait(lock_step):
    stream = listen(
        (go(5 * SECOND), 4 * SECOND, 0.0), (go(4 * SECOND), 4 * SECOND, 0.5), lock_step=lock_step
    )
    assert stream.limit == 5 * SECOND
    assert stream.holds(0.5 + CLOCK_PATIENCE) and not stream.holds(0.51 + CLOCK_PATIENCE)


def test_a_promise_that_is_repeated_when_it_is_due_is_a_stamp_of_the_present():
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0), (go(5 * SECOND), 5 * SECOND, 0.0))
    assert stream.limit == 5 * SECOND + COMMAND_PERIOD


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("period", [SECOND // 5, SECOND])
def test_the_period_is_learned_from_two_equal_steps(period, times):
    """Also if each command is sent twice."""
    stamps = [5 * SECOND + k * period for k in range(3) for _ in range(times)]
    stream = now(*map(go, stamps[: -times or None]))
    assert stream.limit == stamps[-times - 1] + COMMAND_PERIOD
    assert now(go(stamps[-1]), stream=stream).limit == 5 * SECOND + 3 * period


def test_a_short_period_is_learned_too_and_a_dropped_command_changes_none():
    stamps = [5 * SECOND + k * SECOND // 50 for k in range(8)]
    assert now(*map(go, stamps)).limit == stamps[-1] + SECOND // 50
    stamps = [5 * SECOND + k * SECOND // 5 for k in (0, 1, 2, 4)]
    assert now(*map(go, stamps)).limit == stamps[-1] + SECOND // 5


@pytest.mark.parametrize("late, is_equal", [(10, True), (40, False)])
def test_steps_are_equal_within_a_tenth(late, is_equal):
    stamps = [stamp * SECOND // 1000 for stamp in (5000, 5250, 5500 + late)]
    step = (250 + late) * SECOND // 1000
    assert now(*map(go, stamps)).limit == stamps[-1] + (step if is_equal else COMMAND_PERIOD)


def test_a_long_gap_resets_the_patience_and_a_longer_one_the_period():
    stamps = [5 * SECOND + k * SECOND // 5 for k in range(3)]
    impatient = now(*map(go, stamps)).expire()
    for gap, period, patience in (
        (LONG_STEP, SECOND // 5, CLOCK_PATIENCE / 2),
        (LONG_STEP + 1, SECOND // 5, CLOCK_PATIENCE),
        (MAX_PERIOD, SECOND // 5, CLOCK_PATIENCE),
        (MAX_PERIOD + 1, COMMAND_PERIOD, CLOCK_PATIENCE),
    ):
        stream = now(go(stamps[-1] + gap), stream=impatient)
        assert stream.limit == stamps[-1] + gap + period
        assert stream.wait == patience


def test_a_stop_by_the_mux_has_no_effect():
    """It comes twice as late as the next command would."""
    stream = now(go(5 * SECOND))
    assert now(stop(5 * SECOND + 2 * COMMAND_PERIOD), stream=stream) == stream
    placed = listen((InitialPose(5 * SECOND, ORIGIN), 5 * SECOND, 0.0))
    assert listen((stop(5 * SECOND), 5 * SECOND, 1.0), stream=placed) == placed


def test_a_stop_in_time_belongs_to_the_stream():
    stamp = 5 * SECOND + COMMAND_PERIOD
    stream = now(go(5 * SECOND), stop(stamp))
    assert stream.limit == stamp + COMMAND_PERIOD
    assert stream.wait == CLOCK_PATIENCE_AT_REST
    again = now(go(stamp + COMMAND_PERIOD), stream=stream)
    assert again.wait == CLOCK_PATIENCE
    # Steering at rest counts as driving.
    steer = Command(5 * SECOND, 0.0, 0.3)
    assert now(steer).wait == CLOCK_PATIENCE and now(steer).drives


@pytest.mark.parametrize("clock", [4 * SECOND, 5 * SECOND, 6 * SECOND])
def test_after_an_initial_pose_the_clock_waits_at_its_report(clock):
    stream = listen((InitialPose(5 * SECOND, ORIGIN), clock, 3.0))
    assert stream.limit == REPORT
    assert stream.holds(3.0 + CLOCK_PATIENCE) and not stream.holds(3.01 + CLOCK_PATIENCE)


def test_an_initial_pose_begins_another_stream():
    stamps = [5 * SECOND + k * SECOND // 5 for k in range(3)]
    stream = now(*map(go, stamps)).expire()
    stream = listen((InitialPose(6 * SECOND, ORIGIN), 6 * SECOND, 0.0), stream=stream)
    assert stream.wait == CLOCK_PATIENCE
    assert now(go(8 * SECOND), stream=stream).limit == 8 * SECOND + COMMAND_PERIOD


def test_each_wait_in_vain_halves_the_patience_of_a_stream_without_promises():
    stream, waits = now(go(5 * SECOND)), []
    for number in range(1, 8):
        waits.append(stream.wait)
        stream = now(go(5 * SECOND + number * LONG_STEP), stream=stream.expire())
    assert waits == [5.0, 2.5, 1.25, 0.625, 0.3125, MIN_CLOCK_PATIENCE, MIN_CLOCK_PATIENCE]
    # A promise resets it.
    stream = now(go(5 * SECOND)).expire()
    assert listen((go(6 * SECOND), 5 * SECOND, 0.0), stream=stream).wait == CLOCK_PATIENCE


@pytest.mark.parametrize("event", [go(5 * SECOND), stop(5 * SECOND)])
def test_no_event_is_late_while_the_clock_is_held(event):
    held = listen((event, 4 * SECOND, 7.0))
    resumed = held.renew(100.0)
    assert resumed.holds(100.0 + held.wait) and not resumed.holds(100.01 + held.wait)
    assert held.expire().renew(100.0).is_expired


@pytest.mark.parametrize(
    "stamp, clock, expected",
    [
        (1000, 985, 1000),  # next pose at 1000, one every 20
        (990, 985, 1000),
        (985, 985, 1000),  # the pose of the present has been reported
        (900, 985, 1000),
        (1001, 985, 1020),
        (1020, 985, 1020),
        (1021, 985, 1040),
        (1000, 980, 1000),
        (981, 960, 1000),
        (980, 960, 980),
    ],
)
def test_the_first_report_of_an_initial_pose(stamp, clock, expected):
    assert first_report(stamp, clock, next_pose=1000, pose_period=20) == expected


def test_an_instant_is_shown_with_all_its_digits():
    """A float has 16, of which nine are those of the seconds since 1970."""
    assert shown(1_764_417_600_020_000_001) == "1764417600.020000001 s"
