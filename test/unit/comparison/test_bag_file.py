"""Drives in bags: types of poses, compression, names of topics, and files that are no such bag."""

import random

import numpy as np
import pytest
import rosbag
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.bag_file import read_bag
from mushr_ros_intro.comparison.drive_log import drive_log
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros import conversions
from support.cars import plan_of
from support.recorded_drive import commands_of, received

CAR = Car()
PLAN = plan_of("1, 2, 0.5\n0.5, 0.1, 2")
COMMANDS, POSES = received(PLAN, CAR, random.Random(1))
LOG = drive_log("a.bag", COMMANDS, POSES, CAR.command_timeout)

NEAR = 1e-9
"""[m, rad] A pose as a quaternion and back."""


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
        for stamp, pose in zip(POSES.stamps, POSES.values):
            bag.write("/pose", stamped(kind, stamp, Pose(*pose)), conversions.time_from(stamp))
    return str(path)


def read(path, commands="/commands", pose="/pose", pose_offset=0.0):
    return read_bag(path, commands, pose, pose_offset, CAR.command_timeout)


def assert_same(log):
    assert [row[:3] for row in log.plan.rows] == [row[:3] for row in LOG.plan.rows]
    assert np.array_equal(log.stamps, LOG.stamps)
    for (x, y, theta), expected in zip(log.poses.tolist(), LOG.poses.tolist()):
        assert (x, y, theta) == pytest.approx(expected, abs=NEAR)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        (PoseStamped, "none"),
        pytest.param(
            *(PoseWithCovarianceStamped, "lz4"),
            marks=pytest.mark.skipif(not rosbag.bag.found_lz4, reason="roslz4 is missing"),
        ),
        (Odometry, "bz2"),
    ],
)
def test_poses_of_each_type(tmp_path, kind, compression):
    path = write(tmp_path / "a.bag", kind, compression)
    assert_same(read(path))


def test_a_missing_topic_is_named_with_what_the_bag_has(tmp_path):
    path = write(tmp_path / "a.bag")
    for topics, expected in [
        (("/output", "/pose"), "/output is not in the bag; .* has /commands"),
        (("/commands", "/pse"), r"/pse is not in the bag; .* has /pose \(geometry_msgs/Pos"),
        (("/pose", "/pose"), "/pose is of the type geometry_msgs/PoseStamped; expected one"),
    ]:
        with pytest.raises(UserError, match=f"^{path}: .*{expected}"):
            read(path, *topics)


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
            read(str(path))
    with pytest.raises(UserError, match="No such file"):
        read(str(tmp_path / "none.bag"))
    empty = str(tmp_path / "empty.bag")
    rosbag.Bag(empty, "w").close()
    with pytest.raises(UserError, match="/commands is not in the bag; .* has none"):
        read(empty)


def test_the_pose_may_be_that_of_a_point_in_front_of_the_rear_axle(tmp_path):
    log = read(write(tmp_path / "a.bag"), pose_offset=0.5)
    x, y, theta = LOG.poses.T
    expected = np.column_stack([x - 0.5 * np.cos(theta), y - 0.5 * np.sin(theta), theta])
    assert log.poses == pytest.approx(expected, abs=NEAR)
