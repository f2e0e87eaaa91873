"""Advance a car's state in time and apply the events that reach it.

A command determines the motion until the next event, up to the wall that the car may hit. Every
later instant is evaluated from there, so asking for a state between two others changes nothing.
"""

import math
from typing import List, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.bicycle import compose, inverse
from mushr_ros_intro.car.contact import World, free_time, is_blocked
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
from mushr_ros_intro.car.noise import normals
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.sim.stamps import NANOSECONDS


def advance(state: State, stamp: int, car: Car) -> State:
    """Return the state at `stamp` [ns], not before `state.stamp`, if nothing happens until then.

    The car drives as the command that it holds has it until that command is no longer good, or
    a wall is in the way, and then stands: at once, but for a car of limited acceleration, which
    brakes when no command is good any longer. Its wheels are steered to the last angle ordered.
    """
    if not state.motion:
        return state._replace(stamp=stamp)
    seconds = (stamp - state.moved) / NANOSECONDS
    piece = next(piece for piece in reversed(state.motion) if piece.begin <= seconds)
    seconds -= piece.begin
    pose, wheel_angles = follow(piece, seconds, car)
    return state._replace(
        stamp=stamp,
        pose=pose,
        speed=piece.speed + piece.acceleration * seconds,
        steering_angle=piece.steering_angle + piece.steering_rate * seconds,
        wheel_angles=wheel_angles,
        collision=piece.collision,
    )


def apply(state: State, event: Event, car: Car, world: Optional[World] = None) -> State:
    """Return the state right after `event`, whose stamp is that of `state`.

    Without a `world` there are no walls.
    """
    if isinstance(event, InitialPose):
        if event.pose != state.pose:  # or a message that comes twice would move it by rounding
            odom = compose(event.pose, inverse(state.odom_pose))
            state = state._replace(pose=event.pose, map_from_odom=odom, collision=None)
        return halted(state, event.stamp)._replace(steering_angle=0.0, ticks=0)
    last = state.command
    is_counted = last is not None and event.stamp == last.stamp
    state = state._replace(command=event, ticks=state.ticks + (not is_counted))
    if last is None or not _repeats_stop(last, event):
        motion = _set_in_motion(state, event, car, world)
        state = state._replace(moved=event.stamp, motion=motion)
    return advance(state, event.stamp, car)


def _repeats_stop(last: Command, command: Command) -> bool:
    """Say whether a command tells the car to stop as the last one did, as fast as it can."""
    is_stop = command.speed == 0.0 and command.acceleration == 0.0
    return is_stop and command == last._replace(stamp=command.stamp)


def _set_in_motion(
    state: State, command: Command, car: Car, world: Optional[World]
) -> Tuple[Piece, ...]:
    """Return what the car in a state does on a command, until it stands.

    A piece ends where a ramp does, where the car turns round, at a wall, or when the command is
    no longer good.
    """
    speed, angle = _aims(state, command, car)
    good_for = car.command_timeout / NANOSECONDS
    steering_rate = _rate(command.steering_angle_velocity, car.steering_rate)
    stuck = 0.0  # the direction in which it has hit a wall
    pieces: List[Piece] = []
    here = Piece(
        0.0,
        state.pose,
        state.wheel_angles,
        state.speed,
        0.0,
        state.steering_angle,
        0.0,
        state.collision,
    )
    while True:
        is_good = here.begin < good_for
        aim = speed if is_good else 0.0
        acceleration = _rate(command.acceleration if is_good else 0.0, car.acceleration)
        turns_round = (here.speed < 0.0 < aim or aim < 0.0 < here.speed) and acceleration < math.inf
        speed_ramp = _ramp(here.speed, 0.0 if turns_round else aim, acceleration)
        angle_ramp = _ramp(here.steering_angle, angle, steering_rate)
        piece = here._replace(
            speed=speed_ramp.begin,
            acceleration=speed_ramp.rate,
            steering_angle=angle_ramp.begin,
            steering_rate=angle_ramp.rate,
            collision=None,
        )
        direction = _sign(piece.speed or piece.acceleration)
        is_stuck = bool(direction) and (
            direction == stuck or is_blocked(here, piece, direction, car, world)
        )
        if is_stuck or not direction:
            piece = piece._replace(speed=0.0, acceleration=0.0, collision=here.collision)
            speed_ramp = _Ramp(0.0, 0.0, 0.0, math.inf)
        if not direction and angle_ramp.rate == 0.0:
            return (*pieces, piece)

        seconds = min(speed_ramp.seconds, angle_ramp.seconds)
        until = here.begin + seconds
        if is_good and until >= good_for:
            seconds, until = good_for - here.begin, good_for
        contact = piece.collision
        if world is not None and direction and not is_stuck:
            free = free_time(piece, seconds, car, world)
            if free < seconds:
                seconds, until, stuck = free, here.begin + free, direction
                stamp = state.stamp + round(until * NANOSECONDS)
                contact = Contact(stamp, follow(piece, seconds, car)[0])
        if seconds > 0.0:
            pieces.append(piece)
        pose, wheel_angles = follow(piece, seconds, car)
        here = Piece(
            until,
            pose,
            wheel_angles,
            0.0 if contact else speed_ramp.at(seconds),
            0.0,
            angle_ramp.at(seconds),
            0.0,
            contact,
        )


class _Ramp(NamedTuple):
    """How a speed or an angle changes towards what it is to be."""

    begin: float
    end: float
    rate: float
    seconds: float  # infinite if it is there already

    def at(self, seconds: float) -> float:
        """Return the value after some time, its end at the latest."""
        return self.end if seconds >= self.seconds else self.begin + self.rate * seconds


def _ramp(begin: float, end: float, rate: float) -> _Ramp:
    """Return the way from one value to another at a rate, which may be infinite."""
    if begin == end or math.isinf(rate):
        return _Ramp(end, end, 0.0, math.inf)
    return _Ramp(begin, end, math.copysign(rate, end - begin), abs(end - begin) / rate)


def _rate(asked: float, most: float) -> float:
    """Return the rate at which the car follows an order; 0 asks for as fast as it can."""
    return min(abs(asked), most) if asked else most


def _aims(state: State, command: Command, car: Car) -> Tuple[float, float]:
    """Return the speed [m/s] and the steering angle [rad] at which a command makes the car aim."""
    speed, angle = car.within_limits(command.speed, command.steering_angle)
    if speed != 0.0 and (car.speed_noise or car.steering_noise):
        of_speed, of_angle = normals(car.seed, state.ticks)
        speed += car.speed_noise * of_speed
        angle += car.steering_noise * of_angle
    return speed, angle


def _sign(value: float) -> float:
    """Return 1, -1, or 0 for 0."""
    return math.copysign(1.0, value) if value else 0.0
