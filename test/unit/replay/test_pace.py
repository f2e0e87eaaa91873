"""Check when the clock of a replay advances, for nodes in many styles, on idle and busy machines.

The node and the world are simulated here, with a wall-clock time of their own.
"""

import random

import pytest

from mushr_ros_intro.replay import pace
from mushr_ros_intro.replay.pace import Pace
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

NEVER = float("inf")


class Node:
    """A node with a thread that receives the clock, and a main thread, which paces the commands.

    Args:
        sleeps: how long the main thread sleeps before it sends a command [s].
        parts: in simulated time: it sleeps so often meanwhile, for equal times.
        period: in wall-clock time: it wakes up so often before that [s]; 0 in simulated time.
        work: processor time for each command [s].
        delay: returns for how long a thread waits for a processor [s].
        other: another thread sleeps for so long, again and again, in simulated time [s]; 0 if
            there is none.
    """

    def __init__(self, sleeps, period, work, delay, parts=1, other=0.0):
        self.sleeps, self.period, self.work, self.delay = sleeps / parts, period, work, delay
        self.parts = self.left = parts
        self.other, self.lateness = other, []  # how late the other thread woke up each time [s]
        self.usages, self.ran = {"clock": 0, "main": 0, "other": 0}, 0.0  # as observed
        self.delayed = 0.0
        self.runs, self.worked = self.usages, 0.0
        self.wall = self.begin = self.seen = 0.0
        self.wakes = {"clock": NEVER, "main": 0.0, "other": NEVER}  # when it runs [s of wall clock]
        self.runnable = dict(self.wakes)  # since when it waits for a processor
        self.clock, self.works_until = 0, 0.0

    def are_waiting(self):
        self.usages, self.ran = self.runs, self.worked
        return self.works_until <= self.wall < min(self.runnable.values())

    def wake(self, thread, when):
        """Let a thread run at a time [s], or later, when there is a processor."""
        self.runnable[thread] = when
        self.wakes[thread] = when + self.delay()

    def run(self, wall):
        """Run the threads until a time [s]; return how many commands the main thread has sent."""
        self.wall, sent = wall, 0
        while min(self.wakes.values()) <= wall:
            name = min(self.wakes, key=self.wakes.get)
            now = self.wakes[name]
            self.runs = {**self.runs, name: self.runs[name] + 1}
            self.wakes[name] = self.runnable[name] = NEVER
            if name == "clock":
                self.seen = self.clock
                if not self.period:
                    self.wake("main", now)
                if self.other:
                    self.wake("other", now)
            elif name == "other":
                late = self.seen / NANOSECONDS - self.other * (len(self.lateness) + 1)
                if late > -1e-9:
                    self.lateness.append(late)
            else:
                sent += self.run_main(now)
        return sent

    def run_main(self, now):
        """Let the main thread run; return how many commands it sends."""
        time = now if self.period else self.seen / NANOSECONDS
        is_due = time >= self.begin + self.sleeps - 1e-9
        if is_due:
            self.begin = time
            self.left -= 1
            is_due = not self.left
        if is_due:
            self.works_until, self.left = now + self.work, self.parts
            self.worked += self.work
        if self.period:
            end = max(now, self.works_until)
            self.wake("main", min(end + self.period, max(end, self.begin + self.sleeps)))
        return int(is_due)


@pytest.fixture
def wall(monkeypatch):
    """Simulate the wall clock; return a list with its time [s]."""
    now = [0.0]
    monkeypatch.setattr(pace.time, "monotonic", lambda: now[0])
    return now


def drive(wall, sleeps, period, work, load, parts=1):
    """Return the intervals between the commands of a node [s of simulated time].

    Args:
        wall: the time of the wall clock [s], which advances.
        sleeps, period, work, parts: as for `Node`.
        load: how long threads wait for a processor [s], on average.
    """
    chance = random.Random(5)
    delay = lambda: chance.expovariate(1.0 / load) if load else 0.0  # noqa: E731
    node = Node(sleeps, period, work, delay, parts)
    return pace_of(wall, node, lambda: 0.001 + delay())


def pace_of(wall, node, pause):
    """Return the intervals between the commands of a node [s of simulated time].

    Args:
        wall: the time of the wall clock [s], which advances.
        node: the node.
        pause: returns the time until the next look at the node [s].
    """
    decides, arrivals = Pace(node), []
    while len(arrivals) < 40:
        wall[0] += pause()
        assert wall[0] < 1000.0
        sent = node.run(wall[0])
        left = arrivals[-1] + COMMAND_PERIOD - node.clock if arrivals else None
        decides.observe()
        if sent:
            arrivals.append(node.clock)
            decides.heard(left)
            left = COMMAND_PERIOD
        if sent and not decides.uses_wall_clock:
            continue
        if duration := decides.advance(left):
            node.clock += duration
            decides.stepped(1)
            node.wake("clock", wall[0])
    return [(later - earlier) / NANOSECONDS for earlier, later in zip(arrivals, arrivals[1:])]


