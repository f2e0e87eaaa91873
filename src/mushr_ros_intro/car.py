"""The simulated car: its state as a function of the stamped events that reached it.

Every event (a command, or a placement at a pose) applies at its stamp, not at the moment at
which it arrives. The car keeps a short history of events in the order of their stamps, so a
message that comes late, twice, or after a younger one is put in its place, and the pose at any
instant depends on the messages alone and not on how busy the machine is.

What a command makes of the car until the next event, up to the wall that it may hit, is settled
when the event applies. So every later instant is evaluated from there, and asking for one between
two others changes nothing.

All instants are integer nanoseconds.
"""

import bisect
import math
from typing import List, NamedTuple, Optional, Tuple, Union

from mushr_ros_intro.bicycle import Pose, compose, curvature, drive_arc, inverse
from mushr_ros_intro.footprint import Footprint, free_way, is_free
from mushr_ros_intro.grid import Grid
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE

_NUDGE = 1e-7
"""A car at a wall tries to drive this far [m] to find out whether the wall is in its way."""


class Car(NamedTuple):
    """What a car is: its size and its habits. The defaults are MuSHR's."""

    wheelbase: float = 0.33
    """Distance between the axles [m]."""
    track: float = 0.25
    """Distance between the left and the right wheels [m]."""
    wheel_radius: float = 0.0488
    """Radius of the wheels [m]."""
    command_timeout: int = 200_000_000
    """How long a command is good for after its stamp [ns]; then the car stops."""


class World(NamedTuple):
    """What the car may hit, and with what."""

    grid: Grid
    """The map."""
    footprint: Footprint = Footprint()
    """The car's body."""


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


class Placement(NamedTuple):
    """An order to be at a pose, at rest, at `stamp`."""

    stamp: int
    """When it applies [ns]."""
    pose: Pose
    """Where, in the map frame."""


Event = Union[Command, Placement]


class Wheels(NamedTuple):
    """One number for each wheel."""

    front_left: float
    front_right: float
    back_left: float
    back_right: float


class Piece(NamedTuple):
    """A part of the car's way, on which it holds its speed and its steering angle."""

    begin: float
    """When it begins [s], counted from the event that set the car in motion."""
    pose: Pose
    """Where it begins, in the map frame."""
    rolled: Wheels
    """How far each wheel has turned by then [rad]."""
    speed: float
    """Forward speed [m/s]."""
    steering_angle: float
    """Steering angle [rad], left positive."""
    collision: Optional[Contact]
    """The contact that the car stands in, None where there is none."""


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
    rolled: Wheels
    """How far each wheel has turned [rad]."""
    collision: Optional[Contact] = None
    """The contact in which the car stands at a wall, from the hit until it drives away."""
    moved: int = 0
    """The stamp of the event that set it in motion [ns]."""
    motion: Tuple[Piece, ...] = ()
    """What that makes of the car; the last piece, on which it stands, has no end."""

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
    return state._replace(stamp=stamp, speed=0.0, motion=())


def front_wheel_angles(steering_angle: float, car: Car) -> Tuple[float, float]:
    """Return the steering angles [rad] of the left and the right front wheel.

    Each wheel stands at a right angle to the line to the turning centre (Ackermann's condition).
    """
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return math.atan2(bend, 1.0 - side), math.atan2(bend, 1.0 + side)


def _wheel_ratios(steering_angle: float, car: Car) -> Wheels:
    """Return each wheel's ground speed per unit of the rear axle's speed."""
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return Wheels(
        math.hypot(1.0 - side, bend), math.hypot(1.0 + side, bend), 1.0 - side, 1.0 + side
    )


def _follow(piece: Piece, seconds: float, car: Car) -> Tuple[Pose, Wheels]:
    """Return the pose, and how far each wheel has turned [rad], some time into a piece."""
    distance = piece.speed * seconds
    if distance == 0.0:
        return piece.pose, piece.rolled
    pose = drive_arc(piece.pose, distance, curvature(piece.steering_angle, car.wheelbase))
    ratios = _wheel_ratios(piece.steering_angle, car)
    rolled = Wheels(
        *(angle + distance * ratio / car.wheel_radius for angle, ratio in zip(piece.rolled, ratios))
    )
    return pose, rolled


def advance(state: State, stamp: int, car: Car) -> State:
    """Return the state at `stamp` [ns], not before `state.stamp`, if nothing happens until then.

    The car drives the arc of the command that it holds until that command is no longer good, or
    a wall is in the way, and then stands.
    """
    if not state.motion:
        return state._replace(stamp=stamp)
    seconds = (stamp - state.moved) / NANOSECONDS
    piece = next(piece for piece in reversed(state.motion) if piece.begin <= seconds)
    pose, rolled = _follow(piece, seconds - piece.begin, car)
    return state._replace(
        stamp=stamp,
        pose=pose,
        speed=piece.speed,
        rolled=rolled,
        collision=piece.collision,
    )


