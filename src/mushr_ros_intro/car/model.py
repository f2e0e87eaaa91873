"""The simulated car: its state as a function of the stamped events that reached it.

Every event (a command, or a placement at a pose) applies at its stamp, not at the moment at
which it arrives. The car keeps a short history of events in the order of their stamps, so a
message that comes late, twice, or after a younger one is put in its place, and the pose at any
instant depends on the messages alone and not on how busy the machine is.

What a command makes of the car until the next event, up to the wall that it may hit, is settled
when the event applies. So every later instant is evaluated from there, and asking for one between
two others changes nothing. Nor does a stop that repeats another, not even by rounding: a mux adds
one, while the car may have come to rest, or said where it brakes.

All instants are integer nanoseconds.
"""

import bisect
import hashlib
import math
from typing import List, NamedTuple, Optional, Tuple, Union

from mushr_ros_intro.car.bicycle import Pose, compose, curvature, drive_arc, inverse
from mushr_ros_intro.sim.stamps import NANOSECONDS, STAMP_TOLERANCE
from mushr_ros_intro.world.footprint import Footprint, free_way, is_free
from mushr_ros_intro.world.grid import Grid

_NUDGE = 1e-7
"""A car at a wall tries to drive this far [m] to find out whether the wall is in its way."""

_LARGEST_STEP = 0.125
"""By how much at most [rad] things turn in a step of the quadrature.

Its error grows with the seventh power; along figure_8 it comes to some 1e-11 m.
"""

_MOST_STEPS = 1000
"""More steps than this the quadrature does not take, for angles next to a right angle."""

_ROOT = math.sqrt(15.0)
_NODES = (0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10)
_WEIGHTS = (5 / 18, 4 / 9, 5 / 18)
_TO_NODES = (
    (5 / 36, 2 / 9 - _ROOT / 15, 5 / 36 - _ROOT / 30),
    (5 / 36 + _ROOT / 24, 2 / 9, 5 / 36 - _ROOT / 24),
    (5 / 36 + _ROOT / 30, 2 / 9 + _ROOT / 15, 5 / 36),
)
"""Weights of the values at the nodes in the integral up to each node."""


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
    acceleration: float = 0.0
    """Rate at which the speed is to change [m/s^2], of any sign; 0: as fast as the car can."""
    steering_angle_velocity: float = 0.0
    """Rate at which the steering angle is to change [rad/s], of any sign; 0: likewise."""


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
    """A part of the car's way, on which speed and steering angle change at constant rates.

    The car does not turn round on it: it goes forward, or in reverse, or stands.
    """

    begin: float
    """When it begins [s], counted from the event that set the car in motion."""
    pose: Pose
    """Where it begins, in the map frame."""
    rolled: Wheels
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


def _wheel_ratios(steering_angle: float, car: Car) -> Wheels:
    """Return each wheel's ground speed per unit of the rear axle's speed."""
    bend = math.tan(steering_angle)
    side = 0.5 * car.track / car.wheelbase * bend
    return Wheels(
        math.hypot(1.0 - side, bend), math.hypot(1.0 + side, bend), 1.0 - side, 1.0 + side
    )


def _follow(piece: Piece, seconds: float, car: Car) -> Tuple[Pose, Wheels]:
    """Return the pose, and how far each wheel has turned [rad], some time into a piece."""
    if seconds == 0.0:
        return piece.pose, piece.rolled
    if piece.steering_rate != 0.0 and (piece.speed != 0.0 or piece.acceleration != 0.0):
        return _quadrature(piece, seconds, car)
    distance = piece.speed * seconds + 0.5 * piece.acceleration * seconds * seconds
    if distance == 0.0:
        return piece.pose, piece.rolled
    pose = drive_arc(piece.pose, distance, curvature(piece.steering_angle, car.wheelbase))
    ratios = _wheel_ratios(piece.steering_angle, car)
    rolled = Wheels(
        *(angle + distance * ratio / car.wheel_radius for angle, ratio in zip(piece.rolled, ratios))
    )
    return pose, rolled


