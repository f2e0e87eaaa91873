"""Check when the drive of a replay ends, and what it says about the node then."""

import math
from types import SimpleNamespace

import pytest

from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.replay import watch
from mushr_ros_intro.replay.pace import STEP
from mushr_ros_intro.replay.received import Received
from mushr_ros_intro.replay.recording import Sent
from mushr_ros_intro.replay.world import START
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from support.controllers import WAVE
from support.recorded import PLAN, commands


class World:
    """A world, and the threads of its node, after some commands; nothing follows."""

    usages, ran, time_left = {}, 0.0, 1
    is_ending, silence, fault_found = False, 0.0, ""
    topic_mistake = "it publishes nothing"

    def __init__(self, sent):
        self.received, self.count = SimpleNamespace(commands=sent), len(sent)

    def observe(self, pace, left):
        assert left == self.time_left  # a stop may follow
        self.silence += 0.05
        self.ran += 0.05

    def fault(self, pace):
        return self.fault_found

    def describe_end(self, process):
        return "it has ended"

    def watch(self, exercise, has_ended=False):
        process = SimpleNamespace(has_ended=has_ended, threads=self, excess=str)
        return watch.watch(process, self, exercise)


@pytest.fixture(autouse=True)
def _no_checks(monkeypatch):
    monkeypatch.setattr(watch, "CHECK_PERIOD", math.inf)


def test_a_node_that_sends_no_stop():
    """It has driven the plan if nothing follows; it need not end."""
    world = World(commands())
    assert world.watch(PLAN) == ""
    assert world.silence == pytest.approx(watch.DONE_AFTER, abs=0.06)


@pytest.mark.parametrize("timeout", [15.0, 80.0])
def test_a_node_that_hangs(monkeypatch, timeout):
    """The message names both limits, because the load decides which one it exceeds first."""
    monkeypatch.setattr(watch, "TIMEOUT", timeout)
    world = World(commands()[:4])
    message = world.watch(PLAN)
    arrived = f" 4 of {count_commands(PLAN)} commands arrived, and then none for {timeout:g} s, "
    assert f"{arrived}or for 60 s of simulated time, although " in message
    assert world.silence == pytest.approx(min(timeout, 60.0), abs=0.06)


class Repeating(World):
    """The same, but the node sends on."""

    def observe(self, pace, left):
        assert self.count < 10_000, "the replay does not end"
        last = self.received.commands[-1]
        self.received.commands.append(last._replace(time=last.time + COMMAND_PERIOD))
        self.count += 1


def test_a_node_that_sends_on():
    """Its drive ends at the same instant in all runs: 5 s after 1.5 times the plan's duration."""
    world = Repeating([*commands()])
    assert world.watch(PLAN).startswith("the node still sends commands ")
    sent, limit = world.received.commands, PLAN.duration * 3 // 2 + 5 * NANOSECONDS
    assert 0 < sent[-1].time - sent[0].time - limit <= COMMAND_PERIOD


def test_a_node_that_sends_stops_on():
    """It has driven the plan if it sends only stops for 5 s; it may send them for ever."""
    world = Repeating([*commands()])
    begun = len(world.received.commands)
    world.received.commands.append(world.received.commands[-1]._replace(speed=0.0))
    assert world.watch(PLAN) == ""
    sent = world.received.commands
    seconds = (sent[-1].time - sent[begun].time) / NANOSECONDS
    assert watch.STOPS_AFTER < seconds < watch.STOPS_AFTER + 0.21


class Driving(World):
    """A world whose controller drives on, or sends nothing; it uses `seconds` of each step."""

    def __init__(self, drives, seconds):
        super().__init__([])
        self.drives, self.seconds = drives, seconds
        self.now, self.received, self.states = START, Received(), []

    @property
    def silence(self):
        return (self.now - START) / NANOSECONDS

    def observe(self, pace, left):
        assert left == 0
        self.now, self.ran = self.now + STEP, self.ran + self.seconds
        assert self.now < START + 100 * NANOSECONDS, "the replay does not end"
        self.states.append(SimpleNamespace(pose=self.drives * self.now))
        if self.drives:
            sent = Sent(self.now, True, 1.0, 0.0, self.now, self.now)
            self.received.commands.append(sent)
            self.count += 1


