"""Check what a replay knows about the threads of the node."""

import math
import os
import threading
from types import SimpleNamespace
from unittest import mock

import pytest

from mushr_ros_intro.car import model
from mushr_ros_intro.replay import follow_world
from mushr_ros_intro.replay.due_times import DueTimes
from mushr_ros_intro.replay.follow_world import REST, FollowWorld
from mushr_ros_intro.replay.mistakes import COMMAND_TYPE, POSE_TYPE, command_topic_mistake
from mushr_ros_intro.replay.pace import STEP
from mushr_ros_intro.replay.received import CONTROL, Received
from mushr_ros_intro.replay.world import CLOSE_LOOKS, START, ReplayWorld
from mushr_ros_intro.ros import conversions, ros_time

MS = 1_000_000
NOW = 1010 * MS


@pytest.mark.parametrize(
    ("said", "connections", "expected"),
    [
        (b"", 0, None),
        (bytes(8), 0, None),
        ((NOW + 30 * MS).to_bytes(8, "little"), 0, 30 * MS),
        ((NOW - 30 * MS).to_bytes(8, "little"), 0, -30 * MS),
        (b"", 1, 10 * MS),
        ((NOW + 30 * MS).to_bytes(8, "little"), 1, 10 * MS),
        ((NOW + 5 * MS).to_bytes(8, "little"), 1, 5 * MS),
        ((NOW + 5 * MS).to_bytes(8, "little") + (NOW + 9 * MS).to_bytes(8, "little"), 0, 9 * MS),
    ],
)
def test_when_the_next_thread_is_due(said, connections, expected):
    """A node that receives the poses gets each of them when the car reports it, every 20 ms."""
    world = ReplayWorld.__new__(ReplayWorld)
    world.due_times, world.now = DueTimes(), NOW
    os.write(world.due_times.file, said)
    world._car = SimpleNamespace(count_connections=lambda: connections, pose_period=20 * MS)
    assert world._time_until_due == expected
    assert world._time_until_due == expected  # what the node has written last counts
    assert not world.due_times.wait(0.0)
    os.write(world.due_times.file, NOW.to_bytes(8, "little"))
    assert world.due_times.wait(0.0) and not world.due_times.wait(0.0)


@pytest.mark.parametrize(("since", "expected"), [(0, True), (1, True), (100, False), (199, False)])
def test_the_end_of_a_drive(since, expected):
    """The car has stood for 2 s; a pause in a drive is shorter."""
    sent = [SimpleNamespace(arrived=0, speed=1.0)]
    states = [SimpleNamespace(pose=min(number, 300 + since)) for number in range(501)]
    received = SimpleNamespace(commands=sent)
    world = SimpleNamespace(received=received, now=2 * REST, states=states)
    assert FollowWorld.stands.fget(world) == expected


@pytest.mark.parametrize("commands", [(), ((0, 0.0),), ((0, 0.0), (2 * REST, 1.0))])
def test_a_car_that_has_not_driven_yet(commands):
    """It stands, but the drive has not ended; a command to stand is no drive."""
    sent = [SimpleNamespace(arrived=arrived, speed=speed) for arrived, speed in commands]
    received = SimpleNamespace(commands=sent)
    world = SimpleNamespace(received=received, now=3 * REST, states=300 * [SimpleNamespace(pose=0)])
    assert not FollowWorld.stands.fget(world)


@pytest.mark.parametrize(
    ("topics", "has_start", "end"),
    [
        ({"/initialpose": POSE_TYPE}, False, "no message arrived: does it call publish?"),
        ({}, True, "no message arrived: does it call publish?"),
        (
            {"/initial_pose": POSE_TYPE},
            False,
            f"sent no start pose on /initialpose; it publishes {CONTROL}, /initial_pose: does it "
            "wait for a subscriber there?",
        ),
        (
            {"/initialpose": "geometry_msgs/PoseStamped"},
            False,
            f"published geometry_msgs/PoseStamped on /initialpose, not {POSE_TYPE}: does it wait "
            "for a subscriber there?",
        ),
    ],
)
def test_a_node_that_sends_no_command(topics, has_start, end):
    """It often waits for a subscriber of a wrong start pose topic; then publish is not called."""
    mistake = command_topic_mistake({**topics, CONTROL: COMMAND_TYPE}, CONTROL, has_start)
    assert mistake.endswith(end)


@pytest.mark.parametrize(
    ("closed", "busy", "expected"),
    [
        pytest.param(0, None, 0, id="it has closed its connection"),
        pytest.param(7, None, 7, id="it closes its connection"),
        pytest.param(1000, None, CLOSE_LOOKS, id="a child process holds its connection"),
        pytest.param(1000, 60, 60 + CLOSE_LOOKS, id="a message arrives late"),
    ],
)
def test_the_last_messages_of_a_node_that_has_ended(monkeypatch, closed, busy, expected):
    """They are received before the end is judged; nothing may arrive for CLOSE_LOOKS looks."""
    looks, processed = [], []

    def are_waiting():
        looks.append(len(looks) + 1)
        return looks[-1] != busy

    world = ReplayWorld.__new__(ReplayWorld)
    world._others = SimpleNamespace(are_waiting=are_waiting)
    link = SimpleNamespace(get_num_connections=lambda: int(len(looks) < closed))
    world._mux = SimpleNamespace(inputs={CONTROL: link})
    world._process = lambda: processed.append(len(looks))
    world.received = SimpleNamespace(commands=[None])
    monkeypatch.setattr(ros_time, "POLL_PERIOD", 0.0)
    process = SimpleNamespace(describe_failure=lambda: f"judged after {processed}")
    assert world.describe_end(process) == f"judged after [{expected}]"


