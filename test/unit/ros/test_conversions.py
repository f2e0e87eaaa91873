"""Values to messages and back, and the messages that are refused."""

import io
import math

import numpy as np
import pytest
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import Point, PointStamped, PoseWithCovarianceStamped, Quaternion
from geometry_msgs.msg import Pose as PoseMsg
from hypothesis import given
from hypothesis import strategies as st
from mushr_sim.srv import CarPose
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rospy.numpy_msg import numpy_msg
from vesc_msgs.msg import VescState, VescStateStamped

from mushr_ros_intro.car.model import Car, Command, InitialPose, Wheels, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.car.odometry import Odometry
from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.plan.plan import as_float32
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.conversions import MessageError
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.laser import Beams

ROUNDING = 1e-15
"""[rad] Relative to a heading within half a turn, through a quaternion and back: some ulps."""

STAMP = 1_700_000_000_123_456_789
NOT_FINITE = [math.nan, math.inf, -math.inf]
ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}

stamps = st.integers(0, 2**32 * 10**9 - 1)
poses = st.builds(Pose, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e3, 1e3))


def travelled(msg):
    """Return a message as it arrives."""
    wire = io.BytesIO()
    msg.serialize(wire)
    return type(msg)().deserialize(wire.getvalue())


def command_msg(**fields):
    """Return a command with some fields of the drive."""
    return AckermannDriveStamped(drive=AckermannDrive(**fields))


def pose_msg(**fields):
    """Return the origin with some numbers changed: x, y, z, qx, qy, qz, qw."""
    msg = PoseMsg(orientation=Quaternion(w=1.0))
    for name, value in fields.items():
        setattr(msg.orientation if name[0] == "q" else msg.position, name[-1], value)
    return msg


def test_the_messages_are_the_real_ones():
    assert AckermannDriveStamped._md5sum == "1fd5d7f58889cefd44d29f6653240d0c"
    # Those of github.com/prl-mushr: vesc and mushr_sim, branches noetic.
    assert VescState._md5sum == "81214bb4c1945e7c159bd76ec397ac04"
    assert VescStateStamped._md5sum == "3a2b3a0e5b5f10ce6bbf973d767cdc4d"
    assert CarPose._md5sum == "d3607be278658b1796ac5e670eba6ac0"


@given(stamps, st.floats(-1e3, 1e3), st.floats(-1.57, 1.57), st.tuples(*[st.floats(-9, 9)] * 2))
def test_a_command_comes_back_as_float32(stamp, speed, angle, rates):
    command = Command(stamp, speed, angle, *rates)
    msg = travelled(conversions.command_to_msg(command, "car/base_footprint"))
    assert msg.header.frame_id == "car/base_footprint"
    rounded = tuple(map(as_float32, rates))
    assert (msg.drive.acceleration, msg.drive.steering_angle_velocity) == rounded
    expected = Command(stamp, as_float32(speed), as_float32(angle), *rounded)
    assert conversions.command_from_msg(msg) == expected


@given(stamps, poses)
def test_a_placement_comes_back(stamp, pose):
    msg = PoseWithCovarianceStamped()
    msg.header.stamp, msg.header.frame_id = conversions.time_from(stamp), "map"
    msg.pose.pose = conversions.pose_to_msg(pose)
    msg = travelled(msg)
    assert msg.header.frame_id == "map"
    back = conversions.initial_pose_from_msg(msg)
    assert back.stamp == stamp and back.pose[:2] == pose[:2]
    assert abs(back.pose.theta) <= math.pi
    off = math.remainder(back.pose.theta - pose.theta, math.tau)
    assert abs(off) <= 4 * ROUNDING * max(math.pi, abs(pose.theta))


@pytest.mark.parametrize("value", NOT_FINITE)
def test_what_is_not_finite_is_refused(value):
    refused = pytest.raises(MessageError, match="is not finite; expected finite numbers")
    for field in AckermannDrive.__slots__:
        with refused:
            conversions.command_from_msg(travelled(command_msg(**{field: value})))
    for field in ("x", "y", "z", "qx", "qy", "qz", "qw"):
        with refused:
            conversions.pose_from_msg(pose_msg(**{field: value}))
    for field in ("x", "y", "z"):
        with refused:
            conversions.point_from_msg(PointStamped(point=Point(**{**ZERO, field: value})))


@pytest.mark.parametrize(
    "field, value, expected",
    [
        ("speed", 1e30, "speed is 1e+30 m/s; expected at most 1000 m/s"),
        ("speed", -1001.0, "speed is -1001 m/s; expected at most 1000 m/s"),
    ],
)
def test_a_command_out_of_range_is_refused(field, value, expected):
    with pytest.raises(MessageError) as caught:
        conversions.command_from_msg(travelled(command_msg(**{field: value})))
    assert str(caught.value).startswith(expected)


