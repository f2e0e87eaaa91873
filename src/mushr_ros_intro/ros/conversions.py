"""Convert the package's values to ROS messages and back."""

import functools
import math
from typing import Any, Callable, Iterable, Sequence, Tuple, TypeVar, Union

import numpy as np
import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import (
    PointStamped,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Transform,
    TransformStamped,
    Vector3,
)
from geometry_msgs.msg import Pose as PoseMsg
from nav_msgs.msg import MapMetaData, OccupancyGrid, Odometry, Path
from sensor_msgs.msg import JointState, LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import (
    Car,
    Command,
    InitialPose,
    State,
    Wheels,
    front_wheel_angles,
    wheel_rates,
)
from mushr_ros_intro.car.odometry import Odometry as Measured
from mushr_ros_intro.geometry import MAX_COORDINATE, Pose
from mushr_ros_intro.plan.plan import MAX_SPEED
from mushr_ros_intro.ros.ros_time import time_from
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid, as_travelled
from mushr_ros_intro.world.laser import Beams

F = TypeVar("F", bound=Callable[..., None])

MAP_FRAME = "map"


class MessageError(ValueError):
    """A message that cannot be used. The text names the fault and what was expected."""


def ignore_bad_messages(callback: F) -> F:
    """Decorate the callback of a subscriber: a MessageError is logged as a warning.

    The warning names the topic. The same warning is not repeated within a second.
    """

    @functools.wraps(callback)
    def call(node: Any, msg: rospy.Message, *arguments: Any) -> None:
        try:
            callback(node, msg, *arguments)
        except MessageError as error:
            topic = msg._connection_header["topic"]
            rospy.logwarn_throttle_identical(1.0, f"ignored a message on {topic}: {error}")

    return call  # type: ignore


def _header(stamp: int, frame: str = MAP_FRAME) -> Header:
    """Return a header with a stamp [ns]."""
    header = Header()  # a message with arguments needs twice the time of one without
    header.stamp.secs, header.stamp.nsecs = divmod(stamp, NANOSECONDS)
    header.frame_id = frame
    return header


def _check_frame(header: Header, kind: str) -> None:
    """Raise a MessageError if a header is not in the map frame."""
    if header.frame_id.lstrip("/") not in ("", MAP_FRAME):
        raise MessageError(f"{kind} is in the frame '{header.frame_id}'; expected '{MAP_FRAME}'")


def _check_position(numbers: Tuple[float, ...], kind: str) -> None:
    """Raise a MessageError if a number is not finite, or x or y [m] is too far away."""
    if not all(map(math.isfinite, numbers)):
        raise MessageError(f"{kind} {numbers} is not finite; expected finite numbers")
    if max(map(abs, numbers[:2])) > MAX_COORDINATE:
        raise MessageError(
            f"{kind} {numbers} is too far away; expected {MAX_COORDINATE:g} m at most"
        )


def pose_to_msg(pose: Pose) -> PoseMsg:
    """Return the message of a planar pose, on the ground."""
    # What tf's quaternion_from_euler(0, 0, theta) gives; importing tf takes 7 MB in each node.
    half = 0.5 * pose.theta
    msg = PoseMsg()
    msg.position.x, msg.position.y = pose.x, pose.y
    msg.orientation.z, msg.orientation.w = math.sin(half), math.cos(half)
    return msg


def pose_from_msg(msg: PoseMsg) -> Pose:
    """Return the planar pose of a message: its x, y and yaw.

    Raises:
        MessageError: a number is not finite, the pose is too far away, or the quaternion has no
            length.
    """
    position, q = msg.position, msg.orientation
    numbers = (position.x, position.y, position.z, q.x, q.y, q.z, q.w)
    _check_position(numbers, "pose")
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if not 1e-3 < norm < 1e3:
        raise MessageError(f"quaternion {numbers[3:]} has the length {norm:g}; expected 1")
    x, y, z, w = q.x / norm, q.y / norm, q.z / norm, q.w / norm
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Pose(position.x, position.y, yaw)


def initial_pose_from_msg(msg: Union[PoseWithCovarianceStamped, PoseStamped]) -> InitialPose:
    """Return the initial pose of a message, with the message's stamp.

    Raises:
        MessageError: the pose is unusable, or not in the map frame.
    """
    _check_frame(msg.header, "pose")
    pose = pose_from_msg(getattr(msg.pose, "pose", msg.pose))
    return InitialPose(msg.header.stamp.to_nsec(), pose)


def point_from_msg(msg: PointStamped) -> Tuple[float, float]:
    """Return the x and y [m] of a point in the map.

    Raises:
        MessageError: a number is not finite, or the point is too far away or not in the map frame.
    """
    _check_frame(msg.header, "point")
    numbers = (msg.point.x, msg.point.y, msg.point.z)
    _check_position(numbers, "point")
    return numbers[:2]


def command_to_msg(command: Command, frame: str) -> AckermannDriveStamped:
    """Return the message of a command to the car whose base frame is `frame`."""
    drive = AckermannDrive(
        speed=command.speed,
        steering_angle=command.steering_angle,
        acceleration=command.acceleration,
        steering_angle_velocity=command.steering_angle_velocity,
    )
    return AckermannDriveStamped(_header(command.stamp, frame), drive)


