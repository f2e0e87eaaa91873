"""Check what a replay knows about the threads of the node, and when it gives and takes messages."""

import os
from queue import Queue
from types import SimpleNamespace

import pytest

from mushr_ros_intro.replay.due_times import DueTimes
from mushr_ros_intro.replay.mistakes import COMMAND_TYPE, POSE_TYPE, command_topic_mistake
from mushr_ros_intro.replay.pace import STEP
from mushr_ros_intro.replay.path_delivery import PathDelivery
from mushr_ros_intro.replay.received import CONTROL
from mushr_ros_intro.replay.world import CLOSE_LOOKS, wait_until_closed
from mushr_ros_intro.ros import ros_time
from support.controllers import WAVE
from support.helpers import PATIENCE

MS = 1_000_000
NOW = 1010 * MS


@pytest.mark.parametrize(
    ("said", "period", "expected"),
    [
        (b"", None, None),
        (bytes(8), None, None),
        ((NOW + 30 * MS).to_bytes(8, "little"), None, 30 * MS),
        ((NOW - 30 * MS).to_bytes(8, "little"), None, -30 * MS),
        (b"", 20 * MS, 10 * MS),
        ((NOW + 30 * MS).to_bytes(8, "little"), 20 * MS, 10 * MS),
        ((NOW + 5 * MS).to_bytes(8, "little"), 20 * MS, 5 * MS),
        ((NOW + 5 * MS).to_bytes(8, "little") + (NOW + 9 * MS).to_bytes(8, "little"), None, 9 * MS),
    ],
)
def test_when_the_next_thread_is_due(said, period, expected):
    """A node that receives the poses gets each of them when the car reports it, every 20 ms."""
    due_times = DueTimes()
    os.write(due_times.file, said)
    assert due_times.time_left(NOW, period) == expected
    assert due_times.time_left(NOW, period) == expected  # what the node has written last counts
    assert not due_times.wait(0.0)
    os.write(due_times.file, NOW.to_bytes(8, "little"))
    assert due_times.wait(0.0) and not due_times.wait(0.0)


@pytest.mark.parametrize(
    ("topics", "has_start", "end"),
    [
        ({"/initialpose": POSE_TYPE}, False, "no message arrived: does it call publish?"),
        ({}, True, "no message arrived: does it call publish?"),
        (
            {"/initial_pose": POSE_TYPE},
            False,
            "it does not publish /initialpose (only this node is run, no other node of a launch "
            f"file); it publishes {CONTROL}, /initial_pose: does it wait for a subscriber there?",
        ),
        (
            {"/initialpose": "geometry_msgs/PoseStamped"},
            False,
            f"publishes geometry_msgs/PoseStamped on /initialpose, not {POSE_TYPE}: does it wait "
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
    looks = []

    def are_waiting():
        looks.append(len(looks) + 1)
        return looks[-1] != busy

    monkeypatch.setattr(ros_time, "POLL_PERIOD", 0.0)
    wait_until_closed(lambda: len(looks) < closed, are_waiting)
    assert len(looks) == expected


SERVICE = "/car/controller/follow_path"


@pytest.mark.parametrize(
    ("now", "services", "expected"),
    [
        (1000 * MS, {}, ([2], [])),
        (1000 * MS, {"/other": None, SERVICE: None}, ([1], [SERVICE])),
        (1000 * MS + STEP, {SERVICE: None}, ([], [])),
        (1000 * MS + STEP, {}, ([], [])),
    ],
)
def test_the_path_arrives_at_a_whole_second(monkeypatch, now, services, expected):
    """In the service of the node, if it has one; and once."""
    called = Queue()
    topic = SimpleNamespace(get_num_connections=lambda: 2, publish=lambda _: None)
    monkeypatch.setattr("rospy.Publisher", lambda *_, **__: topic)
    monkeypatch.setattr("rospy.ServiceProxy", lambda name, _: lambda _: called.put(name))
    delivery = PathDelivery(WAVE, 0, services)
    given, names = expected
    assert list(delivery.give(now)) == given
    assert [called.get(timeout=PATIENCE) for _ in names] == names
    assert not given or list(delivery.give(now)) == []
