"""Send messages with odd numbers to the nodes of the car, and to those that create plans."""

import copy
import itertools
import math

import genpy
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from sensor_msgs.msg import JointState, LaserScan

from support.driven_car import start_car
from support.geometry import POSITION_TOLERANCE, planar
from support.helpers import Recording, RosTestCase, node, publisher, wait_for
from support.messages import MUX, NAVIGATION, OUTPUT, command, placement
from support.world import load

FLOATS = [math.nan, math.inf, 3e38, 1e30, -1e30, 5e-324, 1e308]
INTEGERS = {"uint": [0, 1, 2**31, 2**32 - 1], "int": [0, 1, -1, 127, -128]}

OUTPUTS = {
    "/car/car_pose": PoseStamped,
    "/car/odom": Odometry,
    "/car/joint_states": JointState,
    "/car/scan": LaserScan,
    OUTPUT: AckermannDriveStamped,
    "/click_planner/path": Path,
}


def numbers_in(msg):
    """Yield the numbers of a message as (owner, field or index, type).

    Of an array, yield the first and the last one.
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


def odd_messages(good):
    """Yield copies of a good message, each with one odd number."""
    for index, number in itertools.product(range(len(list(numbers_in(good)))), range(len(FLOATS))):
        msg = copy.deepcopy(good)
        owner, field, kind = list(numbers_in(msg))[index]
        values = FLOATS if kind.startswith("float") else INTEGERS[kind.rstrip("0123456789[]")]
        value = values[number % len(values)]
        if kind.startswith("float32") and abs(value) > 3.4e38 and math.isfinite(value):
            continue  # no such float32 exists
        if isinstance(owner, list):
            owner[field] = value
        else:
            setattr(owner, field, value)
        yield msg


def good_messages():
    """Return a valid message for each topic that a node subscribes to."""
    now = rospy.Time.now()
    point = PointStamped()
    point.header.stamp, point.header.frame_id = now, "map"
    point.point.x = point.point.y = 1.0
    grid = OccupancyGrid()
    grid.header.stamp, grid.header.frame_id = now, "map"
    grid.info.width, grid.info.height, grid.info.resolution = 3, 2, 1.0
    grid.info.origin.position.x = 100.0
    grid.info.origin.orientation.w = 1.0
    grid.data = [0, 100, -1, 0, 0, 0]
    pose = PoseStamped()
    pose.header.stamp, pose.header.frame_id = now, "map"
    pose.pose.position.x, pose.pose.orientation.w = 1.0, 1.0
    return {
        "/car/car_pose": pose,
        NAVIGATION: command(now, 1.0, 0.2),
        OUTPUT: command(now, 1.0, 0.2),
        "/initialpose": placement(now, 1.0, 2.0, 0.5),
        "/clicked_point": point,
        "/map": grid,
    }


def start_world():
    load("ackermann_cmd_mux.yaml", MUX)
    load("laser.yaml", "/car/laser_sim")
    return []


class TestOddMessages(RosTestCase):
    def test_any_number_in_any_message(self):
        nodes = [*start_car(), node("laser_sim.py", "__ns:=/car")]
        for name in ("click_planner.py", "plan_recorder.py"):
            nodes.append(node(name, f"_folder:={self.folder}"))
        for each in nodes:
            self.ending(each)
        outputs = [Recording(topic, kind).connected() for topic, kind in OUTPUTS.items()]
        poses, passed = outputs[0], outputs[4]
        wait_for(lambda: poses.last, "the car to be ready")
        goods = good_messages()
        publishers = {topic: publisher(topic, type(msg)) for topic, msg in goods.items()}
        for topic, good in goods.items():
            for msg in odd_messages(good):
                publishers[topic].publish(msg)
                rospy.sleep(0.001)  # a queue holds a hundred messages
            publishers[topic].publish(goods[topic])

        def is_placed():
            """Place the car again: odd commands, whose stamps may be later, can still drive it."""
            publishers["/initialpose"].publish(placement(rospy.Time.now(), 7.0, 8.0, 0.5))
            return math.dist(planar(poses.last.pose)[:2], (7.0, 8.0)) < POSITION_TOLERANCE

        publishers["/map"].publish(goods["/map"])
        wait_for(is_placed, "the car to be placed")
        sent = command(rospy.Time.now(), 1.0, 0.2)
        publishers[NAVIGATION].publish(sent)
        passed.first(lambda msg: msg.header.stamp == sent.header.stamp, "the mux to pass a command")

        def drives():
            """Send a command again: on a busy machine, an initial pose can apply after it."""
            publishers[NAVIGATION].publish(command(rospy.Time.now(), 1.0, 0.2))
            return abs(poses.last.pose.position.x - 7.0) > 0.01

        wait_for(drives, "the car to drive")
        for each in nodes:
            self.assertTrue(each.running)
            self.assertNotIn("Traceback", each.output)
        for output in outputs:
            for msg in output.messages:
                if msg._connection_header["callerid"] == rospy.get_name():
                    continue
                for owner, field, _ in numbers_in(msg):
                    value = owner[field] if isinstance(owner, list) else getattr(owner, field)
                    # A range is infinite if there is nothing to measure (REP 117).
                    is_range = isinstance(msg, LaserScan) and math.isinf(value)
                    if not math.isfinite(value) and not is_range:
                        self.fail(f"{output.topic}: {msg}")
        for recording in outputs[:-1]:
            self.assertTrue(recording.messages, recording.topic)
