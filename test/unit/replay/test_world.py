"""Check what a replay knows about the threads of the node."""

import os
from types import SimpleNamespace

import pytest

from mushr_ros_intro.replay.follow_world import REST, FollowWorld
from mushr_ros_intro.replay.pace import STEP
from mushr_ros_intro.replay.world import ReplayWorld

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
