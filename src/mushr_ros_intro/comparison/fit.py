"""Fit the parameters of a car to recorded drives.

Least squares (scipy.optimize.least_squares) on the prediction errors from pose to pose, with the
model of the simulated car. See `pose_filter` for why not on the whole path.

The fitted numbers are those of PARAMETERS, and for each drive those of OF_DRIVE: its delay, and
how its speed gain and steering offset differ from those of the car. Each number is also drawn to
its default value, with the strength of one measurement that has its `width` as standard deviation.
A number with the width 0 is fixed.
"""

import math
from typing import Any, Dict, List, NamedTuple, Sequence

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.stats import norm

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import (
    OF_DRIVE,
    PARAMETERS,
    Fit,
    Misfit,
    Value,
    car_with,
    fitted_value,
    numbers_of,
)
from mushr_ros_intro.comparison.pose_filter import (
    MAX_NOISE,
    MIN_NOISE,
    NOISE_FACTORS,
    Noise,
    Steps,
    Weights,
    deviance,
    prediction_errors,
    steps_of,
    usual_noise,
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

_WEAK = 10.0
"""The width of a number that the drives determine, as a multiple of `enough`."""

_COUNT = len(PARAMETERS)


class _Drive:
    """One drive, and the motion of a car with other parameters in it.

    A vector has the numbers of PARAMETERS and OF_DRIVE.
    """

    def __init__(self, log: DriveLog, car: Car, count: int) -> None:
        every = -(-len(log.stamps) // count)
        self._plan = log.plan
        self._car = car._replace(speed_noise=0.0, steering_noise=0.0)
        self.stamps, self.poses = log.stamps[::every], log.poses[::every]
        self._seconds = np.diff(self.stamps) / NANOSECONDS
        self.ends = np.cumsum([row.duration for row in log.plan.rows])

    def steps(self, vectors: np.ndarray) -> Steps:
        """Return the steps of cars, one for each vector."""
        paths = []
        for *numbers, delay, speed_gain, steering_offset in vectors.tolist():
            car = car_with(self._car, numbers)
            car = car._replace(
                speed_gain=car.speed_gain + speed_gain,
                steering_offset=car.steering_offset + steering_offset,
            )
            instants = (self.stamps - from_seconds(delay)).tolist()
            paths.append([state.pose for state in states_at(self._plan, car, instants)])
        return steps_of(np.array(paths))

    def weights(self, steps: Steps, noise: Noise) -> Weights:
        """Return the weights of the motion of the first car in some steps."""
        one = Steps(steps.moves[0], steps.turns[0])
        return weights_of(one, self._seconds, self._car.wheelbase, noise)

    def residuals(self, steps: Steps, weights: Weights) -> np.ndarray:
        """Return the residuals of cars, (cars, residuals)."""
        errors = prediction_errors(steps, self.poses, weights)
        return errors.reshape(len(errors), -1)


class _Neighbours(NamedTuple):
    """Vectors that differ from one vector in one free number, in one drive."""

    free: np.ndarray
    """The free numbers that concern the drive, as indices into all free ones."""
    changes: np.ndarray
    """The difference of the larger and the smaller number."""
    steps: Steps
    """Of the vector itself, those with a larger number, and those with a smaller one."""

    def jacobian(self, residuals: np.ndarray) -> np.ndarray:
        """Return the derivatives of residuals, (free numbers, residuals)."""
        larger, smaller = np.split(residuals[1:], 2)
        return (larger - smaller) / self.changes[:, None]


class Problem:
    """The least-squares problem of some drives of one car."""

    def __init__(self, logs: Sequence[DriveLog], car: Car, max_poses: int) -> None:
        self._usual = usual_noise(car)
        self._drives = [_Drive(log, car, max_poses) for log in logs]
        self.parameters = (*PARAMETERS, *OF_DRIVE * len(logs))
        self.enough = np.array([each.enough for each in self.parameters])
        self.default = np.array([*numbers_of(car), *[0.0] * len(OF_DRIVE) * len(logs)])
        self._columns = [
            np.r_[:_COUNT, begin : begin + len(OF_DRIVE)]
            for begin in range(_COUNT, len(self.parameters), len(OF_DRIVE))
        ]

    def widths(self, noise: Noise, unknown: Sequence[int] = (), width: float = 0.0) -> np.ndarray:
        """Return the widths of all numbers; that of the unknown ones is `width` times `enough`."""
        widths = _WEAK * self.enough
        widths[list(unknown)] = width * self.enough[list(unknown)]
        is_shared = len(self._drives) == 1  # nothing tells a drive from the car
        for column, spread in enumerate(noise[4:], _COUNT + 1):
            widths[column :: len(OF_DRIVE)] = 0.0 if is_shared else spread
        return widths

    def _weights(self, vector: np.ndarray, noise: Noise) -> List[Weights]:
        return [
            drive.weights(drive.steps(vector[None, columns]), noise)
            for drive, columns in zip(self._drives, self._columns)
        ]

    def _residuals(
        self, vector: np.ndarray, weights: List[Weights], widths: np.ndarray
    ) -> np.ndarray:
        """Return the residuals of all drives, and those of the free numbers."""
        parts = [
            drive.residuals(drive.steps(vector[None, columns]), each)[0]
            for drive, columns, each in zip(self._drives, self._columns, weights)
        ]
        free = widths > 0.0
        return np.concatenate([*parts, (vector - self.default)[free] / widths[free]])

    def _neighbours(self, vector: np.ndarray, free: np.ndarray, index: int) -> _Neighbours:
        """Return the neighbours of a vector in a drive."""
        columns = self._columns[index]
        places = np.flatnonzero(np.isin(free, columns))
        larger, smaller = (np.repeat(vector[None], len(places), axis=0) for _ in range(2))
        for row, column in enumerate(free[places]):
            each = self.parameters[column]
            larger[row, column] += each.step
            smaller[row, column] = max(each.low, smaller[row, column] - each.step)
        changes = (larger - smaller)[range(len(places)), free[places]]
        vectors = np.concatenate([vector[None], larger, smaller])
        return _Neighbours(places, changes, self._drives[index].steps(vectors[:, columns]))

    def _jacobian(
        self, vector: np.ndarray, weights: List[Weights], widths: np.ndarray
    ) -> np.ndarray:
        """Return the derivatives of the residuals by the free numbers."""
        free = np.flatnonzero(widths)
        parts = []
        for index, drive in enumerate(self._drives):
            near = self._neighbours(vector, free, index)
            part = near.jacobian(drive.residuals(near.steps, weights[index]))
            parts.append(np.zeros((part.shape[1], len(free))))
            parts[-1][:, near.free] = part.T
        return np.concatenate([*parts, np.diag(1.0 / widths[free])])

    def find_delays(self, vector: np.ndarray, noise: Noise) -> np.ndarray:
        """Return `vector` with the best delay of each drive among DELAYS."""
        vector = vector.copy()
        for drive, columns, weights in zip(
            self._drives, self._columns, self._weights(vector, noise)
        ):
            tried = np.repeat(vector[None, columns], len(DELAYS), axis=0)
            tried[:, _COUNT] = DELAYS
            costs = np.sum(drive.residuals(drive.steps(tried), weights) ** 2, axis=1)
            vector[columns[_COUNT]] = DELAYS[int(np.argmin(costs))]
        return vector

    def solve(self, vector: np.ndarray, widths: np.ndarray, noise: Noise) -> np.ndarray:
        """Return the numbers that fit best, from `vector` on."""
        weights = self._weights(vector, noise)
        free = np.flatnonzero(widths)
        if not len(free):
            return vector

        def full(part: np.ndarray) -> np.ndarray:
            whole = vector.copy()
            whole[free] = part
            return whole

        result = least_squares(
            lambda part: self._residuals(full(part), weights, widths),
            vector[free],
            lambda part: self._jacobian(full(part), weights, widths),
            bounds=(
                [self.parameters[each].low for each in free],
                [self.parameters[each].high for each in free],
            ),
            x_scale=self.enough[free],
            xtol=1e-6,
            ftol=1e-6,
            max_nfev=30,
        )
        return full(result.x)

    def find_noise(self, vector: np.ndarray, unknown: Sequence[int], noise: Noise) -> Noise:
        """Return the noise with the largest restricted likelihood.

        The likelihood alone would give too small a noise, because the fit has adapted the free
        numbers to it.
        """
        free = np.flatnonzero(self.widths(noise, unknown))
        neighbours = [self._neighbours(vector, free, index) for index in range(len(self._drives))]

        def cost(logarithms: np.ndarray) -> float:
            tried = Noise(*np.exp(logarithms).tolist())
            widths = self.widths(tried, unknown)[free]
            total = float(np.sum(((logarithms - np.log(self._usual)) / np.log(NOISE_FACTORS)) ** 2))
            total += float(np.sum(((vector - self.default)[free] / widths) ** 2))
            total += 2.0 * float(np.sum(np.log(widths)))
            information = np.diag(widths**-2)
            for drive, near in zip(self._drives, neighbours):
                weights = drive.weights(near.steps, tried)
                residuals = drive.residuals(near.steps, weights)
                total += deviance(residuals[0], weights)
                jacobian = near.jacobian(residuals)
                information[np.ix_(near.free, near.free)] += jacobian @ jacobian.T
            return total + float(np.linalg.slogdet(information)[1])

        bounds = [(math.log(low), math.log(high)) for low, high in zip(MIN_NOISE, MAX_NOISE)]
        result = minimize(
            cost,
            np.log(noise),
            method="L-BFGS-B",
            bounds=bounds,
            options={"eps": 1e-3, "ftol": 1e-7, "maxiter": 30},
        )
        return Noise(*np.exp(result.x).tolist())

    def covariance(self, vector: np.ndarray, widths: np.ndarray, noise: Noise) -> np.ndarray:
        """Return the covariance of all numbers; it is 0 for the fixed ones."""
        jacobian = self._jacobian(vector, self._weights(vector, noise), widths)
        free = np.flatnonzero(widths)
        covariance = np.zeros((len(widths), len(widths)))
        covariance[np.ix_(free, free)] = np.linalg.inv(jacobian.T @ jacobian)
        return covariance

    def unknown(self, vector: np.ndarray, noise: Noise) -> Dict[int, List[int]]:
        """Return the numbers that the drives do not determine.

        The one with the largest standard error is fixed, until all others are small enough. For
        each of them, also return those that cannot be told from it.
        """
        unknown: Dict[int, List[int]] = {}
        while True:
            widths = self.widths(noise, list(unknown))
            covariance = self.covariance(vector, widths, noise)
            errors = np.sqrt(np.diag(covariance))
            worst = int(np.argmax(errors / self.enough))
            if errors[worst] <= self.enough[worst]:
                return unknown
            others = [each for each in np.flatnonzero(widths).tolist() if each != worst]
            unknown[worst] = [
                each
                for each in others
                if abs(covariance[worst, each]) > 0.9 * errors[worst] * errors[each]
            ]

    def misfit(self, vector: np.ndarray, index: int, noise: Noise) -> Misfit:
        """Return where a drive differs most from the fitted car.

        The prediction errors of a row have the mean 0 and the variance 1, if the model is right.
        """
        drive, numbers = self._drives[index], vector[None, self._columns[index]]
        steps = drive.steps(numbers)
        errors = drive.residuals(steps, drive.weights(steps, noise)).reshape(-1, 3)
        stamps = drive.stamps[1:] - from_seconds(numbers[0, _COUNT])
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


def fit(logs: Sequence[DriveLog], car: Car) -> Fit:
    """Fit a car to its drives; `car` is the car before the fit."""
    problem = Problem(logs, car, MAX_POSES)
    coarse = Problem(logs, car, MAX_POSES_FOR_NOISE)
    noise = usual_noise(car)
    vector = problem.find_delays(problem.default, noise)
    unknown = problem.unknown(vector, noise)
    vector = problem.solve(vector, problem.widths(noise, list(unknown)), noise)
    vector = problem.find_delays(vector, noise)
    for _ in range(2):
        vector = problem.solve(vector, problem.widths(noise, list(unknown)), noise)
        noise = coarse.find_noise(vector, list(unknown), noise)
    unknown = problem.unknown(vector, noise)
    vector[list(unknown)] = problem.default[list(unknown)]
    vector = problem.solve(vector, problem.widths(noise, list(unknown)), noise)
    # The values of the unknown numbers may be wrong by as much as is `enough` for each.
    widths = problem.widths(noise, list(unknown), 1.0)
    errors = np.sqrt(np.diag(problem.covariance(vector, widths, noise))).tolist()
    names = [each.name for each in problem.parameters]
    values = []
    for column, (number, before) in enumerate(zip(vector.tolist(), problem.default.tolist())):
        if column in unknown:
            confused = tuple(names[each] for each in unknown[column])
            value = getattr(car, names[column], before)
            values.append(Value(value, is_fitted=False, confused_with=confused))
        else:
            values.append(fitted_value(names[column], number, before, errors[column]))
    found: Dict[str, Any] = {name: each.value for name, each in zip(names[:_COUNT], values)}
    found.update(zip(Noise._fields[2:], noise[2:]))
    for name in ("speed_gain", "steering_offset"):  # the next drive differs from the fitted value
        found[f"{name}_spread"] = math.hypot(found[f"{name}_spread"], errors[names.index(name)])
    return Fit(
        car._replace(**found),
        dict(zip(names[:_COUNT], values)),
        tuple(values[_COUNT :: len(OF_DRIVE)]),
        noise,
        tuple(problem.misfit(vector, index, noise) for index in range(len(logs))),
    )
