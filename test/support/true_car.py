"""A car with faults, integrated in steps of 1 ms: independent of the simulated car of the package.

A fault is a number of TrueCar that is not its default.
"""

import math
from dataclasses import dataclass
from typing import List, Tuple

from mushr_ros_intro.comparison.drive_log import DriveLog, Received, drive_log
from mushr_ros_intro.stamps import NANOSECONDS
from support.cars import BEGIN

_MS = 1_000_000
_BEFORE, _AFTER = 2000, 2000
"""Of the recording before the first command and after the last one [ms]."""

Commands = List[Tuple[int, float, float]]
"""Begin [ms], speed [m/s] and steering angle [rad]."""


@dataclass(frozen=True)
class TrueCar:
    """A car; its commands are within the limits of mushr_nano."""

    wheelbase: float = 0.30
    speed_gain: float = 1.0
    steering_gain: float = 1.0
    steering_offset: float = 0.0
    acceleration: float = 3.8889
    steering_rate: float = 3.2
    speed_noise: float = 0.0
    steering_noise: float = 0.0
    speed_cap: float = math.inf
    left_stop: float = math.inf
    right_stop: float = math.inf
    speed_dead_band: float = 0.0
    steering_dead_band: float = 0.0
    imbalance: float = 0.0
    play: float = 0.0
    fading: float = 0.0
    speed_lag: float = 0.0
    steering_lag: float = 0.0
    understeer: float = 0.0
    point: float = 0.0
    jump: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x and y [m] and turn [rad] in the map, about the origin, ..."""
    jump_time: float = math.inf
    """... at this time [s]."""

    def targets(self, speed, angle, now):
        """Return the speed [m/s] and the steering angle [rad] that a command leads to."""
        speed = speed if abs(speed) > self.speed_dead_band else 0.0
        angle = angle if abs(angle) > self.steering_dead_band else 0.0
        speed *= self.speed_gain * (1.0 - self.fading) ** now
        side = 1.0 + self.imbalance * ((angle > 0.0) - (angle < 0.0))
        angle = angle * self.steering_gain * side + self.steering_offset
        speed = max(-self.speed_cap, min(self.speed_cap, speed))
        return speed, max(-self.right_stop, min(self.left_stop, angle))


def commands_of(plan, corrected=lambda speed, angle: (speed, angle)) -> Commands:
    """Return the commands for the rows of a plan, every 0.1 s, and the stop."""
    commands, now = [], 0
    for row in plan.rows:
        end = now + row.duration // _MS
        values = corrected(row.speed, row.steering_angle)
        commands += [(begin, *values) for begin in range(now, end, 100)]
        now = end
    return [*commands, (now, 0.0, 0.0)]


def driven_path(commands, car, dice):
    """Return x [m], y [m] and theta [rad] every 1 ms, from _BEFORE until _AFTER."""
    x = y = theta = speed = angle = lagged_speed = lagged_angle = wheel = 0.0
    target, poses, todo = (0.0, 0.0), [], list(commands)
    noise = (0.0, 0.0)
    raw = (0.0, 0.0)
    for now in range(-_BEFORE, commands[-1][0] + _AFTER):
        while todo and todo[0][0] <= now:
            _, *raw = todo.pop(0)
            noise = (dice.gauss(0.0, car.speed_noise), dice.gauss(0.0, car.steering_noise))
        target = car.targets(*raw, max(0.0, now / 1000.0))
        if target[0]:
            target = (target[0] + noise[0], target[1] + noise[1])
        reach = car.acceleration / 1000.0
        speed += max(-reach, min(reach, target[0] - speed))
        if now >= 0:  # the wheels stand straight until the first command
            reach = car.steering_rate / 1000.0
            angle += max(-reach, min(reach, target[1] - angle))
        lagged_speed = _lag(lagged_speed, speed, car.speed_lag)
        lagged_angle = _lag(lagged_angle, angle, car.steering_lag)
        wheel = max(lagged_angle - car.play / 2, min(lagged_angle + car.play / 2, wheel))
        longer = car.wheelbase * (1.0 + car.understeer * lagged_speed**2)
        turn = lagged_speed * math.tan(wheel) / longer / 1000.0
        x += lagged_speed * math.cos(theta + turn / 2) / 1000.0
        y += lagged_speed * math.sin(theta + turn / 2) / 1000.0
        theta += turn
        poses.append((x, y, theta))
    return poses


def _lag(value, target, seconds):
    return target + (value - target) * math.exp(-0.001 / seconds) if seconds else target


def recorded(
    plan, car, dice, rate, position=0.02, heading=0.02, delay=0.05, missing=0.0
) -> DriveLog:
    """Return a recorded drive, whose start pose is that of the plan.

    Args:
        plan: what is driven.
        car: the true car.
        dice: a random.Random.
        rate: of the poses [Hz].
        position, heading: standard deviations of a measured pose [m, rad].
        delay: from a command to its effect on the pose [s].
        missing: the recording of the commands begins so late [s].
    """
    commands = commands_of(plan)
    path = driven_path(commands, car, dice)
    stamps, poses = [], []
    for number in range(int(len(path) * rate / 1000.0)):
        place = int(number * 1000.0 / rate)
        x, y, theta = path[place]
        x, y = x + car.point * math.cos(theta), y + car.point * math.sin(theta)
        if place - _BEFORE > 1000.0 * car.jump_time:
            east, north, turn = car.jump
            cos, sin = math.cos(turn), math.sin(turn)
            x, y, theta = cos * x - sin * y + east, sin * x + cos * y + north, theta + turn
        cos, sin = math.cos(plan.start.theta), math.sin(plan.start.theta)
        x, y = plan.start.x + cos * x - sin * y, plan.start.y + sin * x + cos * y
        stamps.append(BEGIN + (place - _BEFORE) * _MS + int(delay * NANOSECONDS))
        values = (x, y, theta + plan.start.theta)
        poses.append(tuple(dice.gauss(v, s) for v, s in zip(values, (position, position, heading))))
    kept = [each for each in commands if each[0] >= 1000.0 * missing]
    sent = [BEGIN + begin * _MS for begin, _, _ in kept]
    commands_received = Received("/commands", sent, sent, [each[1:] for each in kept])
    return drive_log(
        "a.bag", commands_received, Received("/pose", stamps, stamps, poses), 200 * _MS
    )
