"""The values that describe a car, its events and its state.

All instants are integer nanoseconds.
"""

import math
from typing import NamedTuple, Optional, Tuple, Union

from mushr_ros_intro.geometry import Pose, compose, curvature, inverse
from mushr_ros_intro.plan.plan import MAX_STEERING_ANGLE
from mushr_ros_intro.stamps import NANOSECONDS


class Car(NamedTuple):
    """The parameters of a car: its size, its limits and its noise.

    The defaults are those of the ideal car: MuSHR's size, no limits and no noise.
    """

    wheelbase: float = 0.33
    """Distance between the axles [m]."""
    track: float = 0.25
    """Distance between the left and the right wheels [m]."""
    wheel_radius: float = 0.0488
    """Radius of the wheels [m]."""
    command_timeout: int = 200_000_000
    """How long a command is valid after its stamp [ns]; then the car stops."""
    speed_limit: float = math.inf
    """The highest speed [m/s], forward and in reverse."""
    steering_limit_left: float = math.inf
    """The largest steering angle to the left [rad]."""
    steering_limit_right: float = math.inf
    """The largest steering angle to the right [rad], positive too."""
    acceleration: float = math.inf
    """The highest rate of change of the speed [m/s^2], also in braking."""
    steering_rate: float = math.inf
    """The highest rate of change of the steering angle [rad/s]."""
    speed_gain: float = 1.0
    """The driven speed is the commanded speed within the limits, times this."""
    steering_gain: float = 1.0
    """The steering angle is the commanded one within the limits, times this, plus the offset."""
    steering_offset: float = 0.0
    """The steering angle for the command 0 [rad], left positive."""
    speed_noise: float = 0.0
    """Standard deviation of the speed [m/s], drawn for each command to drive."""
    steering_noise: float = 0.0
    """Standard deviation of the steering angle [rad], drawn for each command to drive."""
    speed_gain_spread: float = 0.0
    """Standard deviation of the speed gain between drives; only `preview.spread` uses it."""
    steering_offset_spread: float = 0.0
    """Standard deviation of the steering offset between drives [rad], likewise."""
    odom_distance_noise: float = 0.0
    """Standard deviation of the measured distance [m] after 1 m; it grows with the square root."""
    odom_heading_noise: float = 0.0
    """Standard deviation of the measured heading [rad] after 1 m; it grows with the square root."""
    seed: int = 0
    """The seed of the noise."""

    def __str__(self) -> str:
        units = {"command_timeout": NANOSECONDS}
        changed = ", ".join(
            f"{name}: {value / units.get(name, 1):.12g}"
            for name, value, ideal in zip(self._fields, self, Car())
            if value != ideal
        )
        return f"ideal except {changed}" if changed else "ideal"

    @property
    def has_command_noise(self) -> bool:
        """Whether the commands have random errors."""
        return (self.speed_noise, self.steering_noise) != (0.0, 0.0)

    @property
    def has_odom_noise(self) -> bool:
        """Whether the odometry has random errors."""
        return (self.odom_distance_noise, self.odom_heading_noise) != (0.0, 0.0)

    def within_limits(self, speed: float, steering_angle: float) -> Tuple[float, float]:
        """Return the nearest speed [m/s] and steering angle [rad] that the car accepts."""
        left, right = (
            min(limit, MAX_STEERING_ANGLE)
            for limit in (self.steering_limit_left, self.steering_limit_right)
        )
        return (
            max(-self.speed_limit, min(self.speed_limit, speed)),
            max(-right, min(left, steering_angle)),
        )

    def response(self, speed: float, steering_angle: float) -> Tuple[float, float]:
        """Return the speed [m/s] and the steering angle [rad] that follow from a command."""
        speed, steering_angle = self.within_limits(speed, steering_angle)
        return speed * self.speed_gain, steering_angle * self.steering_gain + self.steering_offset

    def command_for(self, steering_angle: float) -> float:
        """Return the command [rad] that `response` turns into a steering angle, without limits."""
        return (steering_angle - self.steering_offset) / self.steering_gain


class Contact(NamedTuple):
    """Contact between the car, which stands, and a wall."""

    stamp: int
    """When the contact began [ns]."""
    pose: Pose
    """The pose of the car, the last free one of its path, in the map frame."""


