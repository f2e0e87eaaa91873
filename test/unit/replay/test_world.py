"""Check what a replay knows about the threads of the node."""

import os
from types import SimpleNamespace

import pytest

from mushr_ros_intro.car import model
from mushr_ros_intro.replay.follow_world import REST, FollowWorld
from mushr_ros_intro.replay.pace import STEP
from mushr_ros_intro.replay.world import CONTROL, ReplayWorld
from mushr_ros_intro.ros import conversions

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
    ],
)
def test_when_the_next_thread_is_due(said, connections, expected):
    """A node that receives the poses gets each of them when the car reports it, every 20 ms."""
    file = os.memfd_create("due")
    os.write(file, said)
    car = SimpleNamespace(count_connections=lambda: connections, pose_period=20 * MS)
    world = SimpleNamespace(due_file=file, now=NOW, _car=car)
    assert ReplayWorld._time_until_due.fget(world) == expected
    os.close(file)


@pytest.mark.parametrize(("since", "expected"), [(0, True), (1, True), (100, False), (199, False)])
def test_the_end_of_a_drive(since, expected):
    """The car has stood for 2 s; a pause in a drive is shorter."""
    sent = [SimpleNamespace(arrived=0, speed=1.0)]
    states = [SimpleNamespace(pose=min(number, 300 + since)) for number in range(501)]
    world = SimpleNamespace(sent=sent, now=2 * REST, states=states)
    assert FollowWorld.stands.fget(world) == expected


@pytest.mark.parametrize(("now", "expected"), [(1000 * MS, [2]), (1000 * MS + STEP, [])])
def test_the_path_arrives_at_a_whole_second(now, expected):
    paths = SimpleNamespace(get_num_connections=lambda: 2, publish=lambda _: None)
    master = SimpleNamespace(services=SimpleNamespace(map={}))
    world = SimpleNamespace(_has_path=False, now=now, _paths=paths, _path=None, _master=master)
    assert list(FollowWorld._give(world)) == expected


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
    world.now, world.sent, world._begin = NOW, [], NOW
    world._mux = SimpleNamespace(on_command=lambda msg, _: forwarded.append(msg.header.stamp))
    world._on_command(msg, None)
    assert [each.to_nsec() for each in forwarded] == [expected]
    assert [each.time for each in world.sent] == [expected]
