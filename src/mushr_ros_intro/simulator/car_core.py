"""The simulated car without topics and clocks: events at their stamps, and states at instants.

A node and a replay use the same `CarCore`. All instants are in nanoseconds [ns].
"""

from typing import Any, Callable, List, Optional, Sequence

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, Event, InitialPose, State, at_rest, halted
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import as_float32
from mushr_ros_intro.stamps import (
    NANOSECONDS,
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    effective_stamp,
)
from mushr_ros_intro.world.footprint import World, is_free


class CarCore:
    """The events of a car, and its states."""

    def __init__(
        self,
        car: Car,
        start: Pose,
        now: int,
        warn: Callable[..., Any],
        quiet_within: int = SIMULATED_STAMP_TOLERANCE,
    ) -> None:
        """Place the car.

        Args:
            car: the car.
            start: the pose at which it stands.
            now: the current time [ns].
            warn: logs a warning, given the shortest time between two of its kind [s] and the text.
            quiet_within: a stamp that differs by more from the time of its arrival causes a warning
                [ns].
        """
        self.world: Optional[World] = None
        """The map; None if there is none."""
        self._car, self._start, self._now = car, start, now
        self._warn, self._quiet_within = warn, quiet_within
        self._history = History(car, at_rest(now, start))

    def state_at(self, instant: int) -> State:
        """Return the car's state at an instant [ns]."""
        return self._history.state_at(instant)

    def states(self, instants: Sequence[int], now: int) -> List[State]:
        """Return the car's states at instants [ns], as known at `now` [ns]."""
        self.read(now)
        return [self._history.state_at(instant) for instant in instants]

    def add(self, event: Event, topic: str, now: int) -> Optional[Event]:
        """Add an event that arrives at `now` [ns] from a topic or service.

        Return it with the stamp at which it applies; None if it is rejected.
        """
        if not self._accepts(event, topic):
            return None
        now = self.read(now)
        stamp = effective_stamp(event.stamp, now)
        applied = event
        if stamp != event.stamp:
            applied = event._replace(stamp=stamp, has_stamp=False)
        self._history.add(applied, now)
        # MuSHR sends stops with one old stamp while no input drives.
        is_stop = isinstance(event, Command) and not event.speed
        if event.stamp and not is_stop and abs(event.stamp - now) > self._quiet_within:
            self._warn(
                1.0,
                f"the stamp of a message on {topic} differs by "
                f"{(event.stamp - now) / NANOSECONDS:+.1f} s from the car's clock; expected at "
                f"most {STAMP_TOLERANCE / NANOSECONDS:g} s. The message is applied on arrival. "
                "Its sender was suspended, as by Ctrl-Z, or its stamp is wrong, or the clocks of "
                "two machines differ",
            )
        return applied

    def _accepts(self, event: Event, topic: str) -> bool:
        """Return whether the car accepts an event; log a rejected event or a limited command."""
        if isinstance(event, InitialPose):
            if self.world is None or is_free(*self.world, event.pose):
                return True
            self._warn(
                1.0,
                f"rejected the initial pose {event.pose} on {topic}: the car would be inside a "
                "wall. The car does not move; expected a pose with enough space for its body",
            )
            return False
        asked = (event.speed, event.steering_angle)
        possible = self._car.within_limits(*asked)
        if asked != tuple(map(as_float32, possible)):  # a command has float32 values
            self._warn(
                10.0,
                "a command asks for {:g} m/s and {:g} rad; within its limits, the car drives {:g} "
                "m/s and {:g} rad".format(*asked, *possible),
            )
        return True

    def set_walls(self, world: World, now: int) -> None:
        """Use a map from now on [ns]."""
        self.world = world
        self._history.set_walls(world, self.read(now))
        pose = self._history.state_at(self.read(now)).pose
        if not is_free(*world, pose):
            self._warn(
                0.0, f"the car is inside a wall at {pose}; drive it out, or place it elsewhere"
            )

    def reset(self, now: int) -> None:
        """Place the car at its start pose, at rest, with its odometry at zero [ns]."""
        self._history = History(self._car, at_rest(self.read(now), self._start), self.world)

    def read(self, now: int) -> int:
        """Note the time, and return it [ns]. If the clock was set back, the car stops."""
        if now < self._now:
            self._warn(0.0, "the clock was set back; the car stops and forgets its commands")
            state = self._history.state_at(self._now)
            self._history = History(self._car, halted(state, now), self.world)
        self._now = now
        return now
