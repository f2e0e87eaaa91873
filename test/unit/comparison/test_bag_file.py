"""Drives in bags: types of poses, compression, names of topics, and files that are no such bag."""

import random

import numpy as np
import pytest
import rosbag
import rospkg
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.bag_file import Source, read_bag, record
from mushr_ros_intro.comparison.drive_log import drive_log
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose, compose, inverse
from mushr_ros_intro.ros import conversions
from support.cars import plan_of
from support.recorded_drive import commands_of, received

CAR = Car()
PLAN = plan_of("1, 2, 0.5\n0.5, 0.1, 2")
COMMANDS, POSES = received(PLAN, CAR, random.Random(1))
LOG = drive_log("a.bag", COMMANDS, POSES, CAR.command_timeout)

ODOM = Pose(3.0, -1.0, 2.0)
"""The origin of the odometry in the map."""

TF_ROUNDING = 1000
"""[ns] tf2 returns the stamp of a transform as a float, in seconds."""

NEAR = 1e-9
"""[m, rad] A pose as a quaternion and back."""


def transform(stamp, parent, child, pose):
    msg = TransformStamped()
    msg.header = conversions._header(stamp, parent)
    msg.child_frame_id = child
    position = conversions.pose_to_msg(pose)
    msg.transform.rotation = position.orientation
    translation = msg.transform.translation
    translation.x, translation.y = position.position.x, position.position.y
    return TFMessage([msg])


def stamped(kind, stamp, pose):
    msg = kind()
    msg.header = conversions._header(stamp)
    planar = conversions.pose_to_msg(pose)
    if kind is PoseStamped:
        msg.pose = planar
    else:
        msg.pose.pose = planar
    return msg


def write(path, kind=PoseStamped, compression="none", commands="/commands"):
    """Write the drive as a bag; `kind` is the type of the poses."""
    with rosbag.Bag(str(path), "w", compression=compression) as bag:
        for command in commands_of(PLAN):
            msg = conversions.command_to_msg(command, "base")
            bag.write(commands, msg, conversions.time_from(command.stamp))
        first = POSES.stamps[0]
        if kind is TFMessage:
            static = transform(first, "map", "odom", ODOM)
            bag.write("/tf_static", static, conversions.time_from(first))
        for stamp, pose in zip(POSES.stamps, POSES.values):
            if kind is TFMessage:
                moved = compose(inverse(ODOM), Pose(*pose))
                msg, topic = transform(stamp, "/odom", "base", moved), "/tf"
            else:
                msg, topic = stamped(kind, stamp, Pose(*pose)), "/pose"
            bag.write(topic, msg, conversions.time_from(stamp))
    return str(path)


def assert_same(log):
    assert [row[:3] for row in log.plan.rows] == [row[:3] for row in LOG.plan.rows]
    assert np.abs(log.stamps - LOG.stamps).max() < TF_ROUNDING
    for (x, y, theta), expected in zip(log.poses.tolist(), LOG.poses.tolist()):
        assert (x, y, theta) == pytest.approx(expected, abs=NEAR)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        (PoseStamped, "none"),
        (PoseWithCovarianceStamped, "lz4"),
        (Odometry, "bz2"),
        (TFMessage, "none"),
    ],
)
def test_poses_of_each_type(tmp_path, kind, compression):
    path = write(tmp_path / "a.bag", kind, compression)
    frames = ("map", "base") if kind is TFMessage else None
    assert_same(read_bag(path, Source("/commands", "/pose", frames), CAR.command_timeout))


def test_a_missing_topic_or_frame_is_named_with_what_the_bag_has(tmp_path):
    path = write(tmp_path / "a.bag")
    for source, expected in [
        (Source("/output", "/pose"), "/output is not in the bag; .* has /commands"),
        (Source("/commands", "/pse"), r"/pse is not in the bag; .* has /pose \(geometry_msgs/Pos"),
        (Source("/pose", "/pose"), "/pose is of the type geometry_msgs/PoseStamped; expected one"),
        (Source("/commands", "", ("map", "base")), "no transform from map to base"),
    ]:
        with pytest.raises(UserError, match=f"^{path}: .*{expected}"):
            read_bag(path, source, CAR.command_timeout)


def test_files_that_are_no_bag_of_a_drive(tmp_path):
    whole = write(tmp_path / "a.bag")
    with open(whole, "rb") as file:
        data = file.read()
    for content, expected in [
        (b"", "cannot be read"),
        (b"0, 0, 0\n2, 0.1\n", "cannot be read"),
        (data[: len(data) // 2], "rosbag reindex"),
        (data[:5000], "rosbag reindex"),
    ]:
        path = tmp_path / "wrong.bag"
        path.write_bytes(content)
        with pytest.raises(UserError, match=f"^{path}: .*{expected}"):
            read_bag(str(path), Source("/commands", "/pose"), CAR.command_timeout)
    with pytest.raises(UserError, match="No such file"):
        read_bag(str(tmp_path / "none.bag"), Source("/commands", "/pose"), CAR.command_timeout)
    empty = str(tmp_path / "empty.bag")
    rosbag.Bag(empty, "w").close()
    with pytest.raises(UserError, match="/commands is not in the bag; .* has none"):
        read_bag(empty, Source("/commands", "/pose"), CAR.command_timeout)


def test_the_pose_may_be_that_of_a_point_in_front_of_the_rear_axle(tmp_path):
    source = Source("/commands", "/pose", pose_offset=0.5)
    log = read_bag(write(tmp_path / "a.bag"), source, CAR.command_timeout)
    x, y, theta = LOG.poses.T
    expected = np.column_stack([x - 0.5 * np.cos(theta), y - 0.5 * np.sin(theta), theta])
    assert log.poses == pytest.approx(expected, abs=NEAR)


@pytest.mark.parametrize("found", [[], ["/a/record", "/b/record"], None])
def test_rosbag_record_is_missing_or_there_twice(tmp_path, monkeypatch, found):
    def find_node(*_):
        if found is None:
            raise rospkg.ResourceNotFound("rosbag")
        return found

    monkeypatch.setattr("roslib.packages.find_node", find_node)
    with pytest.raises(UserError, match="--record: .*(none|/a/record, /b/record)"):
        record(str(tmp_path / "a.bag"), Source("/c", "/p", None, 0.0), 1.0)
