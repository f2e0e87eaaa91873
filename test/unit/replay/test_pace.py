"""Check when the clock of a replay advances; the node and the wall clock are simulated here."""

import pytest

from mushr_ros_intro.replay import pace
from mushr_ros_intro.replay.pace import HOLD, MAX_COMPUTATION, POLL, SETTLING, STEP, STEP_WAIT, Pace
from mushr_ros_intro.stamps import COMMAND_PERIOD

MS = STEP // 10
NAPS = 100
"""The number of observations in a time."""


class Threads:
    """Threads whose state is set by the test."""

    def __init__(self):
        self.usages = self.runs = {"clock": 0}  # as observed, and now
        self.ran, self.waits = 0.0, True

    def run(self):
        """Let a thread run for a moment."""
        self.runs = {"clock": self.runs["clock"] + 1}

    def observe(self):
        self.usages = self.runs

    def are_waiting(self):
        self.observe()
        return self.waits

    def is_each_waiting(self):
        return self.waits


class Clock:
    """The clock of a replay, whose pace is under test, and the wall clock."""

    def __init__(self, monkeypatch):
        self.wall, self.node, self.others = 0.0, Threads(), Threads()
        monkeypatch.setattr(pace.time, "monotonic", lambda: self.wall)
        self.pace = Pace(self.node)

    def observe(self):
        """Return whether the node waits, and whether the others do."""
        return self.pace.observe(self.others)

    def after(self, seconds, left=None, due=None, now=0, in_real_time=False):
        """Return by how much the clock advances, after a time on the wall clock [s]."""
        self.observe()
        for _ in range(NAPS):
            self.wall += seconds / NAPS
            self.observe()
        end = self.pace.advance(now, left, due, in_real_time)
        return None if end is None else end - now

    def write(self, is_received=True):
        """Send a message to one thread of the node."""
        self.pace.wrote(1)
        if is_received:
            self.node.run()

    def hear(self):
        """Receive a command, which a thread of the node has sent."""
        self.node.run()
        self.observe()
        self.pace.heard()


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


@pytest.fixture
def driving(clock):
    """Return a clock whose node has sent a command, and then waits."""
    clock.hear()
    assert clock.after(0.0) is None
    assert clock.after(2.0 * HOLD) is None
    return clock


def test_start(clock):
    """A node that starts waits for a moment, again and again."""
    assert clock.after(0.5 * SETTLING) is None
    clock.pace.unsettle()
    assert clock.after(0.9 * SETTLING) is None
    assert clock.after(0.2 * SETTLING) == COMMAND_PERIOD


def test_first_command(clock):
    """The clock stands until it is known whether the node waits for it."""
    clock.hear()
    assert clock.after(0.0, due=STEP) is None
    assert clock.after(0.9 * HOLD, due=STEP) is None
    assert clock.after(0.2 * HOLD, due=STEP) is None
    assert clock.after(0.0, due=STEP) == STEP
    assert not clock.pace.uses_wall_clock


@pytest.mark.parametrize(("seconds", "expected"), [(0.1, True), (1.2 * HOLD, False)])
def test_a_node_that_waits_for_the_wall_clock(clock, seconds, expected):
    """It sends a command although the clock stands; later, the clock does not stand."""
    clock.hear()
    clock.after(0.0)
    clock.after(seconds)
    clock.hear()
    assert clock.pace.uses_wall_clock == expected


def test_commands_without_a_wait(clock):
    """A node may send several commands at once."""
    clock.hear()
    clock.hear()
    assert not clock.pace.uses_wall_clock


def test_the_node_must_have_received_the_message(driving):
    driving.write(is_received=False)
    assert driving.after(0.5 * STEP_WAIT, due=STEP) is None
    driving.node.run()
    assert driving.after(0.0, due=STEP) == STEP


def test_a_message_that_is_never_received(driving):
    driving.write(is_received=False)
    assert driving.after(1.1 * STEP_WAIT, due=STEP) == STEP


@pytest.mark.parametrize(
    ("left", "due", "expected"),
    [
        pytest.param(COMMAND_PERIOD, 0, 0, id="another thread is due now"),
        pytest.param(COMMAND_PERIOD, -5, 0, id="it was due"),
        pytest.param(COMMAND_PERIOD, 3 * STEP, 3 * STEP, id="due on a step"),
        pytest.param(COMMAND_PERIOD, 3 * STEP - MS, 3 * STEP - MS, id="due between two steps"),
        pytest.param(COMMAND_PERIOD, 20 * STEP, COMMAND_PERIOD, id="due late"),
        pytest.param(COMMAND_PERIOD, None, STEP, id="unknown"),
        pytest.param(-STEP, None, STEP, id="a late command"),
        pytest.param(-pace.PAUSE - 1, None, COMMAND_PERIOD, id="no command for a second"),
        pytest.param(None, None, COMMAND_PERIOD, id="no command is expected"),
    ],
)
def test_length_of_a_step(driving, left, due, expected):
    assert driving.after(0.0, left, due) == expected


