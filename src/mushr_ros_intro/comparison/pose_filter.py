"""Compare a predicted motion with measured poses: the prediction errors from pose to pose.

The random errors of a car add up: after 20 m, it is decimetres away from any prediction, although
each metre fits well. So a fit to the whole path would take this for wrong parameters, with much too
small standard errors. Instead, each pose is predicted from the poses before it, by a Kalman filter
with the errors of the measurement and of the car. Its prediction errors (innovations), divided by
their standard deviations, are independent (Ljung, "System Identification", section 4.3).

The errors are those in the frame of the car. Then their covariance depends on the motion only, and
not on the pose (Barrau and Bonnabel, "The invariant extended Kalman filter as a stable observer").
"""

from typing import List, NamedTuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

_PERIOD = COMMAND_PERIOD / NANOSECONDS


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
    speed_gain_spread: float
    """Of the speed gain, between drives."""
    steering_offset_spread: float
    """Of the steering offset, between drives [rad]."""


NOISE_FACTORS = (5.0, 5.0, 2.0, 2.0, 2.0, 2.0)
"""The estimated noise differs from the usual noise by about this factor, if the drive says little.

A drive of half a minute says little about the noise of the car, and the error of the fit depends on
it.
"""

MIN_NOISE = Noise(1e-4, 1e-4, 1e-5, 1e-5, 1e-5, 1e-5)
"""Smaller noise is not estimated: times are rounded to nanoseconds, and numbers to float32."""

MAX_NOISE = Noise(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


class Steps(NamedTuple):
    """The motion of a car from each pose to the next one, in the frame of the car."""

    moves: np.ndarray
    """x [m] + i y [m], (..., N - 1)."""
    turns: np.ndarray
    """[rad], (..., N - 1)."""


class Weights(NamedTuple):
    """The gains of the filter, and what makes its prediction errors independent."""

    gains: np.ndarray
    """(N - 1, 3, 3)."""
    whitening: np.ndarray
    """(N - 1, 3, 3)."""
    log_determinant: float
    """Of the covariance of all prediction errors."""


def usual_noise(car: Car) -> Noise:
    """Return the noise before it is estimated: that of the car's profile, if it is there."""
    return Noise(
        position=0.02,
        heading=0.02,
        speed_noise=car.speed_noise or 0.02,
        steering_noise=car.steering_noise or 0.01,
        speed_gain_spread=car.speed_gain_spread or 0.02,
        steering_offset_spread=car.steering_offset_spread or 0.01,
    )


def steps_of(poses: np.ndarray) -> Steps:
    """Return the steps of poses; x [m], y [m], theta [rad], (..., N, 3)."""
    x, y, theta = np.moveaxis(poses, -1, 0)
    moves = np.diff(x + 1j * y, axis=-1) * np.exp(-1j * theta[..., :-1])
    return Steps(moves, np.diff(theta, axis=-1))


def weights_of(steps: Steps, seconds: np.ndarray, wheelbase: float, noise: Noise) -> Weights:
    """Return the weights of a motion.

    Args:
        steps: of one car, (N - 1,).
        seconds: duration of each step [s], (N - 1,).
        wheelbase: of the car [m].
        noise: of the measurement and of the car.
    """
    measured = np.diag([noise.position, noise.position, noise.heading]) ** 2
    changes = _changes(steps, seconds, wheelbase, noise)
    covariance = measured.copy()  # of the first pose
    gains: List[np.ndarray] = []
    sums = []
    for transition, change in zip(_transitions(steps), changes):
        covariance = transition @ covariance @ transition.T + change
        total = covariance + measured
        gains.append(covariance @ np.linalg.inv(total))
        covariance = covariance - gains[-1] @ covariance
        sums.append(total)
    factors = np.linalg.cholesky(np.array(sums))
    diagonals = np.diagonal(factors, axis1=1, axis2=2)
    return Weights(np.array(gains), np.linalg.inv(factors), float(2.0 * np.sum(np.log(diagonals))))


def _transitions(steps: Steps) -> np.ndarray:
    """Return how an error at the begin of each step becomes one at its end, (N - 1, 3, 3)."""
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
    return sum(np.einsum("in,jn->nij", each, each) for each in (by_speed, by_angle, sideways))


def prediction_errors(steps: Steps, poses: np.ndarray, weights: Weights) -> np.ndarray:
    """Return the prediction errors of several cars, divided by their standard deviations.

    Args:
        steps: of the cars, (cars, N - 1).
        poses: the measured poses, (N, 3).
        weights: of the motion.

    Returns:
        (cars, N - 1, 3).
    """
    measured = poses[:, 0] + 1j * poses[:, 1]
    headings = np.exp(1j * poses[:, 2])
    moves, turns = steps.moves.T.copy(), np.exp(1j * steps.turns.T)
    place = np.full(moves.shape[1], measured[0])
    heading = np.full(moves.shape[1], headings[0])
    errors = np.empty((len(moves), 3, moves.shape[1]))
    for k, (move, turn) in enumerate(zip(moves, turns)):
        place = place + heading * move
        heading = heading * turn
        apart = (measured[k + 1] - place) / heading
        errors[k] = apart.real, apart.imag, np.angle(headings[k + 1] / heading)
        along, across, angle = weights.gains[k] @ errors[k]
        place = place + heading * (along + 1j * across)
        heading = heading * np.exp(1j * angle)
        heading /= np.abs(heading)
    return np.moveaxis(weights.whitening @ errors, -1, 0)


def deviance(errors: np.ndarray, weights: Weights) -> float:
    """Return minus twice the logarithm of the likelihood of the prediction errors of one car."""
    return float(np.sum(errors**2)) + weights.log_determinant