def test_the_recording_has_what_the_master_observed():
    world = ReplayWorld.__new__(ReplayWorld)
    world._car, world._grid = SimpleNamespace(corrected_states=list), None
    world.received = Received()
    world._master = SimpleNamespace(actions=["a"], published={"/b": "c"}, plan_is_read=False)
    seen = world.recording(None, model.Car(), "")
    assert (seen.actions, seen.published, seen.plan_is_read) == (("a",), (("/b", "c"),), False)


SERVICE = "/car/controller/follow_path"


@pytest.mark.parametrize(
    ("now", "services", "expected"),
    [
        (1000 * MS, {}, ([2], "")),
        (1000 * MS, {"/other": None, SERVICE: None}, ([1], SERVICE)),
        (1000 * MS + STEP, {SERVICE: None}, ([], "")),
        (1000 * MS + STEP, {}, ([], "")),
    ],
)
def test_the_path_arrives_at_a_whole_second(now, services, expected):
    """In the service of the node, if it has one."""
    world = object.__new__(FollowWorld)
    world._has_path, world._service, world._has_service = False, "", threading.Event()
    world.now, world._path = now, None
    world._paths = SimpleNamespace(get_num_connections=lambda: 2, publish=lambda _: None)
    world._master = SimpleNamespace(services=SimpleNamespace(map=services))
    assert (list(world._give()), world._service) == expected
    assert world._has_service.is_set() == bool(world._service)


class Driving(FollowWorld):
    """A world whose node drives on, or sends nothing; it uses `seconds` of each step of the clock.

    Its path takes 10 s.
    """

    usages, fault_found = {}, ""
    topic_mistake = "it publishes nothing"

    def __init__(self, drives, seconds):
        self._reference = SimpleNamespace(duration=10_000 * MS)
        self.drives, self.seconds = drives, seconds
        self.now, self.ran, self.received, self.states, self.count = START, 0.0, Received(), [], 0

    def observe(self, pace, left):
        self.now, self.ran = self.now + STEP, self.ran + self.seconds
        assert self.now < START + 100_000 * MS, "the replay does not end"
        self.states.append(SimpleNamespace(pose=self.drives * self.now))
        if self.drives:
            self.received.commands.append(SimpleNamespace(arrived=self.now, speed=1.0))
            self.count += 1

    def fault(self, pace):
        return self.fault_found

    def describe_end(self, process):
        return "it has ended"

    def follow(self, has_ended=False):
        """Return what `watch` returns, and how long the node had sent nothing [s]."""
        process = SimpleNamespace(has_ended=has_ended, threads=self)
        with mock.patch.object(follow_world, "CHECK_PERIOD", math.inf):
            return self.watch(process, 15.0), self.silence


def test_a_node_that_drives_on():
    """At most three times the duration of the path, and 5 s: at the same instant in all runs."""
    world = Driving(True, 0.0)
    assert world.follow()[0] == "the node still drives after 35 s"
    assert world.now == START + STEP + 35_000 * MS + STEP


@pytest.mark.parametrize(("seconds", "silence"), [(0.01, 15.0), (0.0, 60.0)])
def test_a_node_that_sends_nothing(seconds, silence):
    """It may use 15 s of its own time, and 60 s of simulated time."""
    message, found = Driving(False, seconds).follow()
    assert message.startswith("the node runs, but sent no command on /car/mux/")
    assert message.endswith("for 15 s, or for 60 s of simulated time; it publishes nothing")
    assert found == pytest.approx(silence, abs=0.05)


def test_a_fault_or_the_end_of_a_node():
    world = Driving(False, 0.0)
    assert world.follow(has_ended=True)[0] == "it has ended"
    world = Driving(True, 0.0)
    world.fault_found = "it is too fast"
    assert world.follow()[0] == "it is too fast"


@pytest.mark.parametrize(
    ("stamp", "expected"),
    [(0, NOW), (NOW - 20 * MS, NOW), (NOW - 900 * MS, NOW), (NOW, NOW), (NOW + MS, NOW + MS)],
)
def test_when_a_command_of_a_controller_applies(stamp, expected):
    """The controller has seen the past, so no stamp of a command can change it."""
    msg = conversions.command_to_msg(model.Command(stamp, 1.0, 0.1), "")
    msg._connection_header = {"topic": CONTROL}
    forwarded = []
    world = object.__new__(FollowWorld)
    world.now, world.received = NOW, Received(begin=NOW)
    world._mux = SimpleNamespace(on_command=lambda msg, _: forwarded.append(msg.header.stamp))
    world._on_command(msg, None)
    assert [each.to_nsec() for each in forwarded] == [expected]
    assert [each.time for each in world.received.commands] == [expected]
