"""Fit the parameters of a car to a recorded drive.

Least squares (scipy.optimize.least_squares) on the errors of the steps from pose to pose, with the
model of the simulated car. See `step_errors` for why not on the whole path.
"""

import math
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog
from mushr_ros_intro.comparison.fitted_car import (
    OF_CAR,
    PARAMETERS,
    Fit,
    Misfit,
    Value,
    car_with,
    fitted_value,
    numbers_of,
)
from mushr_ros_intro.comparison.step_errors import Steps, Whitening, noise_of, step_errors, steps_of
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.side_by_side import paths
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

MISFIT_PROBABILITY = 1e-3
"""Probability that a drive with random errors only counts as a misfit."""

DELAYS = np.arange(-1.0, 1.55, 0.1)
"""The delays with which the fit begins [s]; the best one is used. Clocks may differ by a second."""

_MIN_SEGMENT = NANOSECONDS
"""Duration of the shortest part of a drive that is tested on its own [ns]."""

_TOGETHER = 4
"""Every so many segments are tested together; see `_Problem.misfit`."""

_MEDIAN_SQUARE = 0.455
"""The median of the square of a standard normal number."""

_DELAY = len(PARAMETERS) - 1

_MAX_ERRORS = np.array([each.max_error for each in PARAMETERS])


def fit(log: DriveLog, car: Car) -> Fit:
    """Fit a car to its drive; `car` is the car before the fit."""
    problem = _Problem(log, car)
    vector = problem.best_delay(problem.default)
    unknown = problem.unknown(vector)
    for _ in range(2):  # the covariance of the steps depends on the motion
        problem.whiten(vector)
        vector = problem.solve(vector, list(unknown))
    unknown = problem.unknown(vector)
    vector[list(unknown)] = problem.default[list(unknown)]
    vector = problem.solve(vector, list(unknown))
    errors = np.sqrt(np.diag(problem.covariance(vector, list(unknown))))
    values: Dict[str, Value] = {}
    for column, (each, number) in enumerate(zip(PARAMETERS, vector.tolist())):
        if column in unknown:
            confused = tuple(PARAMETERS[other].name for other in unknown[column])
            before = getattr(car, each.name, 0.0)
            values[each.name] = Value(before, is_fitted=False, confused_with=confused)
        else:
            values[each.name] = fitted_value(each.name, number, float(errors[column]))
    found: Dict[str, Any] = {each.name: values[each.name].value for each in OF_CAR}
    return Fit(car._replace(**found), values, problem.noise.position, problem.misfit(vector))