@pytest.mark.parametrize(
    ("now", "due", "expected"),
    [
        pytest.param(STEP + MS, 3 * STEP, 3 * STEP, id="as long as the node sleeps"),
        pytest.param(STEP + MS, None, STEP - MS, id="unknown"),
        pytest.param(STEP + MS, 20 * STEP, COMMAND_PERIOD - MS, id="late"),
        pytest.param(99 * STEP + MS, 3 * STEP, STEP - MS, id="not past a second"),
    ],
)
def test_a_step_that_begins_between_two_multiples(driving, now, due, expected):
    """A node that sleeps for 0.102 s, again and again, sleeps for this time on average."""
    assert driving.after(0.0, COMMAND_PERIOD, due, now) == expected


def test_a_node_that_sleeps_for_1_ms_again_and_again_polls(driving):
    """A sleep of 1 ms after each longer one is exact: see above."""
    now, ends = 0, []
    for due in (MS, MS, MS, MS, MS, 10 * STEP, MS):
        now = now + driving.after(0.0, COMMAND_PERIOD, due, now)
        driving.write()
        ends.append(now)
    expected = [MS, 2 * MS, 3 * MS, STEP, 2 * STEP, 12 * STEP, 12 * STEP + MS]
    assert ends == expected


@pytest.mark.parametrize("seconds", [0.09, 0.11])
def test_real_time(driving, seconds):
    """While a child process waits in real time, the clock is not faster than the node waits."""
    driving.write()
    step = driving.after(seconds, COMMAND_PERIOD, COMMAND_PERIOD, in_real_time=True)
    assert step == (COMMAND_PERIOD if seconds > 0.1 else None)


def test_a_computation_takes_no_simulated_time(driving):
    """A node that runs for longer polls something; the clock is then as fast as the node."""
    driving.write()
    driving.node.waits = False
    driving.node.ran = 0.9 * MAX_COMPUTATION
    assert driving.after(100.0, due=STEP) is None
    driving.node.ran = 1.1 * MAX_COMPUTATION
    for _ in range(3):
        assert driving.after(0.0, due=STEP) == STEP
        driving.write()
        driving.node.ran += 0.9 * POLL
        assert driving.after(100.0, due=STEP) is None
        driving.node.ran += 0.2 * POLL
    driving.node.waits = True
    assert driving.after(0.0, due=STEP) == STEP
    driving.node.waits = False
    assert driving.after(0.0, due=STEP) is None


@pytest.mark.parametrize(("has_run", "seconds"), [(False, 0.005), (True, pace.BETWEEN_POLLS)])
def test_a_node_that_has_run_has_waited_for_a_processor(clock, has_run, seconds):
    """Between two observations, 5 ms apart, that find it waiting."""
    clock.observe()
    clock.wall += 0.005
    if has_run:
        clock.node.run()
    clock.observe()
    assert clock.pace.seconds == pytest.approx(seconds)


def test_a_replay_that_has_waited_for_a_processor(clock):
    """It observes the node late: the node has waited for it, and does not hang."""
    clock.observe()
    clock.wall += 100.0
    clock.observe()
    assert clock.pace.seconds == pytest.approx(pace.MAX_WAIT)


@pytest.mark.parametrize("late", [0, 1])
def test_a_thread_of_the_replay_that_waits_for_a_processor(clock, late):
    """At one of two observations: the node may wait for its answer."""
    for number in range(2):
        clock.others.waits = number != late
        clock.wall += 0.005
        clock.observe()
    assert clock.pace.seconds == 0.0


@pytest.mark.parametrize("has_run", [True, False])
def test_a_node_that_is_woken_while_the_others_are_observed(clock, has_run):
    """Then it has run and waits again, or it waits for a processor."""
    assert clock.observe() == (True, True)

    def wake():
        if has_run:
            clock.node.run()
        clock.node.waits = has_run
        return True

    clock.others.are_waiting = wake
    assert clock.observe() == (False, True)


def test_a_node_that_sends_a_command_and_falls_asleep(clock):
    """It is found waiting a moment before its run is counted: its receiver is observed after it."""
    sent = []

    def fall_asleep():
        sent.append("command")
        return True

    clock.node.is_each_waiting = fall_asleep
    clock.others.are_waiting = lambda: not sent
    assert clock.observe() == (True, False)
