"""Drive a plan many times, each run with its own random errors: the spread of a plan.

The cars are driven side by side, as numpy arrays. They get the commands of path_publisher.
"""

from typing import Iterator, NamedTuple, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.preview.side_by_side import arcs, ramped
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

_STEPS = 3
"""Number of arcs that approximate a command with a long ramp; any other command is one arc."""


START_ERRORS = (0.02, 0.02)
"""Standard deviations of x and y, and of theta, of a car that is placed by eye [m, rad].

Our choice: the width of a thumb, and a degree.
"""


class Spread(NamedTuple):
    """The final poses of many runs of a plan."""

    seed: int
    car: Car
    """With its errors: a speed gain and a steering offset that are drawn once per run, and noise
    that is drawn anew for each command to drive, after the command has been cut to the limits."""
    start_errors: Tuple[float, float]
    """START_ERRORS, or zeros if the car has no errors."""
    distance: float
    """Distance that a car without errors drives [m]."""
    planned: np.ndarray
    """Its final pose: x [m], y [m], theta [rad] in the map frame, (3,)."""
    poses: np.ndarray
    """The final poses of the runs, likewise, (runs, 3)."""

    @property
    def distances(self) -> np.ndarray:
        """The distances of the runs from the planned position [m], (runs,)."""
        return np.hypot(*(self.poses - self.planned)[:, :2].T)


def spread(plan: Plan, car: Car, runs: int, seed: int) -> Spread:
    """Drive a plan at least two times, each run with its own errors.

    If the car has errors, START_ERRORS are added; otherwise there are none.
    """
    quiet = car._replace(
        speed_gain_spread=0.0, steering_offset_spread=0.0, speed_noise=0.0, steering_noise=0.0
    )
    (planned,) = sample(plan, quiet, 1, seed)
    start_errors = (0.0, 0.0) if car == quiet else START_ERRORS
    poses = sample(plan, car, runs, seed, start_errors)[:, :3]
    return Spread(seed, car, start_errors, float(planned[3]), planned[:3], poses)


def sample(
    plan: Plan, car: Car, runs: int, seed: int, start_errors: Tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """Drive a plan `runs` times with random errors; see `Spread`.

    Returns:
        The final x [m], y [m], theta [rad] in the map frame, the distance driven [m], (runs, 4).
    """
    normal = np.random.default_rng(seed).standard_normal
    scale = 1.0 + car.speed_gain_spread / car.speed_gain * normal(runs)
    offset = car.steering_offset_spread * normal(runs)
    deviations = (start_errors[0], *start_errors)
    pose = [start + error * normal(runs) for start, error in zip(plan.start, deviations)]
    state = np.array([*pose, *np.zeros((3, runs))])
    for row, seconds in _commands(plan):
        speed, angle = car.response(row.speed, row.steering_angle)
        speeds, angles = speed * scale, angle + offset
        if speed and car.has_command_noise:
            speeds += car.speed_noise * normal(runs)
            angles += car.steering_noise * normal(runs)
        state = _advanced(state, car, speeds, angles, seconds)
    straight = car.response(0.0, 0.0)[1] + offset
    while state[4].any():
        state = _advanced(state, car, 0.0 * scale, straight, COMMAND_PERIOD / NANOSECONDS)
    return state[:4].T


def _commands(plan: Plan) -> Iterator[Tuple[Row, float]]:
    """Yield the row of each command, and its duration [s]."""
    for row in plan.rows:
        for begin in range(0, row.duration, COMMAND_PERIOD):
            yield row, min(COMMAND_PERIOD, row.duration - begin) / NANOSECONDS


def _advanced(
    state: np.ndarray, car: Car, speeds: np.ndarray, angles: np.ndarray, seconds: float
) -> np.ndarray:
    """Return the state of many cars after one command.

    A command is one or more arcs, each with its mean speed and steering angle. This is exact for a
    car without ramps. For others the error is 1 or 2 mm along the plans of this package.

    Args:
        state: x [m], y [m], theta [rad], distance driven [m], speed [m/s] and steering angle
            [rad], (6, cars).
        car: its acceleration, steering rate and wheelbase.
        speeds: the commanded speeds [m/s], (cars,).
        angles: the commanded steering angles [rad], (cars,).
        seconds: duration of the command [s].
    """
    x, y, theta, driven, speed, angle = state
    ramps = abs(speeds - speed) / car.acceleration, abs(angles - angle) / car.steering_rate
    steps = _STEPS if np.max(ramps) > 0.5 * seconds else 1
    dt = seconds / steps
    for _ in range(steps):
        mean_speed, speed = ramped(speed, speeds, car.acceleration * dt)
        mean_angle, angle = ramped(angle, angles, car.steering_rate * dt)
        distance = mean_speed * dt
        chord, turn = arcs(distance, mean_angle, car.wheelbase)
        x = x + chord * np.cos(theta + 0.5 * turn)
        y = y + chord * np.sin(theta + 0.5 * turn)
        theta = theta + turn
        driven = driven + np.abs(distance)
    return np.array([x, y, theta, driven, speed, angle])
