"""The least-squares problem of some drives of one car.

The fitted numbers are those of PARAMETERS, and for each drive those of OF_DRIVE: its delay, and
how its speed gain and steering offset differ from those of the car. Each number is also drawn to
its default value, with the strength of one measurement that has its `width` as standard deviation.
A number with the width 0 is fixed.
"""

import math
from typing import Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2, norm

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import (
    OF_DRIVE,
    PARAMETERS,
    Misfit,
    car_with,
    numbers_of,
)
from mushr_ros_intro.comparison.pose_filter import (
    Noise,
    Steps,
    Weights,
    glitch_sizes,
    prediction_errors,
    steps_of,
    usual_noise,
    weights_of,
)
from mushr_ros_intro.preview.side_by_side import paths
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

MISFIT_PROBABILITY = 1e-3
"""Probability that a drive with random errors only counts as a misfit."""

_GLITCH_PROBABILITY = 1e-6
"""The same for a glitch. It is small, because the size of the random errors is an estimate."""

_MAX_GLITCHES = 0.05
"""A drive with a larger share of glitches does not fit the model; then there are none."""

DELAYS = np.arange(-1.0, 1.55, 0.1)
"""The delays with which the fit begins [s]; the best one is used. Clocks may differ by a second."""

_WEAK = 10.0
"""The width of a number that the drives determine, as a multiple of `max_error`."""

COUNT = len(PARAMETERS)


