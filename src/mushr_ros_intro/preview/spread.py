"""Drive a plan many times, each run with its own random errors: the spread of a plan.

The cars are driven side by side, as numpy arrays. They get the commands of path_publisher.
"""

import math
from typing import Iterable, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.preview.side_by_side import arcs, ramped
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

MAX_CAR_COMMANDS = 2_000_000_000
"""Limit of the commands of a plan times the runs; they take about five minutes."""

CLOUD = 5000
"""Number of runs whose final poses are kept."""

_MARKS = 10
"""The number of instants along the plan at which the spread is computed."""

_STEPS = 3
"""Number of arcs that approximate a command with a long ramp; any other command is one arc."""


class Errors(NamedTuple):
    """Standard deviations of the normally distributed errors of a car.

    The first four are drawn once per run. The last two are drawn anew for each command to
    drive, and are added after the command has been cut to the limits of the car.
    """

    speed_scale: float = 0.0
    """Of the speed, as a fraction of it."""
    steering_offset: float = 0.0
    """Of the steering angle [rad]."""
    start_position: float = 0.0
    """Of x and of y of the start pose [m]."""
    start_heading: float = 0.0
    """Of theta of the start pose [rad]."""
    speed: float = 0.0
    """Of the speed, of each command [m/s]."""
    steering_angle: float = 0.0
    """Of the steering angle, of each command [rad]."""


START_ERRORS = Errors(start_position=0.02, start_heading=0.02)
"""Errors of a car that is placed by eye, our choice: the width of a thumb, and a degree."""


class Spread(NamedTuple):
    """The poses of many runs of a plan, at some instants along the plan and at its end."""

    runs: int
    seed: int
    errors: Errors
    seconds: np.ndarray
    """The instants [s], (instants,). The last one is the end of the plan, and stands for the
    moment at which a car has come to rest."""
    distances: np.ndarray
    """Distance that a car without errors has driven by then [m], (instants,)."""
    planned: np.ndarray
    """Its x [m], y [m] and theta [rad] in the map frame, (instants, 3)."""
    mean: np.ndarray
    """Mean of the runs, likewise."""
    covariance: np.ndarray
    """Covariance of the runs, (instants, 3, 3)."""
    cloud: np.ndarray
    """The final poses of the first CLOUD runs, (cars, 3)."""

    @property
    def rms_errors(self) -> np.ndarray:
        """Root mean square distance of the runs from the planned position [m], (instants,)."""
        offset = self.mean[:, :2] - self.planned[:, :2]
        variance = np.trace(self.covariance[:, :2, :2], axis1=1, axis2=2)
        return np.sqrt((offset**2).sum(axis=1) + variance)

    @property
    def ellipses(self) -> List[Tuple[float, float, float]]:
        """The 95 % ellipse at each instant; see `ellipse`."""
        return [ellipse(each) for each in self.covariance]

    @property
    def growth(self) -> Optional[float]:
        """The power of the distance with which the error grows, by least squares.

        None if there are no errors, or if the car does not move.
        """
        errors = self.rms_errors
        is_known = (self.distances > 0.0) & (errors > 1e-9)
        if np.count_nonzero(is_known) < 3 or np.ptp(self.distances[is_known]) == 0.0:
            return None
        logs = np.log(self.distances[is_known]), np.log(errors[is_known])
        return float(np.polyfit(*logs, 1)[0])


def spread(plan: Plan, car: Car, runs: int, seed: int) -> Spread:
    """Drive a plan at least two times, each run with its own errors.

    If the car has noise, the errors of a run are those of the car and START_ERRORS; otherwise it
    has none.

    Raises:
        UserError: the runs would take hours.
    """
    count = count_commands(plan) * runs
    if count > MAX_CAR_COMMANDS:
        raise UserError(
            f"{runs} runs of {plan.path} are {count} commands to be driven; "
            f"expected {MAX_CAR_COMMANDS} at most, so fewer --runs"
        )
    errors = Errors()
    if car.has_command_noise:
        errors = START_ERRORS._replace(
            speed_scale=car.speed_gain_spread / car.speed_gain,
            steering_offset=car.steering_offset_spread,
            speed=car.speed_noise,
            steering_angle=car.steering_noise,
        )
    ends = [end for _, _, end in _commands(plan)]
    every = -(-len(ends) // _MARKS)
    instants = [*ends[every - 1 : -1 : every], ends[-1]]
    planned = sample(plan, car, Errors(), 1, seed, instants)[:, 0]
    poses = sample(plan, car, errors, runs, seed, instants)[..., :3]
    return Spread(
        runs,
        seed,
        errors,
        seconds=np.array(instants) / NANOSECONDS,
        distances=planned[:, 3],
        planned=planned[:, :3],
        mean=poses.mean(axis=1),
        covariance=np.array([np.cov(each.T) for each in poses]),
        cloud=poses[-1, :CLOUD],
    )


def ellipse(covariance: np.ndarray) -> Tuple[float, float, float]:
    """Return the ellipse around the mean that contains 95 % of normally distributed points.

    Args:
        covariance: of x and y [m^2], (2, 2), or of a pose, (3, 3).

    Returns:
        The semi-major and the semi-minor axis [m], and the direction of the major axis [rad].
    """
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    middle, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    scale = -2.0 * math.log(0.05)  # chi-square with two degrees of freedom
    major, minor = (math.sqrt(scale * max(each, 0.0)) for each in (middle + half, middle - half))
    return major, minor, 0.5 * math.atan2(2.0 * xy, xx - yy)


def sample(
    plan: Plan, car: Car, errors: Errors, runs: int, seed: int, instants: Iterable[int]
) -> np.ndarray:
    """Drive a plan `runs` times with random errors; the noise of `car` is not used.

    The `instants` are ends of commands [ns after the first begins]; the last one is the plan's end.

    Returns:
        x [m], y [m], theta [rad] in the map frame and the distance driven [m], (instants, runs, 4).
        The last ones are those at which the cars come to rest.
    """
    normal = np.random.default_rng(seed).standard_normal
    scale = 1.0 + errors.speed_scale * normal(runs)
    offset = errors.steering_offset * normal(runs)
    deviations = (errors.start_position, errors.start_position, errors.start_heading)
    pose = [start + error * normal(runs) for start, error in zip(plan.start, deviations)]
    state = np.array([*pose, *np.zeros((3, runs))])
    marks = set(instants) - {plan.duration}
    results = []
    for row, seconds, end in _commands(plan):
        speed, angle = car.response(row.speed, row.steering_angle)
        speeds, angles = speed * scale, angle + offset
        if speed and (errors.speed or errors.steering_angle):
            speeds += errors.speed * normal(runs)
            angles += errors.steering_angle * normal(runs)
        state = _advanced(state, car, speeds, angles, seconds)
        if end in marks:
            results.append(state[:4].T)
    straight = car.response(0.0, 0.0)[1] + offset
    while state[4].any():
        state = _advanced(state, car, 0.0 * scale, straight, COMMAND_PERIOD / NANOSECONDS)
    return np.array([*results, state[:4].T])


def _commands(plan: Plan) -> Iterator[Tuple[Row, float, int]]:
    """Yield the row of each command, its duration [s], and its end [ns after the first begins]."""
    now = 0
    for row in plan.rows:
        for begin in range(0, row.duration, COMMAND_PERIOD):
            end = min(begin + COMMAND_PERIOD, row.duration)
            yield row, (end - begin) / NANOSECONDS, now + end
        now += row.duration


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
