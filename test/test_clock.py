"""Check how far the simulated clock may run."""

import pytest
from mushr_ros_intro.bicycle import ORIGIN
from mushr_ros_intro.car import Command, Placement
from mushr_ros_intro.clock import (
    DEFAULT_PERIOD,
    LONGEST_PERIOD,
    PATIENCE,
    PATIENCE_AT_REST,
    hear,
    horizon,
)

SECOND = 1_000_000_000


def listen(*events):
    """Return the stream of (event, clock [ns], wall [s])."""
    stream = None
    for event, clock, wall in events:
        stream = hear(stream, event, clock, wall)
    return stream


def go(stamp):
    return Command(stamp, 1.0, 0.1)


def test_nothing_holds_the_clock_before_the_first_event():
    assert horizon(None, 0.0, lock_step=True) is None


@pytest.mark.parametrize("lock_step", [True, False])
def test_a_command_ahead_of_the_clock_is_a_promise(lock_step):
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0))
    assert horizon(stream, 0.0, lock_step) == 5 * SECOND


def test_a_command_of_the_present_promises_one_period_in_lock_step_only():
    stream = listen((go(5 * SECOND), 5 * SECOND, 0.0))
    assert horizon(stream, 0.0, lock_step=True) == 5 * SECOND + DEFAULT_PERIOD
    assert horizon(stream, 0.0, lock_step=False) is None


def test_the_period_is_learned_from_the_stamps():
    period = SECOND // 4
    events = [(go(5 * SECOND + k * period), 5 * SECOND + k * period, 0.01 * k) for k in range(3)]
    assert horizon(listen(*events), 0.02, True) == 5 * SECOND + 3 * period
    events.append((go(5 * SECOND + 2 * period), 5 * SECOND + 2 * period, 0.03))  # twice
    assert horizon(listen(*events), 0.03, True) == 5 * SECOND + 3 * period


def test_commands_far_apart_are_two_streams():
    far = 5 * SECOND + LONGEST_PERIOD + 1
    stream = listen((go(5 * SECOND), 5 * SECOND, 0.0), (go(far), far, 0.1))
    assert horizon(stream, 0.1, True) == far + DEFAULT_PERIOD


def test_a_late_command_does_not_set_the_horizon_back():
    stream = listen((go(5 * SECOND), 4 * SECOND, 0.0), (go(4 * SECOND), 4 * SECOND, 0.5))
    assert horizon(stream, 0.5, True) == 5 * SECOND


def test_after_a_placement_the_clock_waits_for_the_first_command():
    stream = listen((Placement(5 * SECOND, ORIGIN), 4 * SECOND, 0.0))
    assert horizon(stream, PATIENCE, True) == 5 * SECOND + DEFAULT_PERIOD


def test_patience_ends():
    driving = listen((go(5 * SECOND), 4 * SECOND, 7.0))
    assert horizon(driving, 7.0 + PATIENCE, True) == 5 * SECOND
    assert horizon(driving, 7.01 + PATIENCE, True) is None
    standing = listen((Command(5 * SECOND, 0.0, 0.0), 4 * SECOND, 7.0))
    assert horizon(standing, 7.0 + PATIENCE_AT_REST, True) == 5 * SECOND
    assert horizon(standing, 7.01 + PATIENCE_AT_REST, True) is None
    steering = listen((Command(5 * SECOND, 0.0, 0.3), 4 * SECOND, 7.0))
    assert horizon(steering, 7.0 + PATIENCE, True) == 5 * SECOND
