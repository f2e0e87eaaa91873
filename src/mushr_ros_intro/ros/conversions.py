"""Turn the package's values into ROS messages and back; the one module that knows both."""

import io
import math
import struct
from typing import Iterable, List, Optional, Tuple

import genpy
import numpy as np
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import (
    PointStamped,
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TransformStamped,
)
from geometry_msgs.msg import Pose as PoseMsg
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from nav_msgs.srv import GetMapResponse
from sensor_msgs.msg import JointState, LaserScan
from visualization_msgs.msg import Marker, MarkerArray

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car, Command, Contact, InitialPose, State, front_wheel_angles
from mushr_ros_intro.plan.model import MAX_COORDINATE, MAX_SPEED
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid, as_travelled
from mushr_ros_intro.world.laser import Beams

MAP_FRAME = "map"

_THIN = 1e-3  # [m] rviz shows nothing that has no size
_ELLIPSE_COLOUR = (0.85, 0.15, 0.15, 0.3)


class MessageError(ValueError):
    """A message that must not be acted upon; says what is wrong and what was expected."""


def time_from(stamp: int) -> genpy.Time:
    """Return the ROS time of a stamp [ns]."""
    return genpy.Time(*divmod(stamp, NANOSECONDS))


def pose_to_msg(pose: Pose) -> PoseMsg:
    """Return the message of a planar pose, on the ground."""
    msg = PoseMsg()
    msg.position.x, msg.position.y = pose.x, pose.y
    # What tf's quaternion_from_euler(0, 0, theta) gives; importing tf takes 7 MB in each node.
    half = 0.5 * pose.theta
    msg.orientation = Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
    return msg


def pose_from_msg(msg: PoseMsg) -> Pose:
    """Return the planar pose of a message: its x, y and yaw.

    Raises:
        MessageError: a number is not finite, or the quaternion has no length.
    """
    position, q = msg.position, msg.orientation
    numbers = (position.x, position.y, position.z, q.x, q.y, q.z, q.w)
    if not all(map(math.isfinite, numbers)):
        raise MessageError(f"pose {numbers} is not finite; expected finite numbers")
    if max(abs(position.x), abs(position.y)) > MAX_COORDINATE:
        raise MessageError(f"pose {numbers} is too far away; expected {MAX_COORDINATE:g} m at most")
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if not 1e-3 < norm < 1e3:
        raise MessageError(f"quaternion {numbers[3:]} has the length {norm:g}; expected 1")
    x, y, z, w = q.x / norm, q.y / norm, q.z / norm, q.w / norm
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return Pose(position.x, position.y, yaw)


def initial_pose_from_msg(msg: PoseWithCovarianceStamped) -> InitialPose:
    """Return the placement that a message orders, with the stamp as it was sent.

    Raises:
        MessageError: the pose is unusable, or not in the map frame.
    """
    frame = msg.header.frame_id
    if frame.lstrip("/") not in ("", MAP_FRAME):
        raise MessageError(f"pose is in the frame '{frame}'; expected '{MAP_FRAME}'")
    return InitialPose(msg.header.stamp.to_nsec(), pose_from_msg(msg.pose.pose))


def point_from_msg(msg: PointStamped) -> Tuple[float, float]:
    """Return the x and y [m] of a point in the map.

    Raises:
        MessageError: a number is not finite or absurd, or the point is not in the map frame.
    """
    frame, point = msg.header.frame_id, msg.point
    if frame.lstrip("/") not in ("", MAP_FRAME):
        raise MessageError(f"point is in the frame '{frame}'; expected '{MAP_FRAME}'")
    numbers = (point.x, point.y, point.z)
    if not all(map(math.isfinite, numbers)):
        raise MessageError(f"point {numbers} is not finite; expected finite numbers")
    if max(abs(point.x), abs(point.y)) > MAX_COORDINATE:
        raise MessageError(f"point {numbers} is far away; expected {MAX_COORDINATE:g} m at most")
    return point.x, point.y