@pytest.mark.parametrize("work", [0.0, 0.03])
@pytest.mark.parametrize(
    ("sleeps", "period", "load"),
    [
        pytest.param(0.1, 0.0, 0.0, id="rospy.sleep"),
        pytest.param(0.1, 0.0, 0.02, id="rospy.sleep_busy"),
        pytest.param(0.1, 0.1, 0.0, id="time.sleep"),
        pytest.param(0.1, 0.1, 0.02, id="time.sleep_busy"),
        pytest.param(0.3, 0.3, 0.005, id="time.sleep_long_busy"),
        pytest.param(0.1, 0.001, 0.0, id="polls"),
        pytest.param(0.1, 0.001, 0.005, id="polls_busy"),
        pytest.param(0.1, 0.01, 0.0, id="polls_slowly"),
        pytest.param(0.1, 0.01, 0.02, id="polls_slowly_busy"),
    ],
)
def test_ten_commands_per_second(wall, sleeps, period, load, work):
    """Whatever the node waits for, its commands come when they are due, on a busy machine, too.

    The first intervals may differ, until it is known whether the node waits for the clock.
    """
    intervals = drive(wall, sleeps, period, work, load)
    assert intervals[2:] == pytest.approx([0.1] * (len(intervals) - 2))


@pytest.mark.parametrize("load", [0.0, 0.02])
@pytest.mark.parametrize("seconds", [0.01, 0.02, 0.05, 0.15, 0.2])
def test_other_rates_in_simulated_time(wall, seconds, load):
    """They are exact, from the first command on."""
    intervals = drive(wall, seconds, 0.0, 0.0, load)
    assert intervals == pytest.approx([seconds] * len(intervals))


@pytest.mark.parametrize("parts", [2, 10])
def test_a_node_that_sleeps_several_times(wall, parts):
    """At most one command is late, by one step: the clock does not skip the other instants."""
    intervals = drive(wall, 0.1, 0.0, 0.0, 0.0, parts)
    late = [each for each in intervals if each != pytest.approx(0.1)]
    assert late == pytest.approx([0.11])


def test_a_slow_node_costs_little_time(wall):
    """The clock waits less and less for commands that do not come when they are due."""
    drive(wall, 0.2, 0.0, 0.0, 0.0)
    assert wall[0] < 1.5  # 40 commands


@pytest.mark.parametrize("other", [0.05, 0.25])
def test_two_threads_that_sleep(wall, other):
    """The clock stops at the instants of both; at most one is late."""
    node = Node(0.1, 0.0, 0.0, lambda: 0.0, other=other)
    assert pace_of(wall, node, lambda: 0.001) == pytest.approx([0.1] * 39)
    assert len(node.lateness) > 10
    assert sum(late > pace.STEP / NANOSECONDS + 1e-9 for late in node.lateness) <= 1


@pytest.mark.parametrize(
    ("waits", "has_run", "seconds", "knows"),
    [
        (True, False, 0.0, False),
        (True, True, 0.0, True),
        (False, True, 0.005, False),
        (False, True, 0.02, True),
    ],
)
def test_when_a_node_knows_the_time(wall, waits, has_run, seconds, knows):
    """Poses are sent then: a node may stamp its command when it receives a pose."""
    node = Threads()
    decides = Pace(node)
    decides.stepped(1)
    node.waits, node.runs, node.ran = waits, {"clock": 1} if has_run else node.runs, seconds
    decides.observe()
    assert decides.knows_time == knows


@pytest.mark.parametrize(("seconds", "is_asleep"), [(0.04, False), (0.06, True)])
def test_a_command_after_a_sleep_that_was_not_observed(wall, seconds, is_asleep):
    """On a busy machine, it arrives before the clock looks at the node again."""
    node = Threads()
    decides = Pace(node)
    decides.heard(None)
    decides.stepped(1)
    wall[0] += seconds
    node.runs = {"clock": 1}
    decides.observe()
    decides.heard(0)
    assert decides.uses_wall_clock == is_asleep


class Threads:
    """Threads whose state is set by the test."""

    usages = runs = {}  # as observed, and now
    ran, delayed, waits = 0.0, 0.0, True

    def are_waiting(self):
        self.usages = self.runs
        return self.waits


def test_a_long_computation_takes_simulated_time(wall):
    """After 0.1 s of processor time without a pause, the clock is as fast as the node."""
    node = Threads()
    node.waits = False
    decides, clock = Pace(node), 0
    for _ in range(300):
        wall[0] += 0.001
        node.ran += 0.001
        decides.observe()
        if duration := decides.advance(None):
            clock += duration
            decides.stepped(1)
    assert clock / NANOSECONDS == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize(("has_run", "seconds"), [(False, 0.1), (True, pace.BETWEEN_POLLS)])
def test_a_node_that_has_run_has_waited_for_a_processor(wall, has_run, seconds):
    """Between two observations, 0.1 s apart, that find it waiting."""
    node = Threads()
    decides = Pace(node)
    decides.observe()
    wall[0] += 0.1
    if has_run:
        node.runs = {"main": 1}
    decides.observe()
    assert decides.seconds == pytest.approx(seconds)