class Command(NamedTuple):
    """A command to drive or to stop, from `stamp` on."""

    stamp: int
    """When it applies [ns]."""
    speed: float
    """Forward speed [m/s], negative in reverse."""
    steering_angle: float
    """Steering angle of the virtual middle front wheel [rad], left positive."""
    acceleration: float = 0.0
    """Rate of change of the speed [m/s^2], of any sign; 0 means as fast as the car can."""
    steering_angle_velocity: float = 0.0
    """Rate of change of the steering angle [rad/s], of any sign; 0 means as fast as possible."""
    has_stamp: bool = True
    """Whether the sender has set `stamp`; otherwise it is the time of arrival."""


class InitialPose(NamedTuple):
    """A new pose of the car, which is at rest there, at `stamp`."""

    stamp: int
    """When it applies [ns]."""
    pose: Pose
    """The pose in the map frame."""
    has_stamp: bool = True
    """As for a command."""


Event = Union[Command, InitialPose]


class Wheels(NamedTuple):
    """One number per wheel."""

    front_left: float
    front_right: float
    back_left: float
    back_right: float


class Piece(NamedTuple):
    """A piece of the car's path on which speed and steering angle change at constant rates.

    The car does not reverse its direction on it.
    """

    begin: float
    """When the piece begins [s], counted from the command that set the car in motion."""
    pose: Pose
    """The car's pose at the beginning, in the map frame."""
    speed: float
    """Forward speed at the beginning [m/s]."""
    acceleration: float
    """Rate of change of the speed [m/s^2]."""
    steering_angle: float
    """Steering angle at the beginning [rad], left positive."""
    steering_rate: float
    """Rate of change of the steering angle [rad/s]."""
    collision: Optional[Contact]
    """The contact with a wall at which the car stands, or None."""

    @property
    def direction(self) -> float:
        """The direction of the motion: 1 forward, -1 in reverse, 0 if the car stands."""
        rate = self.speed or self.acceleration
        return math.copysign(1.0, rate) if rate else 0.0


class State(NamedTuple):
    """The state of the car at one instant."""

    stamp: int
    """The instant [ns]."""
    pose: Pose
    """The pose of base_footprint, the middle of the rear axle on the ground, in the map frame."""
    map_from_odom: Pose
    """The origin of the odometry in the map frame. Only initial poses move it."""
    speed: float
    """Forward speed [m/s]."""
    steering_angle: float
    """Steering angle [rad], left positive."""
    collision: Optional[Contact] = None
    """The contact with a wall, from the hit until the car drives away, or None."""
    command: Optional[Command] = None
    """The last command since the last initial pose."""
    moved: int = 0
    """The stamp of the command that set the car in motion [ns]."""
    motion: Tuple[Piece, ...] = ()
    """The path after that command. On the last piece, which has no end, the car stands."""
    drive_commands: int = 0
    """How many commands to drive have applied since the last initial pose; see `motion.apply`."""

    @property
    def odom_pose(self) -> Pose:
        """The pose of base_footprint in the odometry frame, which never jumps."""
        return compose(inverse(self.map_from_odom), self.pose)

    def yaw_rate(self, car: Car) -> float:
        """Return the yaw rate [rad/s], counter-clockwise positive."""
        return self.speed * curvature(self.steering_angle, car.wheelbase)


def at_rest(stamp: int, pose: Pose) -> State:
    """Return the state of a car that has not moved yet; its odometry begins at zero."""
    return State(stamp, pose, pose, 0.0, 0.0)


def halted(state: State, stamp: int) -> State:
    """Return the state of a car that stands still at the pose of `state` at `stamp` [ns]."""
    return state._replace(stamp=stamp, speed=0.0, command=None, motion=())


def front_wheel_angles(steering_angle: float, car: Car) -> Tuple[float, float]:
    """Return the steering angles [rad] of the left and the right front wheel.

    Each wheel is perpendicular to the line to the turning centre (Ackermann's condition).
    """
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return math.atan2(bend, 1.0 - side), math.atan2(bend, 1.0 + side)


def wheel_rates(state: State, car: Car) -> Wheels:
    """Return the rate at which each wheel turns [rad/s], positive forward."""
    bend = math.tan(state.steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    ratios = math.hypot(1.0 - side, bend), math.hypot(1.0 + side, bend), 1.0 - side, 1.0 + side
    return Wheels(*(state.speed * ratio / car.wheel_radius for ratio in ratios))