def command_to_msg(command: Command, frame: str) -> AckermannDriveStamped:
    """Return the message of a command to the car whose base frame is `frame`."""
    msg = AckermannDriveStamped()
    msg.header.stamp = time_from(command.stamp)
    msg.header.frame_id = frame
    msg.drive.speed = command.speed
    msg.drive.steering_angle = command.steering_angle
    msg.drive.acceleration = command.acceleration
    msg.drive.steering_angle_velocity = command.steering_angle_velocity
    return msg


def command_from_msg(msg: AckermannDriveStamped) -> Command:
    """Return the command that a message gives, with the stamp as it was sent.

    Raises:
        MessageError: a number is not finite, the speed is absurd, or the steering angle is a
            right angle or more.
    """
    drive = msg.drive
    numbers = (
        drive.steering_angle,
        drive.steering_angle_velocity,
        drive.speed,
        drive.acceleration,
        drive.jerk,
    )
    if not all(map(math.isfinite, numbers)):
        raise MessageError(f"command {numbers} is not finite; expected finite numbers")
    if abs(drive.speed) > MAX_SPEED:
        raise MessageError(f"speed is {drive.speed:g} m/s; expected at most {MAX_SPEED:g} m/s")
    if abs(drive.steering_angle) >= math.pi / 2:
        raise MessageError(
            f"steering angle {drive.steering_angle:g} is a right angle or more; expected radians"
        )
    return Command(
        msg.header.stamp.to_nsec(),
        drive.speed,
        drive.steering_angle,
        drive.acceleration,
        drive.steering_angle_velocity,
    )


def car_pose_to_msg(state: State) -> PoseStamped:
    """Return the message of the car's pose in the map."""
    msg = PoseStamped()
    msg.header.stamp = time_from(state.stamp)
    msg.header.frame_id = MAP_FRAME
    msg.pose = pose_to_msg(state.pose)
    return msg


def path_to_msg(states: Iterable[State], begin: int) -> Path:
    """Return the poses of states as a path in the map; their stamps count from `begin` [ns]."""
    msg = Path()
    msg.header.stamp = time_from(begin)
    msg.header.frame_id = MAP_FRAME
    msg.poses = [car_pose_to_msg(state._replace(stamp=begin + state.stamp)) for state in states]
    return msg


def poses_to_msg(poses: Iterable[Pose], stamp: int) -> PoseArray:
    """Return poses in the map, stamped with `stamp` [ns]."""
    msg = PoseArray()
    msg.header.stamp = time_from(stamp)
    msg.header.frame_id = MAP_FRAME
    msg.poses = [pose_to_msg(pose) for pose in poses]
    return msg


def collision_to_msg(contact: Optional[Contact], stamp: int) -> PoseArray:
    """Return the pose at which the car stands against a wall, stamped with when it hit it.

    Without a contact the message has no pose, and the stamp [ns] that is given.
    """
    if contact is None:
        return poses_to_msg([], stamp)
    return poses_to_msg([contact.pose], contact.stamp)


def ellipses_to_msg(ellipses: Iterable[Tuple[Pose, float, float]], stamp: int) -> MarkerArray:
    """Return flat ellipses in the map, in the place of those that were shown before.

    Args:
        ellipses: the middle of each, with the direction of its longer axis, and half its longer
            and half its shorter axis [m].
        stamp: of the markers [ns].
    """
    msg = MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
    for number, (middle, major, minor) in enumerate(ellipses):
        marker = Marker(type=Marker.CYLINDER, id=number, pose=pose_to_msg(middle))
        marker.scale.x, marker.scale.y = (max(2.0 * each, _THIN) for each in (major, minor))
        marker.scale.z = _THIN
        marker.color.r, marker.color.g, marker.color.b, marker.color.a = _ELLIPSE_COLOUR
        msg.markers.append(marker)
    for marker in msg.markers:
        marker.header.stamp = time_from(stamp)
        marker.header.frame_id = MAP_FRAME
    return msg


def odometry_to_msg(state: State, car: Car, odom_frame: str, base_frame: str) -> Odometry:
    """Return the car's odometry: the pose in `odom_frame`, the twist in `base_frame`."""
    msg = Odometry()
    msg.header.stamp = time_from(state.stamp)
    msg.header.frame_id = odom_frame
    msg.child_frame_id = base_frame
    msg.pose.pose = pose_to_msg(state.odom_pose)
    msg.twist.twist.linear.x = state.speed
    msg.twist.twist.angular.z = state.turn_rate(car)
    return msg