def command_from_msg(msg: AckermannDriveStamped) -> Command:
    """Return the command of a message, with the message's stamp.

    Raises:
        MessageError: a number is not finite, or the speed is above MAX_SPEED.
    """
    drive = msg.drive
    numbers = tuple(getattr(drive, name) for name in drive.__slots__)
    if not all(map(math.isfinite, numbers)):
        raise MessageError(f"command {numbers} is not finite; expected finite numbers")
    if abs(drive.speed) > MAX_SPEED:
        raise MessageError(f"speed is {drive.speed:g} m/s; expected at most {MAX_SPEED:g} m/s")
    return Command(
        msg.header.stamp.to_nsec(),
        drive.speed,
        drive.steering_angle,
        drive.acceleration,
        drive.steering_angle_velocity,
    )


def car_pose_to_msg(state: State) -> PoseStamped:
    """Return the message of the car's pose in the map."""
    return PoseStamped(_header(state.stamp), pose_to_msg(state.pose))


def path_to_msg(states: Iterable[State], begin: int) -> Path:
    """Return the poses of states as a path in the map; their stamps count from `begin` [ns]."""
    poses = [car_pose_to_msg(state._replace(stamp=begin + state.stamp)) for state in states]
    return Path(_header(begin), poses)


def poses_to_msg(poses: Iterable[Pose], stamp: int) -> PoseArray:
    """Return poses in the map, with a stamp [ns]."""
    return PoseArray(_header(stamp), [pose_to_msg(pose) for pose in poses])


def odometry_to_msg(measured: Measured, odom_frame: str, base_frame: str) -> Odometry:
    """Return the car's odometry: the pose in `odom_frame`, the twist in `base_frame`."""
    state = measured.state
    msg = Odometry(header=_header(state.stamp, odom_frame), child_frame_id=base_frame)
    msg.pose.pose = pose_to_msg(state.odom_pose)
    msg.twist.twist.linear.x = state.speed
    msg.twist.twist.angular.z = measured.yaw_rate
    # The rows and columns are x, y, z, and the rotations about them.
    for row, values in zip((0, 6, 30), measured.pose_covariance.tolist()):
        for column, value in zip((0, 1, 5), values):
            msg.pose.covariance[row + column] = value
    msg.twist.covariance[0], msg.twist.covariance[35] = measured.twist_variances
    return msg


def joint_states_to_msg(
    state: State, wheel_angles: Wheels, steering_rates: Sequence[float], car: Car
) -> JointState:
    """Return the angles and rates of MuSHR's six joints: four wheels, and the steering of two.

    Args:
        state: of the car.
        wheel_angles: how far each wheel has turned [rad].
        steering_rates: at which the left and the right front wheel are steered [rad/s].
        car: the car.
    """
    left, right = front_wheel_angles(state.steering_angle, car)
    names = [f"{each}_wheel_throttle" for each in Wheels._fields]
    names += ["front_left_wheel_steer", "front_right_wheel_steer"]
    header = Header(stamp=time_from(state.stamp))
    return JointState(
        header=header,
        name=names,
        position=[*wheel_angles, left, right],
        velocity=[*wheel_rates(state, car), *steering_rates],
    )


def transforms_to_msg(
    state: State, odom_frame: str, base_frame: str, with_map: bool = True
) -> TFMessage:
    """Return the transforms from the map, if wanted, to `odom_frame` and then to `base_frame`."""
    frames = [(odom_frame, base_frame, state.odom_pose)]
    if with_map:
        frames.insert(0, (MAP_FRAME, odom_frame, state.map_from_odom))
    msgs = []
    for parent, child, pose in frames:
        translation = Vector3(pose.x, pose.y, 0.0)
        transform = Transform(translation, pose_to_msg(pose).orientation)
        msgs.append(TransformStamped(_header(state.stamp, parent), child, transform))
    return TFMessage(msgs)


def grid_to_msg(grid: Grid, stamp: int, frame: str) -> OccupancyGrid:
    """Return the message of a map in `frame`, loaded at `stamp` [ns]."""
    origin = pose_to_msg(grid.origin)
    info = MapMetaData(time_from(stamp), grid.resolution, grid.width, grid.height, origin)
    return OccupancyGrid(_header(stamp, frame), info, grid.cells.ravel().tolist())


def grid_from_msg(msg: OccupancyGrid) -> Grid:
    """Return the map of a message. Its data may be an array or a sequence.

    Raises:
        MessageError: the number of cells is wrong or 0, or another number is out of range.
    """
    info = msg.info
    cells = np.array(msg.data, np.int8)
    if cells.size != info.width * info.height:
        raise MessageError(f"the map has {cells.size} cells; expected {info.width} x {info.height}")
    origin = pose_from_msg(info.origin)
    try:
        return Grid(cells.reshape(info.height, info.width), as_travelled(info.resolution), origin)
    except ValueError as error:
        raise MessageError(f"the map's {error}") from None


def scan_to_msg(
    ranges: np.ndarray, beams: Beams, stamp: int, period: float, frame: str
) -> LaserScan:
    """Return the message of one scan.

    Args:
        ranges: one for each beam [m], with infinities as in REP 117.
        beams: of the scanner.
        stamp: of all beams [ns].
        period: from one scan to the next [s].
        frame: of the scanner.
    """
    return LaserScan(
        header=_header(stamp, frame),
        angle_min=beams.angle_min,
        angle_max=beams.angle_min + (beams.number - 1) * beams.angle_increment,
        angle_increment=beams.angle_increment,
        scan_time=period,
        range_min=beams.range_min,
        range_max=beams.range_max,
        ranges=ranges.tolist(),
    )