@pytest.mark.parametrize(
    "fields, expected",
    [
        ({"x": 1e30}, "is too far away; expected 1e+06 m at most"),
        ({"y": -1.1e6}, "is too far away; expected 1e+06 m at most"),
        ({"qw": 0.0}, "quaternion (0.0, 0.0, 0.0, 0.0) has the length 0; expected 1"),
        ({"qw": 5e-324}, "has the length 4.94066e-324; expected 1"),
        ({"qw": 1e-4}, "has the length 0.0001; expected 1"),
        ({"qz": 1e30}, "has the length 1e+30; expected 1"),
        ({"qx": 1.7e308, "qy": 1.7e308}, "has the length inf; expected 1"),
    ],
)
def test_a_pose_without_meaning_is_refused(fields, expected):
    with pytest.raises(MessageError) as caught:
        conversions.pose_from_msg(pose_msg(**fields))
    assert expected in str(caught.value)


@pytest.mark.parametrize("length", [0.01, 1.0, 100.0])
def test_the_yaw_is_that_of_the_x_axis_on_a_slope(length):
    """Pitched by 0.5 rad and then turned by 2 rad about the vertical, at any length."""
    (sin, cos), (up, ahead) = ((math.sin(each), math.cos(each)) for each in (1.0, 0.25))
    parts = {"qx": -sin * up, "qy": cos * up, "qz": sin * ahead, "qw": cos * ahead}
    msg = pose_msg(**{name: length * part for name, part in parts.items()})
    assert conversions.pose_from_msg(msg).theta == pytest.approx(2.0, abs=ROUNDING)


def test_a_placement_is_in_the_map():
    msg = PoseWithCovarianceStamped()
    msg.pose.pose = pose_msg(x=1.0)
    for msg.header.frame_id in ("map", "/map", ""):
        assert conversions.initial_pose_from_msg(msg) == InitialPose(0, Pose(1.0, 0.0, 0.0))
    for msg.header.frame_id in ("odom", "map2"):
        expected = f"pose is in the frame '{msg.header.frame_id}'; expected 'map'"
        with pytest.raises(MessageError, match=expected):
            conversions.initial_pose_from_msg(msg)


def moving():
    """Return the state of a car that was placed, and has driven a bend since."""
    state = apply(at_rest(0, Pose(1.0, 2.0, 0.5)), Command(0, 2.0, 0.3), Car())
    state = advance(state, 10**8, Car())
    state = apply(state, InitialPose(10**8, Pose(-3.0, 4.0, -1.0)), Car())
    state = apply(state, Command(10**8, 1.5, -0.4), Car())
    return advance(state, 2 * 10**8, Car())._replace(stamp=STAMP)


def test_a_path_counts_its_stamps_from_its_beginning():
    states = [moving()._replace(stamp=number * 10**8) for number in range(3)]
    path = conversions.path_to_msg(iter(states), STAMP)
    assert (path.header.frame_id, path.header.stamp.to_nsec()) == ("map", STAMP)
    assert [pose.header.stamp.to_nsec() - STAMP for pose in path.poses] == [0, 10**8, 2 * 10**8]
    assert conversions.pose_from_msg(path.poses[1].pose)[:2] == moving().pose[:2]


def test_pose_odometry_and_transforms_tell_the_same():
    state = moving()
    pose = conversions.car_pose_to_msg(state)
    measured = Odometry(state, state.yaw_rate(Car()), 1.0 + np.arange(9).reshape(3, 3), (0.1, 0.2))
    odom = conversions.odometry_to_msg(measured, "car/odom", "car/base_footprint")
    transforms = conversions.transforms_to_msg(state, "car/odom", "car/base_footprint")
    first, second = transforms.transforms
    for msg in (pose, odom, first, second):
        assert msg.header.stamp.to_nsec() == STAMP
    assert pose.header.frame_id == first.header.frame_id == "map"
    assert first.child_frame_id == "car/odom"
    for msg in (odom, second):
        assert msg.header.frame_id == "car/odom" and msg.child_frame_id == "car/base_footprint"

    def planar(transform):
        return Pose(
            transform.translation.x,
            transform.translation.y,
            2.0 * math.atan2(transform.rotation.z, transform.rotation.w),
        )

    in_odom = conversions.pose_from_msg(odom.pose.pose)
    assert planar(second.transform) == pytest.approx(in_odom, abs=1e-14)
    in_map = compose(planar(first.transform), in_odom)
    assert in_map == pytest.approx(conversions.pose_from_msg(pose.pose), abs=1e-14)
    assert in_map == pytest.approx(state.pose, abs=1e-14)
    twist = odom.twist.twist
    assert twist.linear.x == 1.5 and twist.linear.y == 0.0
    assert twist.angular.z == pytest.approx(1.5 * math.tan(-0.4) / 0.33, abs=1e-14)
    covariance = np.reshape(odom.pose.covariance, (6, 6))
    assert covariance[:2, :2].tolist() == [[1, 2], [4, 5]]
    assert covariance[5, [0, 1, 5]].tolist() == [7, 8, 9] and covariance[0, 5] == 3
    assert np.count_nonzero(covariance) == 9
    assert np.diag(np.reshape(odom.twist.covariance, (6, 6))).tolist() == [0.1, 0, 0, 0, 0, 0.2]


