"""Advance a car's state in time, and apply the events that reach the car.

A command determines the car's path until the next event: its pieces are computed once, when the
command applies. Each later state is evaluated from them, so evaluating a state changes nothing.
"""

import hashlib
import math
from typing import List, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.contact import free_time, is_blocked
from mushr_ros_intro.car.model import (
    Car,
    Command,
    Contact,
    Event,
    InitialPose,
    Piece,
    State,
    halted,
)
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.geometry import compose, inverse
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import World


def advance(state: State, stamp: int, car: Car) -> State:
    """Return the state at `stamp` [ns], not before `state.stamp`, if no event comes until then.

    The car follows its last command until the command expires or a wall stops the car. After the
    command has expired the car brakes, and still steers to the command's angle. Without a limit of
    the acceleration it stops at once.
    """
    if not state.motion:
        return state._replace(stamp=stamp)
    seconds = (stamp - state.moved) / NANOSECONDS
    piece = next(piece for piece in reversed(state.motion) if piece.begin <= seconds)
    seconds -= piece.begin
    return state._replace(
        stamp=stamp,
        pose=follow(piece, seconds, car),
        speed=piece.speed + piece.acceleration * seconds,
        steering_angle=piece.steering_angle + piece.steering_rate * seconds,
        collision=piece.collision,
    )


def apply(state: State, event: Event, car: Car, world: Optional[World] = None) -> State:
    """Return the state right after `event`, which has the same stamp as `state`.

    The noise of a command depends on the car's seed and on the number of commands to drive
    (speed not 0) since the last initial pose. A command that replaces one of the same stamp does
    not count, so a message that arrives twice changes nothing. Stops do not count either: the
    mux's stop after a timeout may arrive at any time, and must not change later noise.

    Args:
        state: the state before the event.
        event: a command or an initial pose.
        car: the parameters of the car.
        world: the walls and the footprint of the car; None means no walls.
    """
    if isinstance(event, InitialPose):
        if event.pose != state.pose:  # the same pose again must not move the odometry by rounding
            odom = compose(event.pose, inverse(state.odom_pose))
            state = state._replace(pose=event.pose, map_from_odom=odom, collision=None)
        return halted(state, event.stamp)._replace(steering_angle=0.0, drive_commands=0)
    last = state.command
    is_counted = last is not None and last.stamp == event.stamp and last.speed != 0.0
    number = state.drive_commands + int(event.speed != 0.0 and not is_counted)
    state = state._replace(command=event, drive_commands=number)
    if last is None or not changes_nothing(event, last, car.command_timeout):
        motion = _motion(state, event, car, world)
        state = state._replace(moved=event.stamp, motion=motion)
    return advance(state, event.stamp, car)


def changes_nothing(event: Command, last: Command, timeout: int) -> bool:
    """Return whether a command is a stop, but the command `last` has already stopped the car.

    That is so if the command repeats the stop `last`, or if it is a plain stop (speed and steering
    angle zero) after `last` has expired, `timeout` [ns] after its stamp. So the time at which the
    mux's stop arrives does not matter.
    """
    if event.speed != 0.0 or event.acceleration != 0.0:
        return False
    if event == last._replace(stamp=event.stamp, has_stamp=event.has_stamp):
        return True
    is_plain = event.steering_angle == event.steering_angle_velocity == 0.0
    return is_plain and event.stamp >= last.stamp + timeout