def joint_states_to_msg(state: State, car: Car) -> JointState:
    """Return the angles of MuSHR's six joints: how the wheels have turned, and are steered."""
    left, right = front_wheel_angles(state.steering_angle, car)
    joints: List[Tuple[str, float]] = [
        ("front_left_wheel_throttle", state.wheel_angles.front_left),
        ("front_right_wheel_throttle", state.wheel_angles.front_right),
        ("back_left_wheel_throttle", state.wheel_angles.back_left),
        ("back_right_wheel_throttle", state.wheel_angles.back_right),
        ("front_left_wheel_steer", left),
        ("front_right_wheel_steer", right),
    ]
    msg = JointState()
    msg.header.stamp = time_from(state.stamp)
    msg.name = [name for name, _ in joints]
    msg.position = [angle for _, angle in joints]
    return msg


def transforms_to_msgs(state: State, odom_frame: str, base_frame: str) -> List[TransformStamped]:
    """Return the transforms from the map to `odom_frame` and from there to `base_frame`."""
    frames = (
        (MAP_FRAME, odom_frame, state.map_from_odom),
        (odom_frame, base_frame, state.odom_pose),
    )
    msgs = []
    for parent, child, pose in frames:
        msg = TransformStamped()
        msg.header.stamp = time_from(state.stamp)
        msg.header.frame_id = parent
        msg.child_frame_id = child
        msg.transform.translation.x, msg.transform.translation.y = pose.x, pose.y
        msg.transform.rotation = pose_to_msg(pose).orientation
        msgs.append(msg)
    return msgs


class _GridMsg(OccupancyGrid):
    """An OccupancyGrid whose data are an array, and are sent as they lie in memory.

    genpy would make a Python integer of each cell, and a map may have a hundred million.
    """

    def serialize(self, buff: io.BytesIO) -> None:
        """Write the message as genpy would; `data` is its last field."""
        head = OccupancyGrid(header=self.header, info=self.info)
        head.serialize(buff)
        buff.seek(-4, io.SEEK_CUR)
        buff.write(struct.pack("<I", len(self.data)))
        buff.write(memoryview(self.data))


class _GetMapResponse(GetMapResponse):
    """A response that sends its map in the map's own way; it has no other field."""

    def serialize(self, buff: io.BytesIO) -> None:
        """Write the response as genpy would."""
        self.map.serialize(buff)


def grid_to_msg(grid: Grid, stamp: int, frame: str) -> OccupancyGrid:
    """Return the message of a map in `frame`, loaded at `stamp` [ns]; its data are an array."""
    msg = _GridMsg()
    msg.header.stamp = msg.info.map_load_time = time_from(stamp)
    msg.header.frame_id = frame
    msg.info.resolution = grid.resolution
    msg.info.width, msg.info.height = grid.width, grid.height
    msg.info.origin = pose_to_msg(grid.origin)
    msg.data = np.ascontiguousarray(grid.cells).reshape(-1)
    return msg


def map_response(msg: OccupancyGrid) -> GetMapResponse:
    """Return the response of /static_map that holds the message of `grid_to_msg`."""
    return _GetMapResponse(map=msg)


def grid_from_msg(msg: OccupancyGrid) -> Grid:
    """Return the map of a message; its data may be an array or, as rospy has it, a tuple.

    Raises:
        MessageError: it has no cells, not as many as it says, or impossible numbers.
    """
    info = msg.info
    cells = np.array(msg.data, np.int8)
    cells.flags.writeable = False
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
        ranges: one for each beam [m], with infinities as REP 117 has them.
        beams: of the scanner.
        stamp: when all beams were cast [ns].
        period: from one scan to the next [s].
        frame: of the scanner.
    """
    msg = LaserScan()
    msg.header.stamp = time_from(stamp)
    msg.header.frame_id = frame
    msg.angle_min = beams.angle_min
    msg.angle_max = beams.angle_min + (beams.number - 1) * beams.angle_increment
    msg.angle_increment = beams.angle_increment
    msg.scan_time = period
    msg.range_min, msg.range_max = beams.range_min, beams.range_max
    msg.ranges = ranges.tolist()
    return msg