class _Problem:
    """The least-squares problem of a drive. A vector has the numbers of PARAMETERS."""

    def __init__(self, log: DriveLog, car: Car) -> None:
        self._plan = log.plan
        self._car = car._replace(speed_noise=0.0, steering_noise=0.0)
        self._stamps = log.stamps
        self._seconds = np.diff(log.stamps) / NANOSECONDS
        self._ends, self._first_rows = _segments(log.plan)
        self._measured = steps_of(log.poses)
        self.noise = noise_of(log.poses, car)
        self.default = np.array(numbers_of(car))
        self.whiten(self.default)

    def steps(self, vectors: np.ndarray) -> Steps:
        """Return the steps of cars, one for each vector."""
        cars = [car_with(self._car, numbers) for numbers in vectors[:, :_DELAY].tolist()]
        instants = self._stamps / NANOSECONDS - vectors[:, _DELAY, None]
        return steps_of(paths(self._plan, cars, instants))

    def whiten(self, vector: np.ndarray) -> None:
        """Take the covariance of the steps from the motion of a car."""
        steps = self.steps(vector[None])
        one = Steps(steps.moves[0], steps.turns[0])
        self._whitening = Whitening(one, self._seconds, self._car.wheelbase, self.noise)

    def residuals(self, vectors: np.ndarray) -> np.ndarray:
        """Return the residuals of cars, (cars, residuals)."""
        return self._whitening(step_errors(self.steps(vectors), self._measured))

    def jacobian(self, vector: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """Return the derivatives of the residuals, (residuals, free numbers)."""
        larger, smaller = (np.repeat(vector[None], len(free), axis=0) for _ in range(2))
        for row, column in enumerate(free):
            each = PARAMETERS[column]
            larger[row, column] += each.step
            smaller[row, column] = max(each.low, smaller[row, column] - each.step)
        changes = (larger - smaller)[range(len(free)), free]
        high, low = np.split(self.residuals(np.concatenate([larger, smaller])), 2)
        return ((high - low) / changes[:, None]).T

    def best_delay(self, vector: np.ndarray) -> np.ndarray:
        """Return `vector` with the best delay among DELAYS, the other numbers adapted to each."""
        others = [each for each in range(len(vector)) if each != _DELAY]
        best: Optional[np.ndarray] = None
        lowest = math.inf
        for delay in DELAYS:
            tried = vector.copy()
            tried[_DELAY] = delay
            here = self.residuals(tried[None])[0]
            # One weakly bounded step of Gauss and Newton, so that a wrong gain hides no delay.
            system = np.vstack([self.jacobian(tried, others), np.diag(0.1 / _MAX_ERRORS[others])])
            right = np.append(here, np.zeros(len(others)))
            change = np.linalg.lstsq(system, -right, rcond=None)[0]
            cost = float(np.sum((system @ change + right) ** 2))
            if cost < lowest:
                lowest, best = cost, tried
        assert best is not None
        return best

    def solve(self, vector: np.ndarray, fixed: Sequence[int]) -> np.ndarray:
        """Return the numbers that fit best, from `vector` on."""
        free = [each for each in range(len(vector)) if each not in fixed]
        if not free:
            return vector

        def full(part: np.ndarray) -> np.ndarray:
            whole = vector.copy()
            whole[free] = part
            return whole

        result = least_squares(
            lambda part: self.residuals(full(part)[None])[0],
            vector[free],
            lambda part: self.jacobian(full(part), free),
            bounds=(
                [PARAMETERS[each].low for each in free],
                [PARAMETERS[each].high for each in free],
            ),
            x_scale=_MAX_ERRORS[free],
            xtol=1e-6,
            ftol=1e-6,
            max_nfev=30,
        )
        return full(result.x)

    def scale(self, vector: np.ndarray) -> float:
        """Return by which factor the squares of the residuals are larger than expected.

        The median does not count what happens in a small part of the drive.
        """
        squares = self.residuals(vector[None])[0] ** 2
        return max(1.0, float(np.median(squares) / _MEDIAN_SQUARE))

    def covariance(self, vector: np.ndarray, fixed: Sequence[int]) -> np.ndarray:
        """Return the covariance of all numbers; it is 0 for the fixed ones.

        Each number is weakly known before the drive. Residuals that are larger than the random
        errors make it larger.
        """
        free = [each for each in range(len(vector)) if each not in fixed]
        covariance = np.zeros((len(vector), len(vector)))
        if not free:
            return covariance
        scale = self.scale(vector)
        jacobian = self.jacobian(vector, free)
        weak = np.diag((10.0 * _MAX_ERRORS[free]) ** -2)
        covariance[np.ix_(free, free)] = np.linalg.inv(jacobian.T @ jacobian / scale + weak)
        return covariance

    def unknown(self, vector: np.ndarray) -> Dict[int, List[int]]:
        """Return the numbers that the drive does not determine.

        The one with the largest standard error is fixed, until all others are small enough. For
        each of them, also return those that cannot be told from it.
        """
        unknown: Dict[int, List[int]] = {}
        while len(unknown) < len(vector):
            covariance = self.covariance(vector, list(unknown))
            errors = np.sqrt(np.diag(covariance))
            worst = int(np.argmax(errors / _MAX_ERRORS))
            if errors[worst] <= _MAX_ERRORS[worst]:
                break
            unknown[worst] = [
                each
                for each in range(len(vector))
                if each != worst
                and abs(covariance[worst, each]) > 0.9 * errors[worst] * errors[each] > 0.0
            ]
        return unknown

    def misfit(self, vector: np.ndarray) -> Misfit:
        """Return where a drive differs most from the fitted car.

        For each segment, this is the score test for an additional constant velocity in it. Such a
        velocity also shows in some residuals after its segment, so those of every fourth segment
        are tested together.
        """
        residuals = self.residuals(vector[None])[0]
        stamps = self._stamps[1:] - from_seconds(vector[_DELAY])
        segments = np.where(stamps < 0, -1, np.searchsorted(self._ends, stamps, side="right"))
        limit = float(norm.isf(0.5 * MISFIT_PROBABILITY / (3 * len(self._first_rows))))
        found = Misfit(0, "distance", 0.0, limit)
        for first in range(_TOGETHER):
            is_inside = (segments >= 0) & (segments % _TOGETHER == first)
            groups = np.maximum((segments - first) // _TOGETHER, 0).repeat(3)
            for part, what in enumerate(("distance", "sideways", "turn")):
                units = np.zeros((1, len(segments), 3))
                units[0, is_inside, part] = self._seconds[is_inside]
                white = self._whitening(units)[0]
                scores = np.bincount(groups, white * residuals)
                information = np.bincount(groups, white**2)
                sizes = np.abs(scores) / np.sqrt(np.maximum(information, 1e-30))
                worst = int(np.argmax(sizes))
                if sizes[worst] > found.size:
                    row = self._first_rows[first + _TOGETHER * worst]
                    found = Misfit(row, what, float(sizes[worst]), limit)
        return found


def _segments(plan: Plan) -> Tuple[List[int], List[int]]:
    """Return when the segments of a plan end [ns], and the first row of each.

    A segment is a row, or several short ones. The time after the last row is one, too.
    """
    ends: List[int] = []
    rows, now = [0], 0
    for index, row in enumerate(plan.rows, 1):
        now += row.duration
        if now - (ends[-1] if ends else 0) >= _MIN_SEGMENT:
            ends.append(now)
            rows.append(min(index, len(plan.rows) - 1))
    return ends, rows