def _motion(state: State, command: Command, car: Car, world: Optional[World]) -> Tuple[Piece, ...]:
    """Return the pieces of the car's path after a command, until the car stands still.

    A piece ends at the end of a ramp, where the car reverses its direction, at a wall, or when the
    command expires.
    """
    driving = _target(state, command, car)
    braking = driving._replace(speed=0.0, acceleration=car.acceleration)
    timeout = car.command_timeout / NANOSECONDS
    hit_direction = 0.0  # the direction in which the car has hit a wall since the command
    here = Piece(0.0, state.pose, state.speed, 0.0, state.steering_angle, 0.0, state.collision)
    pieces: List[Piece] = []
    while True:
        is_valid = here.begin < timeout
        speed, angle = _ramps(here, driving if is_valid else braking)
        piece = Piece(
            here.begin, here.pose, speed.begin, speed.rate, angle.begin, angle.rate, collision=None
        )
        direction = piece.direction
        if direction in (0.0, hit_direction) or is_blocked(here, piece, direction, car, world):
            piece = piece._replace(speed=0.0, acceleration=0.0, collision=here.collision)
            direction = 0.0
        if direction == piece.steering_rate == 0.0:
            return (*pieces, piece)

        seconds = min(speed.seconds, angle.seconds)
        end = here.begin + seconds
        if is_valid and end >= timeout:
            seconds, end = timeout - here.begin, timeout
        free = free_time(piece, seconds, car, world) if direction else seconds
        has_hit = free < seconds
        if has_hit:
            seconds, end, hit_direction = free, here.begin + free, direction
        if seconds > 0.0:
            pieces.append(piece)
        pose = follow(piece, seconds, car)
        contact = piece.collision
        if has_hit:
            contact = Contact(state.stamp + round(end * NANOSECONDS), pose)
        end_speed = speed.at(seconds) if direction and not has_hit else 0.0
        here = Piece(end, pose, end_speed, 0.0, angle.at(seconds), 0.0, contact)


def _target(state: State, command: Command, car: Car) -> Command:
    """Return the speed and the steering angle that the car reaches, and the rates of change.

    They include the noise. A rate is infinite if the value changes at once.
    """
    speed, angle = car.response(command.speed, command.steering_angle)
    if speed != 0.0 and car.has_command_noise:
        of_speed, of_angle = normals(car.seed, state.drive_commands)
        speed += car.speed_noise * of_speed
        angle += car.steering_noise * of_angle
    acceleration = _rate(command.acceleration, car.acceleration)
    steering_rate = _rate(command.steering_angle_velocity, car.steering_rate)
    return Command(command.stamp, speed, angle, acceleration, steering_rate)


def _rate(requested: float, limit: float) -> float:
    """Return the rate at which the car follows a command; a request of 0 means the limit."""
    return min(abs(requested), limit) if requested else limit


class _Ramp(NamedTuple):
    """A value that changes to its target at a constant rate."""

    begin: float
    end: float
    rate: float
    seconds: float  # until the end is reached; infinite if the value is already there

    def at(self, seconds: float) -> float:
        """Return the value after some time; after the ramp it stays at its end."""
        return self.end if seconds >= self.seconds else self.begin + self.rate * seconds


def _ramps(here: Piece, target: Command) -> Tuple[_Ramp, _Ramp]:
    """Return the ramps of the speed and of the steering angle from `here` on.

    A car of limited acceleration that reverses its direction stops first.
    """
    reverses = here.speed < 0.0 < target.speed or target.speed < 0.0 < here.speed
    stops_first = reverses and target.acceleration < math.inf
    return (
        _ramp(here.speed, 0.0 if stops_first else target.speed, target.acceleration),
        _ramp(here.steering_angle, target.steering_angle, target.steering_angle_velocity),
    )


def _ramp(begin: float, end: float, rate: float) -> _Ramp:
    """Return the ramp between two values at a rate, which may be infinite."""
    if begin == end or math.isinf(rate):
        return _Ramp(end, end, 0.0, math.inf)
    return _Ramp(begin, end, math.copysign(rate, end - begin), abs(end - begin) / rate)


def normals(seed: int, number: int) -> Tuple[float, float]:
    """Return two independent standard normal numbers for a command's number.

    The same arguments give the same numbers on every machine; numpy's generators may change from
    release to release. The numbers come from a hash by the Box-Muller transform.
    """
    digest = hashlib.blake2b(f"{seed} {number}".encode(), digest_size=16).digest()
    one, other = (int.from_bytes(half, "little") for half in (digest[:8], digest[8:]))
    radius = math.sqrt(-2.0 * math.log((one + 1) / 2**64))
    return radius * math.cos(math.tau * other / 2**64), radius * math.sin(math.tau * other / 2**64)