def _quadrature(piece: Piece, seconds: float, car: Car) -> Tuple[Pose, Wheels]:
    """Return the same as `_follow`, where the steering angle changes on the way.

    The turn rate does not depend on the pose, so this is a matter of two integrals, one in the
    other. Both are taken at the three Gauss-Legendre points of each of many short steps
    (collocation, see Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I",
    section II.7).
    """
    fastest = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))
    end_angle = piece.steering_angle + piece.steering_rate * seconds
    bend = max(1.0, abs(math.tan(piece.steering_angle)), abs(math.tan(end_angle)))
    change = (fastest / car.wheelbase + abs(piece.steering_rate)) * bend * seconds  # about [rad]
    steps = max(1, min(_MOST_STEPS, math.ceil(change / _LARGEST_STEP)))
    step = seconds / steps
    x, y, theta = piece.pose
    ways = [0.0, 0.0, 0.0, 0.0]
    for number in range(steps):
        nodes = [(number + node) * step for node in _NODES]
        distances = [(piece.speed + piece.acceleration * node) * step for node in nodes]
        angles = [piece.steering_angle + piece.steering_rate * node for node in nodes]
        turns = [s * curvature(angle, car.wheelbase) for s, angle in zip(distances, angles)]
        for to_node, weight, distance, angle in zip(_TO_NODES, _WEIGHTS, distances, angles):
            heading = theta + sum(part * turn for part, turn in zip(to_node, turns))
            x += weight * distance * math.cos(heading)
            y += weight * distance * math.sin(heading)
            for wheel, ratio in enumerate(_wheel_ratios(angle, car)):
                ways[wheel] += weight * distance * ratio
        theta += sum(weight * turn for weight, turn in zip(_WEIGHTS, turns))
    rolled = Wheels(*(angle + way / car.wheel_radius for angle, way in zip(piece.rolled, ways)))
    return Pose(x, y, theta), rolled


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
    pose, rolled = _follow(piece, seconds, car)
    return state._replace(
        stamp=stamp,
        pose=pose,
        speed=piece.speed + piece.acceleration * seconds,
        steering_angle=piece.steering_angle + piece.steering_rate * seconds,
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
        state.rolled,
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
            direction == stuck or _is_blocked(here, piece, direction, car, world)
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
            free = _free_time(piece, seconds, car, world)
            if free < seconds:
                seconds, until, stuck = free, here.begin + free, direction
                stamp = state.stamp + round(until * NANOSECONDS)
                contact = Contact(stamp, _follow(piece, seconds, car)[0])
        if seconds > 0.0:
            pieces.append(piece)
        pose, rolled = _follow(piece, seconds, car)
        here = Piece(
            until,
            pose,
            rolled,
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
        of_speed, of_angle = _normals(car.seed, state.ticks)
        speed += car.speed_noise * of_speed
        angle += car.steering_noise * of_angle
    return speed, angle


def _normals(seed: int, tick: int) -> Tuple[float, float]:
    """Return two independent normal random numbers, the same for the same arguments anywhere.

    Box and Muller's method, on a hash; numpy's generators may change from release to release.
    """
    digest = hashlib.blake2b(f"{seed} {tick}".encode(), digest_size=16).digest()
    one, other = (int.from_bytes(half, "little") for half in (digest[:8], digest[8:]))
    radius = math.sqrt(-2.0 * math.log((one + 1) / 2**64))
    return radius * math.cos(math.tau * other / 2**64), radius * math.sin(math.tau * other / 2**64)


def _sign(value: float) -> float:
    """Return 1, -1, or 0 for 0."""
    return math.copysign(1.0, value) if value else 0.0


def _is_blocked(
    here: Piece, piece: Piece, direction: float, car: Car, world: Optional[World]
) -> bool:
    """Say whether the wall at which the car stands is in the way of a piece.

    The distance to the wall is known to TOUCH; if the car could go further it would creep.
    """
    if world is None or here.collision is None:
        return False
    bend = curvature(piece.steering_angle, car.wheelbase)
    return not is_free(*world, drive_arc(here.pose, direction * _NUDGE, bend))


def _free_time(piece: Piece, seconds: float, car: Car, world: World) -> float:
    """Return for how long the car can follow a piece before it hits something, at most [s]."""
    speed = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))

    def at(way: float) -> Pose:
        return _follow(piece, way / speed, car)[0]

    way = free_way(*world, at, speed * seconds)
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
