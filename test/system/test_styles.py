"""Nodes that wait in many ways send their commands at the same instants in each replay."""

import pytest

from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.stamps import COMMAND_PERIOD
from support import styles
from support.controllers import replay


def full(*names):
    return [pytest.param(name, marks=pytest.mark.full) for name in names]


EXACT = [
    *("time_sleep", "thread_event", "asyncio", "poll_busy_no_stamp", "forks", "pool", "parameters"),
    *full("pool_before", "child_places", "reads_the_time_before", "service"),
    *full("due_since_the_start", "files", "stops_for_ever"),
    *full("datetime", "clock_gettime", "select", "timer", "thread_sleep_no_stamp", "queue"),
    *full("pose_listener_time_sleep", "event_wait", "wall_rate", "computes"),
    *full("connect_poll_busy", "lingers"),
]


def judge(folder, parts):
    """Return the judgement on a node with parts of its own."""
    plan, path = folder / "plan.txt", folder / "path_publisher.py"
    plan.write_text(styles.PLAN)
    path.write_text(styles.source(parts))
    path.chmod(0o755)
    return replay(path, read_plan(plan))


@pytest.mark.parametrize("name", EXACT)
def test_exact(tmp_path, name):
    judgement = judge(tmp_path, styles.RIGHT[name])
    assert judgement.passed, judgement.verdict
    arrivals = [sent.arrived for sent in judgement.recorded.sent]
    steps = {later - earlier for earlier, later in zip(arrivals, arrivals[1:])}
    assert steps == {COMMAND_PERIOD}
    assert not judgement.notes


def test_messages_of_a_node_to_itself(tmp_path):
    """The clock stands while they are on their way, so each row has its commands in its time.

    A row can begin 0.1 s late, in ROS as here: SimpleActionServer looks for a goal, and then waits
    for 0.1 s. It misses the notification of a goal that arrives between the two.
    """
    judgement = judge(tmp_path, styles.RIGHT["actions"])
    assert judgement.passed, judgement.verdict


WAITS = "the node sends commands while the simulated clock stands, so it waits"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        pytest.param("child_sleeps", WAITS, marks=pytest.mark.full),
        pytest.param("child_timeout", WAITS, marks=pytest.mark.full),
        pytest.param("alarm", WAITS, marks=pytest.mark.full),
        pytest.param(
            "endless_burst",
            "the node sends more than 1000 commands per second; expected ten",
            marks=pytest.mark.full,
        ),
        ("wall_stamps", "row 1 (1 s): the stamp of message 1 is wall-clock time, such as time.tim"),
    ],
)
def test_wrong(tmp_path, name, message):
    parts, check = styles.WRONG[name]
    judgement = judge(tmp_path, parts)
    (found,) = (each for each in judgement.checks if each.name == check)
    assert not found.passed and found.message.startswith(message), judgement.verdict


def test_a_node_that_ends_at_once(tmp_path):
    """Its commands are received before the end is judged."""
    parts, _ = styles.WRONG["burst_future_stamps"]
    node, *_ = judge(tmp_path, parts).checks
    assert node.passed, node.message
