"""The values that describe a car, the events that reach it, and its state.

All instants are integer nanoseconds.
"""

import math
from typing import NamedTuple, Optional, Tuple, Union

from mushr_ros_intro.car.bicycle import Pose, compose, curvature, inverse


class Car(NamedTuple):
    """What a car is: its size, its habits and its limits.

    The defaults are MuSHR's sizes, and the ideal car's limits: none, so that it obeys at once.
    """

    wheelbase: float = 0.33
    """Distance between the axles [m]."""
    track: float = 0.25
    """Distance between the left and the right wheels [m]."""
    wheel_radius: float = 0.0488
    """Radius of the wheels [m]."""
    command_timeout: int = 200_000_000
    """How long a command is good for after its stamp [ns]; then the car stops."""
    speed_limit: float = math.inf
    """The highest speed [m/s], forward and in reverse."""
    steering_limit_left: float = math.inf
    """The largest steering angle to the left [rad]."""
    steering_limit_right: float = math.inf
    """The largest steering angle to the right [rad], positive too."""
    acceleration: float = math.inf
    """The highest rate at which the speed changes [m/s^2], also in braking."""
    steering_rate: float = math.inf
    """The highest rate at which the steering angle changes [rad/s]."""
    speed_noise: float = 0.0
    """Standard deviation of the error of the speed, drawn for each command to drive [m/s]."""
    steering_noise: float = 0.0
    """Standard deviation of the error of the steering angle, likewise [rad]."""
    seed: int = 0
    """Which errors."""

    @property
    def is_ideal(self) -> bool:
        """Whether it does as it is told, at once: without limits and errors."""
        ideal = Car()
        return self[4:-1] == ideal[4:-1]

    def within_limits(self, speed: float, steering_angle: float) -> Tuple[float, float]:
        """Return the speed [m/s] and the steering angle [rad] that the car makes of an order."""
        return (
            max(-self.speed_limit, min(self.speed_limit, speed)),
            max(-self.steering_limit_right, min(self.steering_limit_left, steering_angle)),
        )


class Contact(NamedTuple):
    """The car stands against a wall."""

    stamp: int
    """Since when [ns]."""
    pose: Pose
    """Where: the last free pose, in the map frame."""


class Command(NamedTuple):
    """An order to drive, from `stamp` on."""

    stamp: int
    """When it applies [ns]."""
    speed: float
    """Forward speed [m/s], negative in reverse."""
    steering_angle: float
    """Steering angle of the virtual middle front wheel [rad], left positive."""
    acceleration: float = 0.0
    """Rate at which the speed is to change [m/s^2], of any sign; 0: as fast as the car can."""
    steering_angle_velocity: float = 0.0
    """Rate at which the steering angle is to change [rad/s], of any sign; 0: likewise."""


class InitialPose(NamedTuple):
    """An order to be at a pose, at rest, at `stamp`."""

    stamp: int
    """When it applies [ns]."""
    pose: Pose
    """Where, in the map frame."""


Event = Union[Command, InitialPose]


class Wheels(NamedTuple):
    """One number for each wheel."""

    front_left: float
    front_right: float
    back_left: float
    back_right: float


class Piece(NamedTuple):
    """A part of the car's way, on which speed and steering angle change at constant rates.

    The car does not turn round on it: it goes forward, or in reverse, or stands.
    """

    begin: float
    """When it begins [s], counted from the event that set the car in motion."""
    pose: Pose
    """Where it begins, in the map frame."""
    wheel_angles: Wheels
    """How far each wheel has turned by then [rad]."""
    speed: float
    """Forward speed where it begins [m/s]."""
    acceleration: float
    """Rate of change of the speed [m/s^2]."""
    steering_angle: float
    """Steering angle where it begins [rad], left positive."""
    steering_rate: float
    """Rate of change of the steering angle [rad/s]."""
    collision: Optional[Contact]
    """The contact that the car stands in, None where there is none."""

    @property
    def direction(self) -> float:
        """The direction of the motion: 1 forward, -1 in reverse, 0 if the car stands."""
        rate = self.speed or self.acceleration
        return math.copysign(1.0, rate) if rate else 0.0


class State(NamedTuple):
    """All that there is to know about the car at one instant."""

    stamp: int
    """The instant [ns]."""
    pose: Pose
    """base_footprint, the middle of the rear axle on the ground, in the map frame."""
    map_from_odom: Pose
    """Where the odometry's origin is in the map: placements move this, and driving does not."""
    speed: float
    """Forward speed [m/s]."""
    steering_angle: float
    """Steering angle [rad], left positive."""
    wheel_angles: Wheels
    """How far each wheel has turned [rad]."""
    collision: Optional[Contact] = None
    """The contact in which the car stands at a wall, from the hit until it drives away."""
    command: Optional[Command] = None
    """The last command that it got since it was placed."""
    moved: int = 0
    """The stamp of the command that set it in motion [ns]."""
    motion: Tuple[Piece, ...] = ()
    """What that makes of the car; the last piece, on which it stands, has no end."""
    ticks: int = 0
    """How many commands it has got since it was placed, those of one stamp counted once."""

    @property
    def odom_pose(self) -> Pose:
        """base_footprint in the odometry frame, which never jumps."""
        return compose(inverse(self.map_from_odom), self.pose)

    def turn_rate(self, car: Car) -> float:
        """Return the yaw rate [rad/s], counter-clockwise positive."""
        return self.speed * curvature(self.steering_angle, car.wheelbase)


def at_rest(stamp: int, pose: Pose) -> State:
    """Return the state of a car that has never moved, its odometry at zero."""
    return State(stamp, pose, pose, 0.0, 0.0, Wheels(0.0, 0.0, 0.0, 0.0))


def halted(state: State, stamp: int) -> State:
    """Return the state of a car that has been halted where `state` has it, at `stamp` [ns]."""
    return state._replace(stamp=stamp, speed=0.0, command=None, motion=())


def front_wheel_angles(steering_angle: float, car: Car) -> Tuple[float, float]:
    """Return the steering angles [rad] of the left and the right front wheel.

    Each wheel stands at a right angle to the line to the turning centre (Ackermann's condition).
    """
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return math.atan2(bend, 1.0 - side), math.atan2(bend, 1.0 + side)


def wheel_ratios(steering_angle: float, car: Car) -> Wheels:
    """Return each wheel's ground speed per unit of the rear axle's speed."""
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return Wheels(
        math.hypot(1.0 - side, bend), math.hypot(1.0 + side, bend), 1.0 - side, 1.0 + side
    )
