"""Compare a predicted motion with measured poses: the prediction errors from pose to pose.

The random errors of a car add up: after 20 m, it is decimetres away from any prediction, although
each metre fits well. So a fit to the whole path would take this for wrong parameters, with much too
small standard errors. Instead, each pose is predicted from the poses before it, by a Kalman filter
with the errors of the measurement and of the car. Its prediction errors (innovations), divided by
their standard deviations, are independent (Ljung, "System Identification", section 4.3).

The errors are those in the frame of the car. Then their covariance depends on the motion only, and
not on the pose (Barrau and Bonnabel, "The invariant extended Kalman filter as a stable observer").
"""

from typing import List, NamedTuple, Sequence

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
    slip: float
    """Of a motion to the side, after 1 m; it grows with the square root of the distance [m]."""
    speed_noise: float
    """Of the speed, drawn anew for each COMMAND_PERIOD [m/s]."""
    steering_noise: float
    """Of the steering angle, likewise [rad]."""
    speed_gain_spread: float
    """Of the speed gain, between drives."""
    steering_offset_spread: float
    """Of the steering offset, between drives [rad]."""


NOISE_FACTORS = (5.0, 5.0, 5.0, 2.0, 2.0, 2.0, 2.0)
"""The usual noise is known to this factor: a log-normal prior, one standard deviation.

A drive of half a minute hardly determines the noise of the car, and the error of the fit depends on
it.
"""

MIN_NOISE = Noise(1e-4, 1e-4, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5)
"""Smaller noise is not estimated: times are rounded to nanoseconds, and numbers to float32."""

MAX_NOISE = Noise(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


_ANY_MOTION = 10.0
"""Standard deviation of a step in which the car may have moved in any way [m, rad]."""


class Steps(NamedTuple):
    """The motion of a car from each pose to the next one, in the frame of the car."""

    moves: np.ndarray
    """x [m] + i y [m], (..., N - 1)."""
    turns: np.ndarray
    """[rad], (..., N - 1)."""


class Weights(NamedTuple):
    """The gains of filters, one for each noise, and what makes their errors independent."""

    gains: np.ndarray
    """(N - 1, filters, 3, 3)."""
    whitening: np.ndarray
    """(N - 1, filters, 3, 3)."""
    log_determinants: np.ndarray
    """Of the covariance of all prediction errors, (filters,)."""


def usual_noise(car: Car) -> Noise:
    """Return the noise before it is estimated: that of the car's profile, if it is there."""
    return Noise(
        position=0.02,
        heading=0.02,
        slip=0.002,
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


def weights_of(
    steps: Steps,
    seconds: np.ndarray,
    is_unknown: np.ndarray,
    wheelbase: float,
    noises: Sequence[Noise],
) -> Weights:
    """Return the weights of a motion, for each noise.

    Args:
        steps: of one car, (N - 1,).
        seconds: duration of each step [s], (N - 1,).
        is_unknown: whether the car may have moved in any way in each step, (N - 1,).
        wheelbase: of the car [m].
        noises: of the measurement and of the car.
    """
    deviations = [(noise.position, noise.position, noise.heading) for noise in noises]
    measured = np.array([np.diag(each) ** 2 for each in deviations])
    changes = np.array([_changes(steps, seconds, wheelbase, noise) for noise in noises])
    changes[:, is_unknown] += _ANY_MOTION**2 * np.eye(3)
    covariance = measured.copy()  # of the first pose
    gains: List[np.ndarray] = []
    sums = []
    for transition, change in zip(_transitions(steps), changes.swapaxes(0, 1)):
        covariance = transition @ covariance @ transition.T + change
        total = covariance + measured
        gains.append(covariance @ np.linalg.inv(total))
        covariance = covariance - gains[-1] @ covariance
        sums.append(total)
    factors = np.linalg.cholesky(np.array(sums))
    diagonals = np.diagonal(factors, axis1=2, axis2=3)
    determinants = 2.0 * np.log(diagonals).sum(axis=(0, 2))
    return Weights(np.array(gains), np.linalg.inv(factors), determinants)


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
    slip = noise.slip * np.sqrt(np.abs(distances)) * np.array([zero, zero + 1.0, zero])
    parts = (by_speed, by_angle, sideways, slip)
    return sum(np.einsum("in,jn->nij", each, each) for each in parts)


def prediction_errors(steps: Steps, poses: np.ndarray, weights: Weights) -> np.ndarray:
    """Return the prediction errors of several cars, divided by their standard deviations.

    Args:
        steps: of the cars, (cars, N - 1).
        poses: the measured poses, (N, 3).
        weights: of the motion.

    Returns:
        (filters, cars, N - 1, 3).
    """
    measured = poses[:, 0] + 1j * poses[:, 1]
    headings = np.exp(1j * poses[:, 2])
    moves, turns = steps.moves.T.copy(), np.exp(1j * steps.turns.T)
    filters, cars = weights.gains.shape[1], moves.shape[1]
    place = np.full((filters, cars), measured[0])
    heading = np.full((filters, cars), headings[0])
    errors = np.empty((len(moves), filters, 3, cars))
    for k, (move, turn) in enumerate(zip(moves, turns)):
        place = place + heading * move
        heading = heading * turn
        apart = (measured[k + 1] - place) / heading
        errors[k, :, 0] = apart.real
        errors[k, :, 1] = apart.imag
        errors[k, :, 2] = np.angle(headings[k + 1] / heading)
        along, across, angle = (weights.gains[k] @ errors[k]).swapaxes(0, 1)
        place = place + heading * (along + 1j * across)
        heading = heading * np.exp(1j * angle)
        heading /= np.abs(heading)
    return (weights.whitening @ errors).transpose(1, 3, 0, 2)


def glitch_sizes(errors: np.ndarray, steps: Steps, weights: Weights) -> np.ndarray:
    """Return how much better a motion fits if the car may have moved in any way in one step.

    A step that moves the car wrongly shows in all later prediction errors. So this is the score
    test for an additional motion in each step, over all later errors (de Jong and Penzer,
    "Diagnosing shocks in time series", 1998).

    Args:
        errors: the prediction errors of one car, (N - 1, 3).
        steps: of the car.
        weights: of one filter.

    Returns:
        (N - 1,); each follows the chi-square distribution with 3 degrees of freedom, if only the
        random errors of the filter move the car.
    """
    transitions = _transitions(Steps(steps.moves.reshape(-1), steps.turns.reshape(-1)))
    score, information = np.zeros(3), np.zeros((3, 3))
    kept = np.eye(3) - weights.gains[:, 0]
    later = np.concatenate([transitions[1:] @ kept[:-1], np.zeros((1, 3, 3))])
    sizes = np.empty(len(errors))
    for k in reversed(range(len(errors))):
        whitening = weights.whitening[k, 0]
        score = whitening.T @ errors[k] + later[k].T @ score
        information = whitening.T @ whitening + later[k].T @ information @ later[k]
        sizes[k] = score @ np.linalg.solve(information, score)
    return sizes
