"""Compare a predicted motion with measured poses, from each pose to the next one.

The random errors of a car add up: after 20 m, it is decimetres away from any prediction, although
each metre fits well. So a fit to the whole path would take this for wrong parameters, with much too
small standard errors. Instead, the fit compares the steps from pose to pose. The error of a
measured pose is in two steps, with opposite signs; the Cholesky factor of the covariance of all
steps makes their errors independent. It is a band matrix, so this needs a time that grows with
their number.

The errors are those in the frame of the car. Then their covariance depends on the motion only, and
not on the pose (Barrau and Bonnabel, "The invariant extended Kalman filter as a stable observer").
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

_PERIOD = COMMAND_PERIOD / NANOSECONDS

_MIN_POSITION, _MIN_HEADING = 0.003, 0.003
"""Smallest standard deviations of a measured pose [m, rad]: below are errors of the model."""

_SLIP = 0.01
"""Standard deviation of a motion to the side after 1 m [m]; it grows with the square root."""

_SPEED_NOISE, _STEERING_NOISE = 0.02, 0.01
"""Of a car without noise in its profile [m/s, rad]."""

_BAND = 5
"""Entries of the Cholesky factor below its diagonal: two neighbouring steps of 3 numbers."""


class Noise(NamedTuple):
    """Standard deviations of random errors: of the measurement, and of the car, as in `Car`."""

    position: float
    """Of x and of y of a measured pose [m]."""
    heading: float
    """Of theta of a measured pose [rad]."""
    speed_noise: float
    """Of the speed, drawn anew for each COMMAND_PERIOD [m/s]."""
    steering_noise: float
    """Of the steering angle, likewise [rad]."""


class Steps(NamedTuple):
    """The motion of a car from each pose to the next one, in the frame of the car."""

    moves: np.ndarray
    """x [m] + i y [m], (..., N - 1)."""
    turns: np.ndarray
    """[rad], (..., N - 1)."""


def noise_of(poses: np.ndarray, car: Car) -> Noise:
    """Return the random errors of measured poses, (N, 3), and of a car.

    Those of the poses follow from the third differences, in which a smooth motion is small: they
    are sums of four errors, the squares of whose factors sum up to 20. The median ignores jumps.
    Poses that are repeated, as some localisations do while the car stands, do not count.
    """
    poses = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    poses = poses[np.append(True, np.diff(poses, axis=0).any(axis=1))]
    sizes = np.zeros(3)
    if len(poses) > 3:
        sizes = np.median(np.abs(np.diff(poses, 3, axis=0)), axis=0) / (0.6745 * np.sqrt(20.0))
    return Noise(
        float(np.sqrt(0.5 * np.sum(sizes[:2] ** 2))),
        float(sizes[2]),
        car.speed_noise or _SPEED_NOISE,
        car.steering_noise or _STEERING_NOISE,
    )


def steps_of(poses: np.ndarray) -> Steps:
    """Return the steps of poses; x [m], y [m], theta [rad], (..., N, 3)."""
    x, y, theta = np.moveaxis(poses, -1, 0)
    moves = np.diff(x + 1j * y, axis=-1) * np.exp(-1j * theta[..., :-1])
    return Steps(moves, np.diff(theta, axis=-1))


def step_errors(steps: Steps, measured: Steps) -> np.ndarray:
    """Return measured minus predicted steps, in the frame after the step: (..., N - 1, 3)."""
    moves = (measured.moves - steps.moves) * np.exp(-1j * steps.turns)
    turns = np.angle(np.exp(1j * (measured.turns - steps.turns)))
    return np.stack([moves.real, moves.imag, turns], axis=-1)


class Whitening:
    """Makes the errors of steps independent, with the variance 1.

    Args:
        steps: of one car, (N - 1,).
        seconds: duration of each step [s], (N - 1,).
        wheelbase: of the car [m].
        noise: of the measurement and of the car.
    """

    def __init__(self, steps: Steps, seconds: np.ndarray, wheelbase: float, noise: Noise) -> None:
        position, heading = max(noise.position, _MIN_POSITION), max(noise.heading, _MIN_HEADING)
        measured = np.diag([position, position, heading]) ** 2
        carried = _transitions(steps) @ measured
        blocks = carried @ np.swapaxes(_transitions(steps), 1, 2) + measured
        blocks += _changes(steps, seconds, wheelbase, noise)
        count = len(blocks)
        band = np.zeros((_BAND + 1, 3 * count))
        for row in range(3):
            for column in range(3):
                if row >= column:
                    band[row - column, column::3] = blocks[:, row, column]
                band[3 + row - column, column : 3 * count - 3 : 3] = -carried[1:, row, column]
        self._factor = cholesky_banded(band, lower=True)

    def __call__(self, errors: np.ndarray) -> np.ndarray:
        """Return independent errors, (cars, 3 (N - 1)), of `step_errors`, (cars, N - 1, 3)."""
        columns = errors.reshape(len(errors), -1).T
        return solve_banded((_BAND, 0), self._factor, columns).T


def _transitions(steps: Steps) -> np.ndarray:
    """Return how an error at the start of each step becomes one at its end, (N - 1, 3, 3)."""
    cos, sin = np.cos(steps.turns), np.sin(steps.turns)
    x, y = steps.moves.real, steps.moves.imag
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = (
        (cos, sin, sin * x - cos * y),
        (-sin, cos, cos * x + sin * y),
        (zero, zero, one),
    )
    return np.moveaxis(np.array(rows), -1, 0)


def _changes(steps: Steps, seconds: np.ndarray, wheelbase: float, noise: Noise) -> np.ndarray:
    """Return the covariance of the random errors of the car in each step, (N - 1, 3, 3)."""
    distances = np.copysign(np.abs(steps.moves), steps.moves.real)
    is_moving = np.abs(distances) > 1e-6
    bends = np.divide(steps.turns, distances, out=np.zeros_like(distances), where=is_moving)
    tangents = bends * wheelbase
    root = np.sqrt(_PERIOD * seconds) * is_moving
    zero = np.zeros_like(root)
    half = 0.5 * distances
    by_speed = noise.speed_noise * root * np.array([zero + 1.0, bends * half, bends])
    turned = noise.steering_noise * root * distances / seconds * (1.0 + tangents**2) / wheelbase
    # The integral of white noise, and the integral over it: an error of the heading grows within
    # the step, and moves the car sideways.
    by_angle = turned * np.array([zero, half, zero + 1.0])
    sideways = turned * np.array([zero, half / np.sqrt(3.0), zero])
    slip = _SLIP * np.sqrt(np.abs(distances)) * np.array([zero, zero + 1.0, zero])
    parts = (by_speed, by_angle, sideways, slip)
    return sum(np.einsum("in,jn->nij", each, each) for each in parts)
