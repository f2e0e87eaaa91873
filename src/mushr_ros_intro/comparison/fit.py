"""Fit the parameters of a car to recorded drives.

Least squares (scipy.optimize.least_squares) on the prediction errors from pose to pose, with the
model of the simulated car. See `pose_filter` for why not on the whole path.
"""

import math
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.stats import norm

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import (
    DELAY,
    PARAMETERS,
    RATES,
    Fit,
    Misfit,
    Value,
    car_with,
    fitted_value,
)
from mushr_ros_intro.comparison.pose_filter import (
    MAX_NOISE,
    MIN_NOISE,
    NOISE_FACTORS,
    USUAL_NOISE,
    Noise,
    Steps,
    Weights,
    deviance,
    prediction_errors,
    steps_of,
    weights_of,
)
from mushr_ros_intro.preview.prediction import states_at
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

MAX_POSES = 1000
"""Of a drive with more poses, every second, third, ... one is used."""

MAX_POSES_FOR_NOISE = 250
"""Likewise, for the estimate of the noise."""

MISFIT_PROBABILITY = 1e-3
"""Probability that a drive with random errors only counts as a misfit."""

DELAYS = np.arange(-1.0, 1.55, 0.1)
"""The delays with which the fit begins [s]; the best one is used. Clocks may differ by a second."""


