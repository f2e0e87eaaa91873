"""Check what a replay knows about the threads of the node."""

import os
from types import SimpleNamespace

import pytest

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
