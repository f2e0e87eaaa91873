"""Drive a plan many times, each run with its own random errors: the spread of a plan.

The cars are driven side by side, as numpy arrays. They get the commands of path_publisher, one per
COMMAND_PERIOD; the last one of a row lasts until the end of the row.
"""

import math
from typing import Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.motion import advance
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.preview.prediction import count_commands, drive
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS

CLOUD = 5000
"""The final poses of so many runs are kept."""

_MARKS = 10  # instants along the plan at which the spread is computed
_WIDTH = 4096  # cars that are driven at a time: their arrays fit into a processor's cache
_INSTANT = 1e-15  # ramps shorter than this [s] are left out
_AT_ONCE = 1e200  # a rate as good as infinite, but zero when multiplied by zero


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


RUN_ERRORS = Errors(speed_scale=0.02, steering_offset=0.01, start_position=0.02, start_heading=0.02)
"""Errors of a real car that last for a whole run. They are our choice; no figures were found.

Tyres and battery change the speed by a few per cent, the trim of a servo is off by about half a
degree, and a car placed by eye is off by the width of a thumb and by a degree.
"""


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
    """Drive a plan many times, each run with its own errors.

    Args:
        plan: the plan.
        car: the car. If it has noise, the errors of a run are its noise and RUN_ERRORS.
        runs: number of runs, at least 2.
        seed: of the random numbers.
    """
    errors = Errors()
    if car.speed_noise or car.steering_noise:
        errors = RUN_ERRORS._replace(speed=car.speed_noise, steering_angle=car.steering_noise)
    every = max(1, -(-count_commands(plan) // _MARKS))
    instants = marks(plan, every)
    planned, distances = _without_errors(plan, car, instants)
    # Sums over the offsets from the planned poses, which are small: nothing cancels.
    total, squares = np.zeros((len(instants), 3)), np.zeros((len(instants), 3, 3))
    cloud = np.empty((0, 3))
    for poses in sample(plan, car, errors, runs, seed, every):
        offsets = poses - planned[:, np.newaxis]
        total += offsets.sum(axis=1)
        squares += np.matmul(offsets.transpose(0, 2, 1), offsets)
        cloud = np.concatenate((cloud, poses[-1, : CLOUD - len(cloud)]))
    outer = total[:, :, np.newaxis] * total[:, np.newaxis, :]
    covariance = (squares - outer / runs) / (runs - 1)
    seconds = np.array(instants) / NANOSECONDS
    mean = planned + total / runs
    return Spread(runs, seed, errors, seconds, distances, planned, mean, covariance, cloud)


def marks(plan: Plan, every: int) -> List[int]:
    """Return when each `every`-th command ends, and the last one [ns after the first begins]."""
    ends = []
    now = 0
    for row in plan.rows:
        ends += [now + min(t + COMMAND_PERIOD, row.duration) for t in _begins(row.duration)]
        now += row.duration
    return [*ends[every - 1 : -1 : every], now]


def ellipse(covariance: np.ndarray, probability: float = 0.95) -> Tuple[float, float, float]:
    """Return the ellipse around the mean that contains a normally distributed point.

    Args:
        covariance: of x and y [m^2], (2, 2), or of a pose, (3, 3).
        probability: that the point is in the ellipse.

    Returns:
        The semi-major and the semi-minor axis [m], and the direction of the major axis [rad].
    """
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    middle, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    scale = -2.0 * math.log1p(-probability)  # chi-square with two degrees of freedom
    major, minor = (math.sqrt(scale * max(each, 0.0)) for each in (middle + half, middle - half))
    return major, minor, 0.5 * math.atan2(2.0 * xy, xx - yy)


def sample(
    plan: Plan, car: Car, errors: Errors, runs: int, seed: int, every: int
) -> Iterator[np.ndarray]:
    """Drive a plan `runs` times and yield the poses, some thousand cars at a time.

    Args:
        plan: the plan.
        car: the car.
        errors: of each run; the noise of the car is not used.
        runs: number of runs.
        seed: of the random numbers, not negative.
        every: number of commands between two instants; see `marks`.

    Yields:
        x [m], y [m] and theta [rad] in the map frame, (instants, cars, 3). The last poses are
        those at which the cars come to rest.
    """
    for first in range(0, runs, _WIDTH):
        rng = np.random.default_rng((seed, first // _WIDTH))
        yield _sample_some(plan, car, errors, min(_WIDTH, runs - first), rng, every)


def _sample_some(
    plan: Plan, car: Car, errors: Errors, count: int, rng: np.random.Generator, every: int
) -> np.ndarray:
    """Drive `count` cars; see `sample`."""
    normal = rng.standard_normal
    scale = 1.0 + errors.speed_scale * normal(count)
    offset = errors.steering_offset * normal(count)
    x, y = (start + errors.start_position * normal(count) for start in plan.start[:2])
    theta = plan.start.theta + errors.start_heading * normal(count)
    cars = _Cars(car, x, y, theta)
    is_noisy = errors.speed != 0.0 or errors.steering_angle != 0.0
    noted = []
    number, total = 0, count_commands(plan)
    for row in plan.rows:
        speed, angle = car.within_limits(row.speed, row.steering_angle)
        for begin in _begins(row.duration):
            speeds, angles = speed * scale, angle + offset
            if is_noisy and speed:
                speeds += errors.speed * normal(count)
                angles += errors.steering_angle * normal(count)
            seconds = min(COMMAND_PERIOD, row.duration - begin) / NANOSECONDS
            cars.drive(seconds, speeds, angles)
            number += 1
            if number % every == 0 and number < total:
                noted.append(cars.poses())
    cars.drive(cars.stopping_time(), 0.0 * scale, offset)
    return np.array([*noted, cars.poses()])


def _begins(duration: int) -> range:
    """Return the begin of each command of a row [ns after the begin of the row]."""
    return range(0, duration, COMMAND_PERIOD)


def _without_errors(plan: Plan, car: Car, instants: List[int]) -> Tuple[np.ndarray, np.ndarray]:
    """Return the poses (instants, 3) and the distances driven [m] of a car without errors.

    The last ones are those of the car at rest.
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    due = instants[:-1]
    poses, distances = [], []
    driven = 0.0
    for leg in drive(plan, car):
        while due and due[0] <= leg.end:
            poses.append(advance(leg.state, due[0], car).pose)
            distances.append(driven + leg.distance(due.pop(0)))
        driven += leg.distance(leg.end)
    poses.append(advance(leg.state, leg.end, car).pose)
    return np.array(poses), np.array([*distances, driven])


# The kinematics ---------------------------------------------------------------------------------


def _gauss(points: int) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes, the weights and the collocation matrix of Gauss-Legendre quadrature.

    Row k of the matrix integrates from 0 to node k. See Hairer, Norsett, Wanner, "Solving Ordinary
    Differential Equations I", section II.7.
    """
    nodes, weights = np.polynomial.legendre.leggauss(points)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.arange(points)
    integrals = nodes[:, np.newaxis] ** (powers + 1) / (powers + 1)
    return nodes, weights, integrals @ np.linalg.inv(nodes[:, np.newaxis] ** powers)


_NODES, _WEIGHTS, _TO_NODES = _gauss(3)


class _Cars:
    """Many cars of one kind, side by side; all arrays are (cars,).

    Speed and steering angle are ramps. The motion of a command has up to three parts: both change,
    only the steering angle changes, and the steering angle is constant. The last part is an arc,
    whatever the speed does. The ideal car is the limit of infinite rates: only the arc remains.
    """

    def __init__(self, car: Car, x: np.ndarray, y: np.ndarray, theta: np.ndarray):
        self._wheelbase = car.wheelbase
        self._acceleration = min(car.acceleration, _AT_ONCE)
        self._steering_rate = min(car.steering_rate, _AT_ONCE)
        self._x, self._y, self._theta = x, y, theta
        self._speed, self._angle = np.zeros_like(x), np.zeros_like(x)

    def poses(self) -> np.ndarray:
        """Return x [m], y [m] and theta [rad], (cars, 3)."""
        return np.stack((self._x, self._y, self._theta), axis=1)

    def stopping_time(self) -> float:
        """Return the time until all cars have stopped [s]."""
        return float(np.abs(self._speed).max()) / self._acceleration

    def drive(self, seconds: float, speeds: np.ndarray, angles: np.ndarray) -> None:
        """Drive for one command, towards speeds [m/s] and steering angles [rad]."""
        change, turn = self._acceleration * seconds, self._steering_rate * seconds
        speed_end = np.clip(speeds, self._speed - change, self._speed + change)
        angle_end = np.clip(angles, self._angle - turn, self._angle + turn)
        speed_ramp = np.abs(speed_end - self._speed) / self._acceleration  # [s]
        angle_ramp = np.abs(angle_end - self._angle) / self._steering_rate
        both = np.minimum(speed_ramp, angle_ramp)
        speed = self._speed + np.copysign(self._acceleration, speeds - self._speed) * both
        angle = self._angle + np.copysign(self._steering_rate, angles - self._angle) * both
        self._ramp(both, self._speed, speed, self._angle, angle)
        self._ramp(angle_ramp - both, speed_end, speed_end, angle, angle_end)
        speeding = speed_ramp - both
        constant = seconds - angle_ramp - speeding
        self._arc(0.5 * (speed + speed_end) * speeding + speed_end * constant, angle_end)
        self._speed, self._angle = speed_end, angle_end

    def _arc(self, distance: np.ndarray, angle: np.ndarray) -> None:
        """Drive distances [m] at constant steering angles [rad]; see `bicycle.drive_arc`."""
        half_turn = 0.5 / self._wheelbase * distance * np.tan(angle)
        chord = distance * np.sinc(half_turn / math.pi)
        direction = self._theta + half_turn
        self._x = self._x + chord * np.cos(direction)
        self._y = self._y + chord * np.sin(direction)
        self._theta = direction + half_turn

    def _ramp(
        self,
        seconds: np.ndarray,
        speed: np.ndarray,
        speed_end: np.ndarray,
        angle: np.ndarray,
        angle_end: np.ndarray,
    ) -> None:
        """Drive while speeds [m/s] and steering angles [rad] change linearly."""
        some = np.flatnonzero(seconds > _INSTANT)
        if not len(some):
            return
        seconds, speed, speed_end, angle, angle_end, theta = (
            each[some] for each in (seconds, speed, speed_end, angle, angle_end, self._theta)
        )
        distances = [(speed + (speed_end - speed) * node) * seconds for node in _NODES]
        turns = [
            distance * np.tan(angle + (angle_end - angle) * node) / self._wheelbase
            for distance, node in zip(distances, _NODES)
        ]
        for distance, weight, to_node in zip(distances, _WEIGHTS, _TO_NODES):
            heading = theta + sum(part * turn for part, turn in zip(to_node, turns))
            self._x[some] += weight * distance * np.cos(heading)
            self._y[some] += weight * distance * np.sin(heading)
        self._theta[some] += sum(weight * turn for weight, turn in zip(_WEIGHTS, turns))
