"""Say where a plan takes the car, before it is driven.

The commands go through the simulated car's own `apply` and `advance`, so the two cannot disagree.
"""

import math
from collections import deque
from itertools import accumulate
from typing import Iterable, Iterator, Optional, Tuple

from mushr_ros_intro.car.bicycle import Pose, curvature, drive_arc
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Car, Command, State, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.plan.model import MAX_DURATION, Plan
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS


def trajectory(plan: Plan, car: Car, period: int, world: Optional[World] = None) -> Iterator[State]:
    """Yield the states of the car along the plan, from its start pose until it stands for good.

    Their stamps count from the first command [ns]; there is one every `period` [ns], and a last
    one when the car has come to rest after the end of the plan. Without a `world` there are no
    walls.
    """
    car, commands = _commands(plan, car, world)
    state = at_rest(0, plan.start)
    due = 0
    for command in commands:
        while due < command.stamp:
            yield advance(state, due, car)
            due += period
        state = apply(advance(state, command.stamp, car), command, car, world)
    end = _rest(state)
    while due < end:
        yield advance(state, due, car)
        due += period
    yield advance(state, end, car)


def states_at(plan: Plan, car: Car, instants: Iterable[int]) -> Iterator[State]:
    """Yield the states of the car at rising instants, counted from the first command [ns].

    Before that, it stands at the start pose. There are no walls.
    """
    car, commands = _commands(plan, car, None)
    state = at_rest(0, plan.start)
    upcoming = next(commands, None)
    for instant in instants:
        while upcoming is not None and upcoming.stamp <= instant:
            state = apply(advance(state, upcoming.stamp, car), upcoming, car)
            upcoming = next(commands, None)
        yield advance(state, max(instant, state.stamp), car)


def row_poses(plan: Plan, car: Car, world: Optional[World] = None) -> Iterator[Pose]:
    """Yield the start pose of the plan, and the pose of the car at the end of each row.

    In the map frame. For the ideal car, where there are no walls, it is one arc a row, in closed
    form; a car with limits may not yet stand at the end of the last row.
    """
    pose = plan.start
    yield pose
    if _is_closed_form(car, world):
        for row in plan.rows:
            distance = row.speed * (row.duration / NANOSECONDS)
            bend = curvature(row.steering_angle, car.wheelbase)
            pose = drive_arc(pose, distance, bend)
            yield pose
        return
    car, commands = _commands(plan, car, world)
    state = at_rest(0, pose)
    row_ends = accumulate(row.duration for row in plan.rows)
    end = next(row_ends)
    for command in commands:
        state = apply(advance(state, command.stamp, car), command, car, world)
        if command.stamp == end:
            yield state.pose
            end = next(row_ends, end)


def rest(plan: Plan, car: Car, world: Optional[World] = None) -> Tuple[int, Pose]:
    """Return when the car stands for good [ns after the first command], and where [map frame]."""
    if _is_closed_form(car, world):
        (pose,) = deque(row_poses(plan, car, world), maxlen=1)
        return plan.duration, pose
    car, commands = _commands(plan, car, world)
    state = at_rest(0, plan.start)
    for command in commands:
        state = apply(advance(state, command.stamp, car), command, car, world)
    end = _rest(state)
    return end, advance(state, end, car).pose


def final_pose(plan: Plan, car: Car, world: Optional[World] = None) -> Pose:
    """Return the pose at which the car comes to rest after the plan, in the map frame."""
    return rest(plan, car, world)[1]


def length(plan: Plan) -> float:
    """Return how far the ideal car drives [m], forward and in reverse."""
    return sum(abs(row.speed) * row.duration / NANOSECONDS for row in plan.rows)


def _is_closed_form(car: Car, world: Optional[World]) -> bool:
    """Say whether the car drives one arc a row."""
    return car.is_ideal and world is None and car.command_timeout >= COMMAND_PERIOD


def _commands(plan: Plan, car: Car, world: Optional[World]) -> Tuple[Car, Iterator[Command]]:
    """Return the car and the commands that it gets, stamped from 0 on; the last is a stop.

    Where repeating a command changes nothing, it is one a row, and a car that holds it as long:
    noise is drawn for every command, and at a wall the car tries anew with every one.
    """
    has_noise = car.speed_noise or car.steering_noise
    period = COMMAND_PERIOD
    if world is None and not has_noise and car.command_timeout >= period:
        period = MAX_DURATION
        car = car._replace(command_timeout=MAX_DURATION)

    def commands() -> Iterator[Command]:
        begin = 0
        for row in plan.rows:
            speed, angle = row.speed, row.steering_angle
            end = begin + row.duration
            for stamp in range(begin, end, period):
                yield Command(stamp, speed, angle)
            begin = end
        yield Command(begin, 0.0, 0.0)

    return car, commands()


def _rest(state: State) -> int:
    """Return the instant [ns] from which on the car in a state stands for good."""
    return state.moved + math.ceil(state.motion[-1].begin * NANOSECONDS)