def test_a_controller_that_drives_on():
    """At most three times the duration of the path, and 5 s: at the same instant in all runs."""
    world = Driving(True, 0.0)
    path = WAVE._replace(stamps=(0, 10 * NANOSECONDS))
    expected = "25 s after the end of the path, which takes 10 s"
    assert world.watch(path) == f"the node still sends commands {expected}"
    assert world.now == START + STEP + 35 * NANOSECONDS + STEP


@pytest.mark.parametrize(("seconds", "silence"), [(0.01, 15.0), (0.0, 60.0)])
def test_a_controller_that_sends_nothing(seconds, silence):
    """It may use 15 s of its own time, and 60 s of simulated time."""
    world = Driving(False, seconds)
    message = world.watch(WAVE)
    assert message.startswith("the node runs, but sent no command on /car/mux/")
    assert message.endswith("for 15 s, or for 60 s of simulated time; it publishes nothing")
    assert world.silence == pytest.approx(silence, abs=0.05)


def test_a_fault_or_the_end_of_a_node():
    assert Driving(False, 0.0).watch(WAVE, has_ended=True) == "it has ended"
    world = Driving(True, 0.0)
    world.fault_found = "it is too fast"
    assert world.watch(WAVE) == "it is too fast"


@pytest.mark.parametrize(("since", "expected"), [(0, True), (1, True), (100, False), (199, False)])
def test_the_end_of_a_drive(since, expected):
    """The car has stood for 2 s; a pause in a drive is shorter."""
    sent = [SimpleNamespace(arrived=0, speed=1.0)]
    states = [SimpleNamespace(pose=min(number, 300 + since)) for number in range(501)]
    received = SimpleNamespace(commands=sent)
    world = SimpleNamespace(received=received, now=2 * watch.REST, states=states)
    assert watch.has_followed(world) == expected


@pytest.mark.parametrize("sent", [(), ((0, 0.0),), ((0, 0.0), (2 * watch.REST, 1.0))])
def test_a_car_that_has_not_driven_yet(sent):
    """It stands, but the drive has not ended; a command to stand is no drive."""
    received = SimpleNamespace(commands=[SimpleNamespace(arrived=a, speed=s) for a, s in sent])
    standing = 300 * [SimpleNamespace(pose=0)]
    world = SimpleNamespace(received=received, now=3 * watch.REST, states=standing)
    assert not watch.has_followed(world)


def test_a_node_that_sends_one_command_less_and_no_stop():
    """The checks allow both, so it has driven the plan."""
    world = World(commands()[:-1])
    assert world.watch(PLAN) == ""
    assert world.silence == pytest.approx(watch.DONE_AFTER, abs=0.06)


class Stopping(World):
    """The same, but the node sends some stops, and then other commands."""

    def __init__(self, count, others):
        super().__init__([])
        stop = commands()[0]._replace(speed=0.0, steering_angle=0.0)
        times = [stop.time - COMMAND_PERIOD * number for number in range(count, 0, -1)]
        self._left = [*(stop._replace(time=time) for time in times), *others]

    def observe(self, pace, left):
        self.silence += 0.05
        self.ran += 0.05
        if self._left:
            self.received.commands.append(self._left.pop(0))
            self.count, self.silence = self.count + 1, 0.0


def test_stops_before_the_plan_are_no_part_of_the_drive():
    """They may last as long as the limit of the drive, here 7.6 s."""
    world = Stopping(74, commands())
    assert world.watch(PLAN) == ""
    assert len(world.received.commands) == 74 + len(commands())


@pytest.mark.parametrize("exercise", [PLAN, WAVE])
def test_a_node_that_sends_only_stops(exercise, monkeypatch):
    monkeypatch.setattr(watch, "has_followed", lambda world: False)
    monkeypatch.setattr(Stopping, "time_left", 0)
    assert "still sends commands" in Stopping(2000, []).watch(exercise)


def test_a_plan_of_one_command():
    """A node that begins late has not driven it."""
    plan = PLAN._replace(rows=PLAN.rows[:1])
    plan = plan._replace(rows=(plan.rows[0]._replace(duration=COMMAND_PERIOD),))
    assert "sent no command" in World([]).watch(plan)