def test_joint_states_are_mushrs():
    msg = conversions.joint_states_to_msg(moving(), Wheels(1.0, 2.0, 3.0, 4.0), (5, 6), Car())
    joints = dict(zip(msg.name, msg.position))
    assert len(joints) == 6
    throttles = [
        joints[f"{end}_{side}_wheel_throttle"]
        for end in ("front", "back")
        for side in ("left", "right")
    ]
    assert throttles == [1.0, 2.0, 3.0, 4.0]
    assert msg.header.stamp.to_nsec() == STAMP
    assert joints["front_right_wheel_steer"] < -0.4 < joints["front_left_wheel_steer"] < 0.0
    rates = dict(zip(msg.name, msg.velocity))
    # The middle of the axle drives 1.5 m/s, and the car turns to the right.
    left, right = rates["back_left_wheel_throttle"], rates["back_right_wheel_throttle"]
    assert (left + right) / 2 == pytest.approx(1.5 / 0.0488) and left > right
    assert (rates["front_left_wheel_steer"], rates["front_right_wheel_steer"]) == (5, 6)


def sample_grid():
    """Return a map with one cell of every value, no two rows alike, and its origin turned."""
    cells = np.arange(-128, 128).astype(np.int8).reshape(16, 16)
    return Grid(cells[:, :-1], 0.05, Pose(-3, 4, 2.5))


@pytest.mark.parametrize("kind", [OccupancyGrid, numpy_msg(OccupancyGrid)])
def test_a_map_travels_to_the_cell(kind):
    grid = sample_grid()
    wire = io.BytesIO()
    conversions.grid_to_msg(grid, STAMP, "map").serialize(wire)
    msg = kind().deserialize(wire.getvalue())
    assert (msg.header.frame_id, msg.header.stamp.to_nsec()) == ("map", STAMP)
    assert msg.info.map_load_time.to_nsec() == STAMP
    assert (msg.info.width, msg.info.height) == (15, 16)
    assert list(msg.data[:3]) == [-128, -127, -126]  # row by row, from the bottom
    back = conversions.grid_from_msg(msg)
    assert (back.cells == grid.cells).all()
    assert back.resolution == grid.resolution
    assert (back.origin.x, back.origin.y) == (grid.origin.x, grid.origin.y)
    assert abs(back.origin.theta - grid.origin.theta) < 4 * ROUNDING


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({"width": 3}, "the map has 4 cells; expected 3 x 2"),
        ({"width": 0, "height": 0}, "the map has 4 cells; expected 0 x 0"),
        ({"resolution": 0.0}, "the map's resolution is 0.0; expected a number from"),
        ({"resolution": math.nan}, "the map's resolution is nan; expected a number from"),
        ({"origin": PoseMsg()}, "quaternion"),
        ({"origin": PoseMsg(position=Point(x=math.inf))}, "is not finite"),
    ],
)
def test_an_impossible_map(changes, expected):
    msg = conversions.grid_to_msg(Grid(np.zeros((2, 2), np.int8), 0.1), STAMP, "map")
    for field, value in changes.items():
        setattr(msg.info, field, value)
    with pytest.raises(MessageError) as caught:
        conversions.grid_from_msg(msg)
    assert expected in str(caught.value)
    msg = OccupancyGrid(info=MapMetaData(resolution=0.1, origin=pose_msg()))
    with pytest.raises(MessageError, match="expected at least one"):
        conversions.grid_from_msg(msg)


def test_a_scan():
    beams = Beams(number=3)
    ranges = np.array([math.inf, 2.5, -math.inf])
    msg = travelled(conversions.scan_to_msg(ranges, beams, STAMP, 0.1, "car/laser_link"))
    assert (msg.header.frame_id, msg.header.stamp.to_nsec()) == ("car/laser_link", STAMP)
    assert list(msg.ranges) == [math.inf, 2.5, -math.inf]
    assert msg.angle_min == as_float32(beams.angle_min)
    assert msg.angle_max == as_float32(beams.angle_min + 2 * beams.angle_increment)
    assert msg.angle_increment == as_float32(beams.angle_increment)
    assert (msg.range_min, msg.range_max) == (as_float32(0.02), 10.0)
    assert (msg.scan_time, msg.time_increment, len(msg.intensities)) == (as_float32(0.1), 0.0, 0)


def test_a_point_is_read_or_refused():
    def read(x, y, z=0.0, frame="map"):
        msg = PointStamped(point=Point(x, y, z))
        msg.header.frame_id = frame
        return conversions.point_from_msg(travelled(msg))

    for frame in ("map", "/map", ""):
        assert read(1.5, -2.5, 0.3, frame) == (1.5, -2.5)
    with pytest.raises(MessageError, match="1e.06 m at most"):
        read(0.0, -1.1e6)
    with pytest.raises(MessageError, match="in the frame 'car/odom'; expected 'map'"):
        read(0.0, 0.0, frame="car/odom")
