"""Whatever numbers a message holds, no node stumbles over it, and no pose is lost by it."""

import copy
import io
import itertools
import math
import re

import genpy
import numpy as np
import pytest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from roslib.message import get_message_class
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.world.grid import Grid
from support.fake_ros import Ros
from support.helpers import module

ODD = {
    "float": [math.nan, math.inf, -math.inf, 3e38, 1e30, -1e30, 1e6, -0.0, 1e-45, 5e-324, 1e308],
    "uint": [0, 1, 2**31, 2**32 - 1],
    "int": [0, 1, -1, 127, -128],
}

NODES = {
    "ackermann_cmd_mux.py": lambda made: made.AckermannCmdMux(),
    "car_sim.py": lambda made: made.CarSim(keeps_clock=False),
    "click_planner.py": lambda made: made.ClickPlanner(),
    "laser_sim.py": lambda made: made.LaserSim(),
    "path_publisher.py": lambda made: made.PathPublisher(),
    "plan_recorder.py": lambda made: made.PlanRecorder(),
}


def numbers_in(msg):
    """Return where the numbers of a message are: (owner, name of a field or index, type).

    Of an array, where the first and the last are.
    """
    for name, kind in zip(msg.__slots__, msg._slot_types):
        value = getattr(msg, name)
        if isinstance(value, genpy.TVal):
            yield from ((value, part, "uint32") for part in ("secs", "nsecs"))
        elif isinstance(value, genpy.Message):
            yield from numbers_in(value)
        elif isinstance(value, (int, float)):
            yield msg, name, kind
        elif isinstance(value, (list, tuple)) and value:
            if isinstance(value[0], genpy.Message):
                yield from (found for each in (value[0], value[-1]) for found in numbers_in(each))
            elif isinstance(value[0], (int, float)):
                setattr(msg, name, list(value))
                yield from ((getattr(msg, name), index, kind) for index in (0, len(value) - 1))


def good_message(kind, now):
    """Return a message that a node obeys."""
    msg = get_message_class(kind._type)()
    if hasattr(msg, "header"):
        msg.header.stamp = genpy.Time(0, now)
        msg.header.frame_id = "map"
    if isinstance(msg, AckermannDriveStamped):
        msg.drive.speed, msg.drive.steering_angle = 1.0, 0.2
    elif isinstance(msg, PoseStamped):
        msg.pose.orientation.w = 1.0
    elif isinstance(msg, PoseWithCovarianceStamped):
        msg.pose.pose.orientation.w = 1.0
    elif isinstance(msg, PointStamped):
        msg.point.x = msg.point.y = 1.0
    elif isinstance(msg, OccupancyGrid):
        msg.info.width, msg.info.height, msg.info.resolution = 3, 2, 1.0
        msg.info.origin.orientation.w = 1.0
        msg.data = [0, 100, -1, 0, 0, 0]
    else:
        assert isinstance(msg, String)
        msg.data = "a"
    return msg


def received(kind, msg):
    """Return a message as a subscriber that wants it as a `kind` gets it."""
    wire = io.BytesIO()
    msg.serialize(wire)
    came = kind()
    came.deserialize(wire.getvalue())
    came._connection_header = {"topic": "/some/topic"}
    return came


def odd_messages(kind, now):
    """Return good messages of which each has one odd number."""
    good = good_message(kind, now)
    count = len(list(numbers_in(good)))
    for index, number in itertools.product(range(count), range(max(map(len, ODD.values())))):
        msg = copy.deepcopy(good)
        owner, name, slot_type = list(numbers_in(msg))[index]
        values = ODD[re.match("float|uint|int", slot_type).group()]
        value = values[number % len(values)]
        if slot_type == "float32" and abs(value) > 3.4e38 and math.isfinite(value):
            continue  # cannot be sent
        if isinstance(owner, list):
            owner[name] = value
        else:
            setattr(owner, name, value)
        yield msg


def check_published(ros, topic):
    """See that all is finite that a node has published after a message on a topic."""
    for msg in ros.published:
        for owner, field, _ in numbers_in(msg):
            value = owner[field] if isinstance(owner, list) else getattr(owner, field)
            # A range is infinite where there is nothing to measure (REP 117).
            assert math.isfinite(value) or isinstance(msg, LaserScan) and math.isinf(value), topic
    ros.published.clear()


@pytest.mark.parametrize("name", sorted(NODES))
def test_any_number_in_any_message(monkeypatch, name):
    ros = Ros(monkeypatch)
    made = module(name)
    monkeypatch.setattr(made, "wait_until_connected", lambda *_: True, raising=False)
    node = NODES[name](made)
    assert ros.inputs
    for topic, kind, callback, arguments in sorted(ros.inputs, key=lambda each: each[0]):
        for each in odd_messages(kind, ros.now):
            for msg in (each, good_message(kind, ros.now)):
                callback(received(kind, msg), *arguments)
            ros.now += 10**8
            if name == "car_sim.py":
                node._publish(node._history.state_at(node._read_clock()))
            elif name == "ackermann_cmd_mux.py":
                node._expire(node._read_clock())
            check_published(ros, topic)


@pytest.mark.parametrize("side", [1, 10_000])
@pytest.mark.parametrize("name", ["car_sim.py", "laser_sim.py"])
def test_a_map_of_nothing_but_walls(monkeypatch, name, side):
    """Of one cell or of a hundred million: the node goes on, and the car is somewhere."""
    ros = Ros(monkeypatch)
    node = NODES[name](module(name))
    calls = {topic: (callback, arguments) for topic, _, callback, arguments in ros.inputs}

    def receive(topic, msg):
        callback, arguments = calls[topic]
        callback(msg, *arguments)

    cells, corner = np.full((side, side), 100, np.int8), -0.5 * side
    receive("/map", conversions.grid_to_msg(Grid(cells, 1.0, Pose(corner, corner, 0.0)), 1, "map"))
    if name == "car_sim.py":
        receive("mux/ackermann_cmd_mux/output", good_message(AckermannDriveStamped, ros.now))
        ros.now += 10**8
        node._publish(node._history.state_at(node._read_clock()))
        assert any(isinstance(msg, PoseStamped) for msg in ros.published)
    else:
        receive("car_pose", good_message(PoseStamped, ros.now))
        assert set(ros.published[-1].ranges) == {-math.inf}
    check_published(ros, "/map")