class _Drive:
    """One drive, and the motion of a car with other parameters in it."""

    def __init__(self, log: DriveLog, car: Car, pose_offset: float, count: int) -> None:
        every = -(-len(log.stamps) // count)
        self._plan = log.plan
        self._car = car
        self._offset = pose_offset
        self.stamps, self.poses = log.stamps[::every], log.poses[::every]
        self.seconds = np.diff(self.stamps) / NANOSECONDS
        self.ends = np.cumsum([row.duration for row in log.plan.rows])

    def steps(self, vectors: np.ndarray) -> Steps:
        """Return the steps of cars; each row has the numbers of PARAMETERS, and a delay."""
        paths = []
        for vector in vectors.tolist():
            instants = (self.stamps - from_seconds(vector[-1])).tolist()
            states = states_at(self._plan, car_with(self._car, vector[:-1]), instants)
            paths.append([state.pose for state in states])
        poses = np.array(paths)
        poses[..., 0] += self._offset * np.cos(poses[..., 2])
        poses[..., 1] += self._offset * np.sin(poses[..., 2])
        return steps_of(poses)

    def weights(self, vector: np.ndarray, noise: Noise) -> Weights:
        """Return the weights of the motion of a car."""
        moves, turns = self.steps(vector[None])
        steps = Steps(moves[0], turns[0])
        return weights_of(steps, self.seconds, self._car.wheelbase, noise)


class Problem:
    """The least-squares problem of some drives of one car."""

    def __init__(
        self, logs: Sequence[DriveLog], car: Car, pose_offset: float, max_poses: int = MAX_POSES
    ) -> None:
        self._usual = car.speed_noise, car.steering_noise
        car = car._replace(speed_noise=0.0, steering_noise=0.0)
        self._car = car
        self._drives = [_Drive(log, car, pose_offset, max_poses) for log in logs]
        self._all = (*PARAMETERS, *(DELAY for _ in logs))
        defaults = [getattr(car, each.name) for each in PARAMETERS]
        defaults[-2:] = [1.0 / rate for rate in defaults[-2:]]
        self.default = np.array([*defaults, *(0.0 for _ in logs)])
        self._weights: List[Weights] = []

    def _own(self, vectors: np.ndarray, index: int) -> np.ndarray:
        """Return the columns of `vectors` that concern a drive."""
        return vectors[:, [*range(len(PARAMETERS)), len(PARAMETERS) + index]]

    def _set_weights(self, vector: np.ndarray, noise: Noise) -> None:
        """Set the weights of the residuals."""
        self._weights = [
            drive.weights(self._own(vector[None], index)[0], noise)
            for index, drive in enumerate(self._drives)
        ]

    def _residuals(self, vectors: np.ndarray, index: int) -> np.ndarray:
        """Return the residuals of a drive, (vectors, residuals)."""
        drive = self._drives[index]
        steps = drive.steps(self._own(vectors, index))
        errors = prediction_errors(steps, drive.poses, self._weights[index])
        return errors.reshape(len(vectors), -1)

    def residuals(self, vector: np.ndarray) -> np.ndarray:
        """Return the residuals of all drives."""
        parts = [self._residuals(vector[None], index)[0] for index in range(len(self._drives))]
        return np.concatenate(parts)

    def jacobian(self, vector: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """Return the derivatives of the residuals by the free parameters."""
        above, below, widths = self._neighbours(vector, free)
        parts = []
        for index in range(len(self._drives)):
            own = [row for row, column in enumerate(free) if column in self._columns(index)]
            both = self._residuals(np.concatenate([above[own], below[own]]), index)
            part = np.zeros((both.shape[1], len(free)))
            part[:, own] = ((both[: len(own)] - both[len(own) :]) / widths[own, None]).T
            parts.append(part)
        return np.concatenate(parts)

    def _neighbours(
        self, vector: np.ndarray, free: Sequence[int]
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return vectors with one free parameter larger, or smaller, and their differences."""
        above, below = (np.repeat(vector[None], len(free), axis=0) for _ in range(2))
        for row, column in enumerate(free):
            each = self._all[column]
            above[row, column] += each.step
            below[row, column] = max(each.low, below[row, column] - each.step)
        return above, below, (above - below)[range(len(free)), free]

    def _weak(self, free: Sequence[int]) -> np.ndarray:
        """Return the information that there is without a drive; it keeps matrices regular."""
        return np.diag([1.0 / (1e3 * self._all[each].enough) ** 2 for each in free])

    def _columns(self, index: int) -> Tuple[int, ...]:
        """Return the parameters that concern a drive."""
        return (*range(len(PARAMETERS)), len(PARAMETERS) + index)

    def find_delays(self, vector: np.ndarray, noise: Noise) -> np.ndarray:
        """Return `vector` with the best delay of each drive among DELAYS."""
        vector = vector.copy()
        for index in range(len(self._drives)):
            tried = np.repeat(vector[None], len(DELAYS), axis=0)
            tried[:, len(PARAMETERS) + index] = DELAYS
            self._set_weights(vector, noise)
            costs = np.sum(self._residuals(tried, index) ** 2, axis=1)
            vector[len(PARAMETERS) + index] = DELAYS[int(np.argmin(costs))]
        return vector

    def solve(self, vector: np.ndarray, free: Sequence[int], noise: Noise) -> np.ndarray:
        """Return the free parameters that fit best, from `vector` on."""
        self._set_weights(vector, noise)

        def full(part: np.ndarray) -> np.ndarray:
            whole = vector.copy()
            whole[list(free)] = part
            return whole

        result = least_squares(
            lambda part: self.residuals(full(part)),
            vector[list(free)],
            lambda part: self.jacobian(full(part), free),
            bounds=(
                [self._all[each].low for each in free],
                [self._all[each].high for each in free],
            ),
            x_scale=[self._all[each].enough for each in free],
            xtol=1e-6,
            ftol=1e-6,
            max_nfev=30,
        )
        return full(result.x)

    def find_noise(self, vector: np.ndarray, free: Sequence[int], noise: Noise) -> Noise:
        """Return the noise with the largest restricted likelihood.

        The likelihood alone would give too small a noise, because the fit has adapted the free
        parameters to it.
        """
        count = len(free)
        above, below, changes = self._neighbours(vector, free)
        vectors = np.concatenate([vector[None], above, below])
        steps = [drive.steps(self._own(vectors, index)) for index, drive in enumerate(self._drives)]

        def cost(logarithms: np.ndarray) -> float:
            tried = Noise(*np.exp(logarithms).tolist())
            total = float(np.sum(((logarithms - np.log(usual)) / widths) ** 2))
            information = self._weak(free)
            for drive, (moves, turns) in zip(self._drives, steps):
                one = Steps(moves[0], turns[0])
                weights = weights_of(one, drive.seconds, self._car.wheelbase, tried)
                errors = prediction_errors(Steps(moves, turns), drive.poses, weights)
                total += deviance(errors[0], weights)
                effects = (errors[1 : count + 1] - errors[count + 1 :]).reshape(count, -1)
                effects /= changes[:, None]
                information += effects @ effects.T
            return total + float(np.linalg.slogdet(information)[1])

        usual = USUAL_NOISE._replace(
            speed=self._usual[0] or USUAL_NOISE.speed,
            steering_angle=self._usual[1] or USUAL_NOISE.steering_angle,
        )
        widths = np.log(NOISE_FACTORS)
        bounds = [(math.log(low), math.log(high)) for low, high in zip(MIN_NOISE, MAX_NOISE)]
        result = minimize(
            cost,
            np.log(noise),
            method="L-BFGS-B",
            bounds=bounds,
            options={"eps": 1e-3, "ftol": 1e-7, "maxiter": 30},
        )
        return Noise(*np.exp(result.x).tolist())

    def covariance(self, vector: np.ndarray, free: Sequence[int], noise: Noise) -> np.ndarray:
        """Return the covariance of the free parameters; one with no effect has a huge variance."""
        self._set_weights(vector, noise)
        jacobian = self.jacobian(vector, free)
        return np.linalg.inv(jacobian.T @ jacobian + self._weak(free))

    def errors(
        self, vector: np.ndarray, free: List[int], fixed: List[int], noise: Noise
    ) -> np.ndarray:
        """Return the standard errors of the free parameters.

        The values of the fixed parameters may be wrong, too: by as much as is `enough` for each.
        """
        inverse = self.covariance(vector, free, noise)
        jacobian = self.jacobian(vector, [*free, *fixed])
        effect = inverse @ jacobian[:, : len(free)].T @ jacobian[:, len(free) :]
        effect *= [self._all[each].enough for each in fixed]
        return np.sqrt(np.diag(inverse) + np.sum(effect**2, axis=1))

    def misfit(self, vector: np.ndarray, index: int, noise: Noise) -> Misfit:
        """Return where a drive differs most from the fitted car.

        The prediction errors of a row have the mean 0 and the variance 1, if the model is right.
        """
        self._set_weights(vector, noise)
        errors = self._residuals(vector[None], index)[0].reshape(-1, 3)
        drive = self._drives[index]
        delay = vector[len(PARAMETERS) + index]
        stamps = drive.stamps[1:] - from_seconds(delay)
        rows = np.searchsorted(drive.ends, stamps, side="right")
        rows[stamps < 0] = len(drive.ends)
        sizes = [
            np.abs(errors[rows == row].sum(axis=0)) / math.sqrt(max(1, np.sum(rows == row)))
            for row in range(len(drive.ends))
        ]
        row, column = divmod(int(np.argmax(sizes)), 3)
        limit = float(norm.isf(0.5 * MISFIT_PROBABILITY / (3 * len(sizes))))
        what = ("distance", "sideways", "turn")[column]
        return Misfit(row, what, float(np.max(sizes)), limit)

    def known(
        self, vector: np.ndarray, free: List[int], noise: Noise
    ) -> Tuple[List[int], Dict[int, List[int]]]:
        """Return the free parameters that the drives determine.

        The one with the largest standard error is dropped, until all are small enough. Also return,
        for each dropped parameter, those whose values it would have changed.
        """
        dropped: Dict[int, List[int]] = {}
        while free:
            covariance = self.covariance(vector, free, noise)
            errors = np.sqrt(np.diag(covariance))
            ratios = errors / [self._all[each].enough for each in free]
            worst = int(np.argmax(ratios))
            if ratios[worst] <= 1.0:
                break
            related = np.abs(covariance[worst] / errors / errors[worst]) > 0.9
            dropped[free[worst]] = [each for each, is_one in zip(free, related) if is_one]
            dropped[free[worst]].remove(free[worst])
            free = [each for each in free if each != free[worst]]
        return free, dropped


def fit(logs: Sequence[DriveLog], car: Car, pose_offset: float = 0.0) -> Fit:
    """Fit a car to its drives.

    Args:
        logs: the drives.
        car: the car before the fit.
        pose_offset: distance of the point whose pose is reported, in front of the rear axle [m].
    """
    problem = Problem(logs, car, pose_offset)
    coarse = Problem(logs, car, pose_offset, MAX_POSES_FOR_NOISE)
    count = len(PARAMETERS)
    delays = list(range(count, count + len(logs)))
    noise = USUAL_NOISE
    vector = problem.find_delays(problem.default, noise)
    free, dropped = problem.known(vector, [*range(count), *delays], noise)
    vector = problem.solve(vector, free, noise)
    vector = problem.find_delays(vector, noise)
    for _ in range(2):
        vector = problem.solve(vector, free, noise)
        noise = coarse.find_noise(vector, free, noise)
    free, dropped = problem.known(vector, [*range(count), *delays], noise)
    unknown = [each for each in range(count) if each not in free]
    vector[unknown] = problem.default[unknown]
    vector = problem.solve(vector, free, noise)
    errors = dict(zip(free, problem.errors(vector, free, list(dropped), noise).tolist()))
    return _result(problem, vector, errors, dropped, noise, car)


def _result(
    problem: Problem,
    vector: np.ndarray,
    errors: Dict[int, float],
    dropped: Dict[int, List[int]],
    noise: Noise,
    car: Car,
) -> Fit:
    """Return the result of a fit."""
    names = [each.name for each in PARAMETERS]
    count = len(names)
    values = []
    for column, number in enumerate(vector.tolist()):
        is_rate = column < count and names[column] in RATES
        before = float(problem.default[column])
        if column in errors:
            values.append(fitted_value(number, before, errors[column], is_rate))
        else:
            value = getattr(car, names[column]) if column < count else before
            confused = [(*names, DELAY.name)[min(each, count)] for each in dropped.get(column, [])]
            values.append(Value(value, is_fitted=False, confused_with=tuple(confused)))
    found: Dict[str, Any] = {name: value.value for name, value in zip(names, values)}
    return Fit(
        car._replace(**found),
        dict(zip(names, values)),
        tuple(values[count:]),
        noise,
        tuple(problem.misfit(vector, index, noise) for index in range(len(vector) - count)),
    )
