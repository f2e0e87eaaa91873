"""Predict where a plan takes the car.

Commands go through the simulated car's own `apply` and `advance`, so the prediction and the drive
cannot disagree. All stamps count from the first command of the plan [ns]. Without a `world` there
are no walls.
"""

import math
from collections import deque
from typing import Iterable, Iterator, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.model import Car, Command, Piece, State, at_rest
from mushr_ros_intro.car.motion import advance, apply, changes_nothing
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import MAX_DURATION, Plan
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from mushr_ros_intro.world.footprint import World


class Leg(NamedTuple):
    """The motion from one command to the next."""

    row: int
    """Index of the row; the stop after the last row has the next index."""
    state: State
    """The state right after the command."""
    end: int
    """Stamp of the next command; after the stop, the stamp from which on the car is at rest."""

    def pieces(self) -> Iterator[Tuple[Piece, float]]:
        """Yield the pieces of the motion, and the duration of each [s]."""
        motion, end = self.state.motion, (self.end - self.state.stamp) / NANOSECONDS
        for piece, piece_end in zip(motion, [*(piece.begin for piece in motion[1:]), end]):
            if piece.begin < end:
                yield piece, min(piece_end, end) - piece.begin


def legs_of(plan: Plan, car: Car, world: Optional[World] = None) -> Iterator[Leg]:
    """Yield the legs of a plan, from its start pose until the car comes to rest.

    There is one leg per command, and a last one for the stop. Commands are repeated every
    COMMAND_PERIOD only where that matters: noise is drawn for each command, a command may expire
    before the next one, and at a wall the car tries again with each command. Otherwise there is
    one command per row.
    """
    period = COMMAND_PERIOD
    if world is None and not car.has_command_noise and car.command_timeout > period:
        period = MAX_DURATION
        car = car._replace(command_timeout=MAX_DURATION)
    state = at_rest(0, plan.start)
    last = used = Command(-MAX_DURATION, 0.0, 0.0)

    def after(command: Command) -> State:
        """Return the state after a command; see `changes_nothing`."""
        nonlocal last, used
        is_ignored = changes_nothing(command, last, car.command_timeout)
        used = used._replace(stamp=command.stamp, speed=0.0) if is_ignored else command
        last = command
        return apply(advance(state, command.stamp, car), used, car, world)

    now = 0
    for index, row in enumerate(plan.rows):
        row_end = now + row.duration
        for stamp in range(now, row_end, period):
            state = after(Command(stamp, row.speed, row.steering_angle))
            state = state._replace(command=None)  # so `apply` computes a motion for each command
            yield Leg(index, state, min(stamp + period, row_end))
        now = row_end
    state = after(Command(now, 0.0, 0.0))
    yield Leg(len(plan.rows), state, now + math.ceil(state.motion[-1].begin * NANOSECONDS))


def trajectory(plan: Plan, car: Car, world: Optional[World] = None) -> Iterator[State]:
    """Yield the states of the car from the start of the plan to rest; see `sampled`."""
    return sampled(legs_of(plan, car, world), car, plan.duration)


def sampled(legs: Iterable[Leg], car: Car, duration: int) -> Iterator[State]:
    """Yield the states of the car every 0.01 s, and at the end of the last leg.

    So the path is exact to 0.1 mm at 2 m/s on a radius of 0.5 m. In a drive of a longer `duration`
    [ns], there are about 10,000 states.
    """
    period, due = max(NANOSECONDS // 100, duration // 10_000), 0
    for leg in legs:
        while due < leg.end:
            yield advance(leg.state, due, car)
            due += period
    yield advance(leg.state, leg.end, car)


def states_at(
    plan: Plan, car: Car, instants: Iterable[int], world: Optional[World] = None
) -> Iterator[State]:
    """Yield the states of the car at rising instants [ns].

    Before the first command the car is at rest at the start pose.
    """
    legs = legs_of(plan, car, world)
    leg = Leg(0, at_rest(0, plan.start), 0)
    for instant in instants:
        while instant >= leg.end and leg.row < len(plan.rows):
            leg = next(legs)
        yield advance(leg.state, max(instant, leg.state.stamp), car)


def rest(plan: Plan, car: Car, world: Optional[World] = None) -> Tuple[int, Pose]:
    """Return when the car comes to rest after the plan [ns], and its pose in the map frame."""
    (last,) = deque(legs_of(plan, car, world), maxlen=1)
    return last.end, advance(last.state, last.end, car).pose


def length(plan: Plan) -> float:
    """Return the distance that the ideal car drives, forward and in reverse [m]."""
    return sum(abs(row.speed) * row.duration / NANOSECONDS for row in plan.rows)


def count_commands(plan: Plan) -> int:
    """Return how many commands path_publisher sends for a plan, without the stop."""
    return sum(-(-row.duration // COMMAND_PERIOD) for row in plan.rows)
