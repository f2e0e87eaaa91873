"""Check how far the simulated clock may run."""

import pytest

from mushr_ros_intro.car.bicycle import ORIGIN
from mushr_ros_intro.car.model import Command, InitialPose
from mushr_ros_intro.sim.clock import (
    DEFAULT_PERIOD,
    LONGEST_PERIOD,
    PATIENCE,
    PATIENCE_AT_REST,
    carry_over,
    hear,
    horizon,
)

SECOND = 1_000_000_000
POSE_PERIOD = SECOND // 50


def listen(*events):
    """Return the stream of (event, clock [ns], wall [s])."""
    stream = None
    for event, clock, wall in events:
        stream = hear(stream, event, clock, wall)
    return stream


def limit(stream, wall, lock_step, next_pose=3 * SECOND):
    """Return the horizon for a car that reports its pose at 50 Hz."""
    return horizon(stream, wall, lock_step, next_pose, POSE_PERIOD)


def go(stamp):
    return Command(stamp, 1.0, 0.1)


def test_nothing_holds_the_clock_before_the_first_event():
    assert limit(None, 0.0, lock_step=True) is None


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_command_ahead_of_the_clock_is_a_promise(lock_step):
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0))
    assert limit(stream, 0.0, lock_step) == 5 * SECOND


def test_a_command_of_the_present_promises_one_period_in_lock_step_only():
    stream = listen((go(5 * SECOND), 5 * SECOND, 0.0))
    assert limit(stream, 0.0, lock_step=True) == 5 * SECOND + DEFAULT_PERIOD
    assert limit(stream, 0.0, lock_step=False) is None


def test_a_command_that_is_sent_again_when_it_is_due_is_one_of_the_present():
    command = go(5 * SECOND)
    stream = listen((command, 4 * SECOND, 0.0), (command, 5 * SECOND, 0.0))
    assert limit(stream, 0.0, lock_step=True) == 5 * SECOND + DEFAULT_PERIOD


@pytest.mark.parametrize("times", [1, 2])
def test_the_period_is_learned_from_the_stamps(times):
    """Also where each command is sent twice."""
    period = SECOND // 4
    stamps = [5 * SECOND + k * period for k in range(3) for _ in range(times)]
    stream = listen(*((go(stamp), stamp, 0.0) for stamp in stamps))
    assert limit(stream, 0.0, True) == 5 * SECOND + 3 * period