class DriveProblem:
    """One drive, and the motion of a car with other parameters in it.

    A vector has the numbers of PARAMETERS and OF_DRIVE.
    """

    def __init__(self, log: DriveLog, car: Car, count: int) -> None:
        every = -(-len(log.stamps) // count)
        self._plan = log.plan
        self._car = car._replace(speed_noise=0.0, steering_noise=0.0)
        self._stamps, self._poses = log.stamps[::every], log.poses[::every]
        self._seconds = np.diff(self._stamps) / NANOSECONDS
        self._ends = np.cumsum([row.duration for row in log.plan.rows])
        self._is_glitch = np.zeros(len(self._seconds), bool)

    def car(self, numbers: np.ndarray) -> Car:
        """Return the car that a vector describes."""
        *of_car, _, speed_gain, steering_offset = numbers.tolist()
        car = car_with(self._car, of_car)
        return car._replace(
            speed_gain=car.speed_gain + speed_gain,
            steering_offset=car.steering_offset + steering_offset,
        )

    def steps(self, vectors: np.ndarray) -> Steps:
        """Return the steps of cars, one for each vector."""
        cars = [self.car(numbers) for numbers in vectors]
        instants = self._stamps / NANOSECONDS - vectors[:, COUNT, None]
        return steps_of(paths(self._plan, cars, instants))

    def weights(self, steps: Steps, noises: Sequence[Noise]) -> Weights:
        """Return the weights of the motion of the first car in some steps, for each noise."""
        one = Steps(steps.moves[0], steps.turns[0])
        return weights_of(one, self._seconds, self._is_glitch, self._car.wheelbase, noises)

    def residuals(self, steps: Steps, weights: Weights) -> np.ndarray:
        """Return the residuals of cars, (noises, cars, residuals)."""
        errors = prediction_errors(steps, self._poses, weights)
        return errors.reshape(*errors.shape[:2], -1)

    def find_glitches(self, numbers: np.ndarray, noise: Noise) -> bool:
        """Find the steps that no random error explains; return whether they have changed.

        After a glitch the filter begins anew.
        """
        steps, before = self.steps(numbers[None]), self._is_glitch
        limit = chi2.isf(_GLITCH_PROBABILITY / (2 * len(before)), 3)
        self._is_glitch = np.zeros_like(before)
        while self._is_glitch.mean() <= _MAX_GLITCHES:
            weights = self.weights(steps, [noise])
            errors = self.residuals(steps, weights).reshape(-1, 3)
            lasting = glitch_sizes(errors, steps, weights)
            sizes = np.maximum(lasting, np.sum(errors**2, axis=1))
            worst = int(np.argmax(np.where(self._is_glitch, 0.0, sizes)))
            if sizes[worst] < limit:
                return not np.array_equal(before, self._is_glitch)
            self._is_glitch[worst] = True
        self._is_glitch = np.zeros_like(before)
        return bool(before.any())

    def glitches(self, delay: float) -> List[Tuple[float, float]]:
        """Return the times of the poses before and after each glitch [s]."""
        times = self._stamps / NANOSECONDS - delay
        return [tuple(times[each : each + 2].tolist()) for each in np.flatnonzero(self._is_glitch)]

    def misfit(self, numbers: np.ndarray, noise: Noise) -> Misfit:
        """Return where a drive differs most from the fitted car.

        The prediction errors of a row have the mean 0 and the variance 1, if the model is right.
        """
        steps = self.steps(numbers[None])
        errors = self.residuals(steps, self.weights(steps, [noise])).reshape(-1, 3)
        stamps = self._stamps[1:] - from_seconds(numbers[COUNT])
        rows = np.searchsorted(self._ends, stamps, side="right")
        rows[(stamps < 0) | self._is_glitch] = len(self._ends)
        sizes = [
            np.abs(errors[rows == row].sum(axis=0)) / math.sqrt(max(1, np.sum(rows == row)))
            for row in range(len(self._ends))
        ]
        row, column = divmod(int(np.argmax(sizes)), 3)
        limit = float(norm.isf(0.5 * MISFIT_PROBABILITY / (3 * len(sizes))))
        what = ("distance", "sideways", "turn")[column]
        return Misfit(row, what, float(np.max(sizes)), limit)


class Neighbours(NamedTuple):
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
        self.usual = usual_noise(car)
        self.drives = [DriveProblem(log, car, max_poses) for log in logs]
        self.parameters = (*PARAMETERS, *OF_DRIVE * len(logs))
        self.max_error = np.array([each.max_error for each in self.parameters])
        self.default = np.array([*numbers_of(car), *[0.0] * len(OF_DRIVE) * len(logs)])
        self._columns = [
            np.r_[:COUNT, begin : begin + len(OF_DRIVE)]
            for begin in range(COUNT, len(self.parameters), len(OF_DRIVE))
        ]

    def widths(self, noise: Noise, unknown: Sequence[int] = (), width: float = 0.0) -> np.ndarray:
        """Return the widths of all numbers: `width` times `max_error` for the unknown ones."""
        widths = _WEAK * self.max_error
        widths[list(unknown)] = width * self.max_error[list(unknown)]
        is_shared = len(self.drives) == 1  # nothing tells a drive from the car
        for column, spread in enumerate(noise[-2:], COUNT + 1):
            widths[column :: len(OF_DRIVE)] = 0.0 if is_shared else spread
        return widths

    def _weights(self, vector: np.ndarray, noise: Noise) -> List[Weights]:
        return [
            drive.weights(drive.steps(numbers[None]), [noise])
            for drive, numbers in zip(self.drives, self.vectors(vector))
        ]

    def _residuals(
        self, vector: np.ndarray, weights: List[Weights], widths: np.ndarray
    ) -> np.ndarray:
        """Return the residuals of all drives, and those of the free numbers."""
        parts = [
            drive.residuals(drive.steps(numbers[None]), each)[0, 0]
            for drive, numbers, each in zip(self.drives, self.vectors(vector), weights)
        ]
        free = widths > 0.0
        return np.concatenate([*parts, (vector - self.default)[free] / widths[free]])

    def vectors(self, vector: np.ndarray) -> List[np.ndarray]:
        """Return the part of a vector that concerns each drive."""
        return [vector[columns] for columns in self._columns]

    def find_glitches(self, vector: np.ndarray, noise: Noise) -> bool:
        """Find the glitches of all drives; return whether they have changed."""
        parts = zip(self.drives, self.vectors(vector))
        changed = [drive.find_glitches(numbers, noise) for drive, numbers in parts]
        return any(changed)

    def neighbours(self, vector: np.ndarray, free: np.ndarray, index: int) -> Neighbours:
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
        return Neighbours(places, changes, self.drives[index].steps(vectors[:, columns]))

    def _jacobian(
        self, vector: np.ndarray, weights: List[Weights], widths: np.ndarray
    ) -> np.ndarray:
        """Return the derivatives of the residuals by the free numbers."""
        free = np.flatnonzero(widths)
        parts = []
        for index, drive in enumerate(self.drives):
            near = self.neighbours(vector, free, index)
            part = near.jacobian(drive.residuals(near.steps, weights[index])[0])
            parts.append(np.zeros((part.shape[1], len(free))))
            parts[-1][:, near.free] = part.T
        return np.concatenate([*parts, np.diag(1.0 / widths[free])])

    def find_delays(self, vector: np.ndarray, noise: Noise) -> np.ndarray:
        """Return `vector` with the best delay of each drive among DELAYS."""
        vector = vector.copy()
        for drive, columns, weights in zip(
            self.drives, self._columns, self._weights(vector, noise)
        ):
            tried = np.repeat(vector[None, columns], len(DELAYS), axis=0)
            tried[:, COUNT] = DELAYS
            costs = np.sum(drive.residuals(drive.steps(tried), weights)[0] ** 2, axis=1)
            vector[columns[COUNT]] = DELAYS[int(np.argmin(costs))]
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
            x_scale=self.max_error[free],
            xtol=1e-6,
            ftol=1e-6,
            max_nfev=30,
        )
        return full(result.x)

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
            worst = int(np.argmax(errors / self.max_error))
            if errors[worst] <= self.max_error[worst]:
                return unknown
            others = [each for each in np.flatnonzero(widths).tolist() if each != worst]
            unknown[worst] = [
                each
                for each in others
                if abs(covariance[worst, each]) > 0.9 * errors[worst] * errors[each]
            ]
