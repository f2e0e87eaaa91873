"""The simulated car: its state as a function of the stamped events that reached it.

Every event (a command, or a placement at a pose) applies at its stamp, not at the moment at
which it arrives. The car keeps a short history of events in the order of their stamps, so a
message that comes late, twice, or after a younger one is put in its place, and the pose at any
instant depends on the messages alone and not on how busy the machine is.

All instants are integer nanoseconds.
"""

import bisect
import math
from typing import List, NamedTuple, Tuple, Union

from mushr_ros_intro.bicycle import Pose, compose, curvature, drive_arc, inverse
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE


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
    expires: int
    """When the held command is no longer good [ns]."""
    rolled: Wheels
    """How far each wheel has turned [rad]."""

    @property
    def odom_pose(self) -> Pose:
        """base_footprint in the odometry frame, which never jumps."""
        return compose(inverse(self.map_from_odom), self.pose)

    def turn_rate(self, car: Car) -> float:
        """Return the yaw rate [rad/s], counter-clockwise positive."""
        return self.speed * curvature(self.steering_angle, car.wheelbase)


def at_rest(stamp: int, pose: Pose) -> State:
    """Return the state of a car that has never moved, its odometry at zero."""
    return State(stamp, pose, pose, 0.0, 0.0, stamp, Wheels(0.0, 0.0, 0.0, 0.0))


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


def advance(state: State, stamp: int, car: Car) -> State:
    """Return the state at `stamp` [ns], not before `state.stamp`, if nothing happens until then.

    The car drives the arc of the command that it holds until that command is no longer good,
    and then stands.
    """
    driven = min(stamp, state.expires) - state.stamp
    if driven > 0 and state.speed != 0.0:
        distance = state.speed * (driven / NANOSECONDS)
        pose = drive_arc(state.pose, distance, curvature(state.steering_angle, car.wheelbase))
        ratios = _wheel_ratios(state.steering_angle, car)
        rolled = Wheels(
            *(
                angle + distance * ratio / car.wheel_radius
                for angle, ratio in zip(state.rolled, ratios)
            )
        )
        state = state._replace(pose=pose, rolled=rolled)
    return state._replace(stamp=stamp, speed=state.speed if stamp < state.expires else 0.0)


def apply(state: State, event: Event, car: Car) -> State:
    """Return the state right after `event`, whose stamp is that of `state`."""
    if isinstance(event, Placement):
        if event.pose != state.pose:  # or a message that comes twice would move it by rounding
            odom = compose(event.pose, inverse(state.odom_pose))
            state = state._replace(pose=event.pose, map_from_odom=odom)
        return state._replace(speed=0.0, steering_angle=0.0, expires=event.stamp)
    return state._replace(
        speed=event.speed,
        steering_angle=event.steering_angle,
        expires=event.stamp + car.command_timeout,
    )


class History:
    """The events of the last while, in order, and the car's state after each of them."""

    def __init__(self, car: Car, start: State):
        """Start from the state `start`."""
        self._car = car
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
        del self._states[place + 1 :]
        for later in self._payload[place:]:
            state = advance(self._states[-1], later.stamp, self._car)
            self._states.append(apply(state, later, self._car))
        self._forget(now - STAMP_TOLERANCE)

    def state_at(self, stamp: int) -> State:
        """Return the state at `stamp` [ns]; before the history begins, that at its beginning."""
        place = bisect.bisect_right(self._events, (stamp, True))
        state = self._states[place]
        return advance(state, max(stamp, state.stamp), self._car)

    def _forget(self, horizon: int) -> None:
        """Drop the events before `horizon` [ns], but for the state that they led to."""
        old = bisect.bisect_left(self._events, (horizon, False))
        del self._events[:old], self._payload[:old], self._states[:old]