def test_a_period_may_vary_a_little():
    stamps = [stamp * SECOND // 1000 for stamp in (5000, 5250, 5512)]
    stream = listen(*((go(stamp), stamp, 0.0) for stamp in stamps))
    assert limit(stream, 0.0, True) == stamps[-1] + 262 * SECOND // 1000


@pytest.mark.parametrize("again", [0, 1])
def test_a_step_that_does_not_repeat_itself_is_no_period(again):
    """The first commands of a loop at 10 Hz, delivered late, and one of them twice."""
    stamps = [110, 250] + again * [250] + [350]
    stream = None
    for stamp in stamps:
        stream = hear(stream, go(stamp * SECOND // 1000), stamp * SECOND // 1000, 0.0)
        assert limit(stream, 0.0, True) == stamp * SECOND // 1000 + DEFAULT_PERIOD


def test_commands_far_apart_are_two_streams():
    period = SECOND // 4
    stamps = [5 * SECOND + k * period for k in range(3)]
    far = stamps[-1] + LONGEST_PERIOD + 1
    stream = listen(*((go(stamp), stamp, 0.0) for stamp in [*stamps, far]))
    assert limit(stream, 0.0, True) == far + DEFAULT_PERIOD


def test_a_pause_after_a_stop_is_no_period():
    """Neither is the time after which the mux sends one."""
    end, stop = 5 * SECOND, 5 * SECOND + SECOND // 5
    for begin in (6 * SECOND, stop + SECOND // 5):
        events = [go(end), Command(stop, 0.0, 0.0), go(begin)]
        stream = listen(*((event, event.stamp, 0.0) for event in events))
        assert limit(stream, 0.1, True) == begin + DEFAULT_PERIOD


def test_a_late_command_does_not_set_the_horizon_back():
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0), (go(4 * SECOND), 4 * SECOND, 0.5))
    assert limit(stream, 0.5, True) == 5 * SECOND
    assert limit(stream, 0.5 + PATIENCE, True) == 5 * SECOND


def test_after_a_placement_the_clock_waits_for_the_first_command():
    """It runs until the placement has been reported, and not to a command that is due later."""
    placed = (InitialPose(5 * SECOND, ORIGIN), 4 * SECOND, 0.0)
    assert limit(listen(placed), PATIENCE, True) == 5 * SECOND
    assert limit(listen(placed), PATIENCE, False) is None
    begin = 5 * SECOND + DEFAULT_PERIOD
    driven = listen(placed, (go(begin), 5 * SECOND, 0.0))
    assert driven.ahead
    assert limit(driven, 0.0, False) == begin


@pytest.mark.parametrize("behind", [0, 10])
def test_after_a_placement_that_is_not_ahead_there_still_is_a_report(behind):
    late = (InitialPose(5 * SECOND, ORIGIN), 5 * SECOND + behind * POSE_PERIOD, 0.0)
    assert limit(listen(late), 0.0, True) == 5 * SECOND + (behind + 1) * POSE_PERIOD


@pytest.mark.parametrize("since", [-1, 0, 1, POSE_PERIOD - 1, POSE_PERIOD])
@pytest.mark.parametrize("clock", [4 * SECOND, 5 * SECOND - 1])
def test_the_clock_runs_to_the_first_pose_that_shows_a_placement(since, clock):
    """Also where poses are due beside it, before or after."""
    placed = (InitialPose(5 * SECOND, ORIGIN), clock, 0.0)
    reported = limit(listen(placed), 0.0, True, next_pose=5 * SECOND + since)
    assert (reported - 5 * SECOND - since) % POSE_PERIOD == 0
    assert 0 <= reported - 5 * SECOND < POSE_PERIOD


def test_a_placement_teaches_no_period():
    begin = 5 * SECOND + POSE_PERIOD
    stream = listen((InitialPose(5 * SECOND, ORIGIN), 4 * SECOND, 0.0), (go(begin), begin, 0.1))
    assert limit(stream, 0.1, True) == begin + DEFAULT_PERIOD


def test_a_placement_does_not_undo_the_command_of_its_stamp():
    """Both of the listing's first messages say now, and the second may arrive first."""
    now = 5 * SECOND
    for events in ([go(now), InitialPose(now, ORIGIN)], [InitialPose(now, ORIGIN), go(now)]):
        stream = listen(*((event, now, 0.0) for event in events))
        assert limit(stream, 0.0, True) == now + DEFAULT_PERIOD


@pytest.mark.parametrize("clock", [4 * SECOND, 5 * SECOND])
def test_a_plan_that_begins_again_is_placed_whichever_of_its_messages_is_first(clock):
    """It ends in a stop, which takes the way through the mux, and a placement of that stamp."""
    end = 5 * SECOND
    for events in (
        [Command(end, 0.0, 0.0), InitialPose(end, ORIGIN)],
        [InitialPose(end, ORIGIN), Command(end, 0.0, 0.0)],
    ):
        stream = listen((go(end - DEFAULT_PERIOD), clock, 0.0), *((e, clock, 0.0) for e in events))
        reported = end + (POSE_PERIOD if clock == end else 0)
        assert limit(stream, 0.0, True) == reported
        assert limit(stream, PATIENCE, True) == reported


def test_patience_ends():
    driving = listen((go(5 * SECOND), 4 * SECOND, 7.0))
    assert limit(driving, 7.0 + PATIENCE, True) == 5 * SECOND
    assert limit(driving, 7.01 + PATIENCE, True) is None
    standing = listen((Command(5 * SECOND, 0.0, 0.0), 4 * SECOND, 7.0))
    assert limit(standing, 7.0 + PATIENCE_AT_REST, True) == 5 * SECOND
    assert limit(standing, 7.01 + PATIENCE_AT_REST, True) is None
    steering = listen((Command(5 * SECOND, 0.0, 0.3), 4 * SECOND, 7.0))
    assert limit(steering, 7.0 + PATIENCE, True) == 5 * SECOND


@pytest.mark.parametrize("event", [go(5 * SECOND), Command(5 * SECOND, 0.0, 0.0)])
def test_nobody_is_late_while_the_clock_is_held(event):
    held = listen((event, 4 * SECOND, 7.0))
    patience = held.patience
    resumed = carry_over(held, 100.0, was_held=True)
    assert limit(resumed, 100.0 + patience, True) == 5 * SECOND
    assert limit(resumed, 100.01 + patience, True) is None


def test_a_stream_that_was_over_stays_over_when_the_clock_is_held():
    over = listen((go(5 * SECOND), 4 * SECOND, 7.0))
    assert carry_over(over, 7.01 + PATIENCE, was_held=False) is None
    assert carry_over(None, 0.0, was_held=True) is None


def test_a_stop_after_a_placement_does_not_let_the_clock_run():
    """The mux stops who drove before, while who placed the car waits for its report."""
    placed = (InitialPose(5 * SECOND, ORIGIN), 5 * SECOND, 0.0)
    stop = Command(5 * SECOND + DEFAULT_PERIOD, 0.0, 0.0)
    stream = listen(placed, (stop, 5 * SECOND + POSE_PERIOD, 0.1))
    assert limit(stream, PATIENCE, True) == 5 * SECOND + POSE_PERIOD
    assert limit(stream, PATIENCE + 0.01, True) is None


def test_who_stands_after_a_placement_holds_the_clock_once():
    events = [(InitialPose(5 * SECOND, ORIGIN), 5 * SECOND, 0.0)]
    events.append((Command(6 * SECOND, 0.0, 0.0), 6 * SECOND, PATIENCE + 0.01))
    stream = listen(*events)
    assert limit(stream, PATIENCE + 0.02, True) == 6 * SECOND + DEFAULT_PERIOD
    assert limit(stream, PATIENCE + 0.02 + PATIENCE_AT_REST, True) is None