def apply(state: State, event: Event, car: Car, world: Optional[World] = None) -> State:
    """Return the state right after `event`, whose stamp is that of `state`.

    Without a `world` there are no walls.
    """
    if isinstance(event, Placement):
        if event.pose != state.pose:  # or a message that comes twice would move it by rounding
            odom = compose(event.pose, inverse(state.odom_pose))
            state = state._replace(pose=event.pose, map_from_odom=odom, collision=None)
        return halted(state, event.stamp)._replace(steering_angle=0.0)
    motion = _set_in_motion(state, event, car, world)
    state = state._replace(steering_angle=event.steering_angle, moved=event.stamp, motion=motion)
    return advance(state, event.stamp, car)


def _set_in_motion(
    state: State, command: Command, car: Car, world: Optional[World]
) -> Tuple[Piece, ...]:
    """Return what the car in a state does on a command, until it stands."""
    rest = Piece(0.0, state.pose, state.rolled, 0.0, command.steering_angle, state.collision)
    if command.speed == 0.0:
        return (rest,)
    piece = rest._replace(speed=command.speed, collision=None)
    if world is not None and _is_blocked(state, piece, car, world):
        return (rest,)
    end = car.command_timeout / NANOSECONDS
    contact = None
    if world is not None:
        free = _free_time(piece, end, car, world)
        if free < end:
            end = free
            stamp = state.stamp + round(end * NANOSECONDS)
            contact = Contact(stamp, _follow(piece, end, car)[0])
    pose, rolled = _follow(piece, end, car)
    rest = rest._replace(begin=end, pose=pose, rolled=rolled, collision=contact)
    return (piece, rest)


def _is_blocked(state: State, piece: Piece, car: Car, world: World) -> bool:
    """Say whether the wall at which the car stands is in the way.

    The distance to the wall is known to TOUCH; if the car could go further it would creep.
    """
    if state.collision is None:
        return False
    ahead = math.copysign(_NUDGE, piece.speed)
    pose = drive_arc(state.pose, ahead, curvature(piece.steering_angle, car.wheelbase))
    return not is_free(world.grid, world.footprint, pose)


def _free_time(piece: Piece, seconds: float, car: Car, world: World) -> float:
    """Return for how long the car can follow a piece before it hits something, at most [s]."""
    speed = abs(piece.speed)

    def at(way: float) -> Pose:
        return _follow(piece, way / speed, car)[0]

    way = free_way(world.grid, world.footprint, at, speed * seconds)
    return seconds if way == speed * seconds else way / speed


class History:
    """The events of the last while, in order, and the car's state after each of them."""

    def __init__(self, car: Car, start: State, world: Optional[World] = None):
        """Start from the state `start`, in a `world` where there are walls."""
        self._car = car
        self._world = world
        self._events: List[Tuple[int, bool]] = []  # the order: placements before commands
        self._payload: List[Event] = []
        self._states = [start]  # the state after each event; the first is from before them

    @property
    def last_stamp(self) -> int:
        """The stamp [ns] of the youngest event, or of the start."""
        return self._states[-1].stamp

    def add(self, event: Event, now: int) -> None:
        """Put `event`, which arrives at `now` [ns], in its place, and redo what came after it.

        At the same stamp a placement comes before commands; otherwise the later arrival counts.
        An event from before the history begins applies at its beginning; it reaches back
        STAMP_TOLERANCE from the latest `now`.
        """
        event = event._replace(stamp=max(event.stamp, self._states[0].stamp))
        key = (event.stamp, isinstance(event, Command))
        place = bisect.bisect_right(self._events, key)
        self._events.insert(place, key)
        self._payload.insert(place, event)
        self._redo(place)
        self._forget(now - STAMP_TOLERANCE)

    def build(self, world: World) -> None:
        """Put up the walls of `world`, in the place of others, for all that is in the history."""
        self._world = world
        self._redo(0)

    def state_at(self, stamp: int) -> State:
        """Return the state at `stamp` [ns]; before the history begins, that at its beginning."""
        place = bisect.bisect_right(self._events, (stamp, True))
        state = self._states[place]
        return advance(state, max(stamp, state.stamp), self._car)

    def _redo(self, place: int) -> None:
        """Work out the states after the events from the one at `place` on."""
        del self._states[place + 1 :]
        for event in self._payload[place:]:
            state = advance(self._states[-1], event.stamp, self._car)
            self._states.append(apply(state, event, self._car, self._world))

    def _forget(self, horizon: int) -> None:
        """Drop the events before `horizon` [ns], but for the state that they led to."""
        old = bisect.bisect_left(self._events, (horizon, False))
        del self._events[:old], self._payload[:old], self._states[:old]
