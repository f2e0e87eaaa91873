"""The least-squares problem of a drive. A vector has the NUMBERS."""

import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog, start_pose
from mushr_ros_intro.comparison.faults import (
    JUMP,
    JUMP_STEP,
    NUMBERS,
    PARAMETERS,
    Fault,
    columns_of,
    paths,
)
from mushr_ros_intro.comparison.step_errors import Steps, Whitening, noise_of, step_errors, steps_of
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

MISFIT_PROBABILITY = 1e-3
"""Probability that a drive with random errors only counts as a misfit."""

RATES = ("acceleration", "steering_rate")
"""The parameters of which the inverse is fitted."""

DELAYS = np.arange(-1.0, 1.55, 0.1)
"""The delays with which the fit begins [s]; the best one is used. Clocks may differ by a second."""

DELAY = len(PARAMETERS) - 1
"""The column of the delay."""

_MIN_SEGMENT = NANOSECONDS
"""Duration of the shortest part of a drive that is tested on its own [ns]."""

_TOGETHER = 4
"""Every so many segments are tested together; see `Problem.misfit`."""

_MEDIAN_SQUARE = 0.455
"""The median of the square of a standard normal number."""

_JUMPS = 3
"""In so many steps, a jump of the localisation is tried."""

_MOVED = 0.05
"""A car that moves by more in the second before the first command moves already [m]."""

_SMALL_DIFFERENCE = 0.02
"""A smaller mean difference of the velocity is no misfit [m/s, rad/s]."""

_MAX_ERRORS = np.array([each.max_error for each in NUMBERS])


class Misfit(NamedTuple):
    """The row in which a drive differs most from the fitted car."""

    row: int
    """Index of the row."""
    what: str
    """"distance", "sideways" or "turn"."""
    size: float
    """The mean difference, in standard errors of it."""
    limit: float
    """Random errors exceed this size in 0.1 % of all drives."""

    @property
    def is_found(self) -> bool:
        """Whether the drive does not fit the model of the car."""
        return self.size > self.limit


def numbers_of(car: Car) -> List[float]:
    """Return the fitted numbers of a car, one for each of PARAMETERS; the delay is 0."""
    values = [(each.name, getattr(car, each.name)) for each in PARAMETERS[:-1]]
    return [*(1.0 / value if name in RATES else value for name, value in values), 0.0]


class Problem:
    """See the module; `car` is the car before the fit."""

    def __init__(self, log: DriveLog, car: Car) -> None:
        self._log = log
        self._car = car
        self._times = log.stamps / NANOSECONDS
        self._seconds = np.diff(self._times)
        self._ends, self._first_rows = _segments(log.plan)
        self._measured = steps_of(log.poses)
        self.noise = noise_of(log.poses, car)
        faultless = [each.neutral for each in NUMBERS[len(PARAMETERS) :]]
        self.default = np.array([*numbers_of(car), *faultless])
        self.whiten(self.default)

    def steps(self, vectors: np.ndarray) -> Steps:
        """Return the steps of cars, one for each vector."""
        instants = self._times - vectors[:, DELAY, None]
        steps = steps_of(paths(self._log.plan, self._car, vectors, instants))
        cars = np.arange(len(vectors))
        jump, ahead, left, turn = vectors[:, JUMP_STEP:].T
        steps.moves[cars, jump.astype(int)] += ahead + 1j * left
        steps.turns[cars, jump.astype(int)] += turn
        return steps

    def whiten(self, vector: np.ndarray) -> None:
        """Take the covariance of the steps from the motion of a car."""
        steps = self.steps(vector[None])
        one = Steps(steps.moves[0], steps.turns[0])
        self._whitening = Whitening(one, self._seconds, self._car.wheelbase, self.noise)

    def residuals(self, vectors: np.ndarray) -> np.ndarray:
        """Return the residuals of cars, (cars, residuals)."""
        return self._whitening(step_errors(self.steps(vectors), self._measured))

    def costs(self, vectors: np.ndarray) -> np.ndarray:
        """Return the sums of the squares of the residuals of cars, (cars,)."""
        return np.sum(self.residuals(vectors) ** 2, axis=1)

    def jacobian(self, vector: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """Return the derivatives of the residuals, (residuals, free numbers)."""
        larger, smaller = (np.repeat(vector[None], len(free), axis=0) for _ in range(2))
        for row, column in enumerate(free):
            each = NUMBERS[column]
            larger[row, column] += each.step
            smaller[row, column] = max(each.low, smaller[row, column] - each.step)
        rows = range(len(free))
        changes = larger[rows, free] - smaller[rows, free]
        high, low = np.split(self.residuals(np.concatenate([larger, smaller])), 2)
        return ((high - low) / changes[:, None]).T

    def best_delay(self, vector: np.ndarray) -> np.ndarray:
        """Return `vector` with the best delay among DELAYS, the other numbers adapted to each."""
        others = list(range(DELAY))
        best, lowest = vector, math.inf
        for delay in DELAYS:
            tried = vector.copy()
            tried[DELAY] = delay
            cost = self.cost_after_step(tried, others)  # so that a wrong gain hides no delay
            if cost < lowest:
                lowest, best = cost, tried
        return best

    def cost_after_step(self, vector: np.ndarray, free: Sequence[int]) -> float:
        """Return what one weakly bounded step of Gauss and Newton leaves of the cost."""
        free = list(free)
        bounds = np.diag(0.1 / np.minimum(_MAX_ERRORS[free], 1.0))
        system = np.vstack([self.jacobian(vector, free), bounds])
        right = np.append(self.residuals(vector[None])[0], np.zeros(len(free)))
        normal = system.T @ system
        return float(right @ right - (system.T @ right) @ np.linalg.solve(normal, system.T @ right))

    @property
    def levels(self) -> Tuple[int, int]:
        """How many speeds, without their signs, and steering angles are commanded in motion."""
        rows = [row for row in self._log.plan.rows if row.speed]
        return len({abs(row.speed) for row in rows}), len({row.steering_angle for row in rows})

    def solve(self, vector: np.ndarray, free: Sequence[int]) -> np.ndarray:
        """Return the numbers that fit best, from `vector` on."""
        if not free:
            return vector.copy()
        free = list(free)

        def full(part: np.ndarray) -> np.ndarray:
            whole = vector.copy()
            whole[free] = part
            return whole

        result = least_squares(
            lambda part: self.residuals(full(part)[None])[0],
            vector[free],
            lambda part: self.jacobian(full(part), free),
            bounds=([NUMBERS[each].low for each in free], [NUMBERS[each].high for each in free]),
            x_scale=np.minimum(_MAX_ERRORS[free], 1.0),
            xtol=1e-5,
            ftol=1e-5,
            max_nfev=30,
        )
        return full(result.x)

    def scale(self, vector: np.ndarray) -> float:
        """Return by which factor the squares of the residuals are larger than expected.

        The median does not count what happens in a small part of the drive.
        """
        squares = self.residuals(vector[None])[0] ** 2
        return max(1.0, float(np.median(squares) / _MEDIAN_SQUARE))

    def gain(self, before: np.ndarray, after: np.ndarray, numbers: int) -> float:
        """Return by how much the Bayesian information criterion is better with more numbers."""
        old, new = self.costs(np.array([before, after])).tolist()
        return (old - new) / self.scale(after) - numbers * math.log(3 * len(self._seconds))

    def _information(self, vector: np.ndarray, free: List[int]) -> np.ndarray:
        jacobian = self.jacobian(vector, free)
        return jacobian.T @ jacobian / self.scale(vector)

    def errors(
        self, vector: np.ndarray, free: Sequence[int], unknown: Sequence[int]
    ) -> List[float]:
        """Return the standard errors of the PARAMETERS; the unknown numbers may be wrong, too."""
        columns = [*free, *unknown]
        widths = np.where(np.isin(columns, unknown), 1.0, 10.0) * _MAX_ERRORS[columns]
        errors = np.zeros(len(vector))
        if columns:
            information = self._information(vector, columns) + np.diag(widths**-2.0)
            errors[columns] = np.sqrt(np.diag(np.linalg.inv(information)))
        return errors[: len(PARAMETERS)].tolist()

    def unknown(self, vector: np.ndarray, columns: Sequence[int]) -> List[int]:
        """Return the numbers among some that the drive does not determine.

        The one with the largest standard error is fixed, until all others are small enough.
        """
        unknown: List[int] = []
        free = list(columns)
        information = self._information(vector, free)
        information += np.diag((10.0 * _MAX_ERRORS[free]) ** -2.0)
        while free:
            errors = np.sqrt(np.diag(np.linalg.inv(information)))
            worst = int(np.argmax(errors / _MAX_ERRORS[free]))
            if errors[worst] <= _MAX_ERRORS[free[worst]]:
                break
            unknown.append(free.pop(worst))
            information = np.delete(np.delete(information, worst, 0), worst, 1)
        return unknown

    def starts(self, fault: Fault, vector: np.ndarray) -> np.ndarray:
        """Return the vectors with which the fit of a fault begins, (starts, numbers)."""
        if fault is JUMP:
            errors = step_errors(self.steps(vector[None]), self._measured)[0]
            sizes = np.sum(self.residuals(vector[None])[0].reshape(-1, 3) ** 2, axis=1)
            steps = np.argsort(sizes)[-_JUMPS:]
            values = np.column_stack([steps, errors[steps]])
            columns = [JUMP_STEP, *columns_of(fault)]
        else:
            values = np.array([fault.starts]).T * self._largest(fault, vector)
            columns = list(columns_of(fault))
        tried = np.repeat(vector[None], len(values), axis=0)
        tried[:, columns] = values
        return tried

    def _largest(self, fault: Fault, vector: np.ndarray) -> float:
        """Return the largest command that a fault limits, as it does; 1 for other faults."""
        commands = np.array([self._car.within_limits(*row[:2]) for row in self._log.plan.rows])
        speeds, angles = commands.T
        speed_gain, gain, offset = vector[:3]
        driven = {
            "speed_cap": np.abs(speeds * speed_gain),
            "left_stop": angles * gain + offset,
            "right_stop": -angles * gain - offset,
            "speed_dead_band": np.abs(speeds),
            "steering_dead_band": np.abs(angles),
        }.get(fault.number.name)
        return 1.0 if driven is None else max(0.03, float(driven.max()))

    def jump_time(self, vector: np.ndarray) -> float:
        """Return when the localisation jumps, after the first command [s]."""
        return float(self._times[int(vector[JUMP_STEP]) + 1] - vector[DELAY])

    def path_error(self, vector: np.ndarray, aligned: bool = False) -> float:
        """Return the distance of the whole path from the drive [m] (rms).

        Both begin at the start pose, or are moved to where they are nearest to each other.
        """
        steps = self.steps(vector[None])
        headings = np.append(0.0, np.cumsum(steps.turns[0]))
        path = np.append(0.0, np.cumsum(steps.moves[0] * np.exp(1j * headings[:-1])))
        driven = self._log.poses[:, 0] + 1j * self._log.poses[:, 1]
        is_drive = self._times >= vector[DELAY]
        if aligned:
            path, driven = (each[is_drive] - each[is_drive].mean() for each in (path, driven))
            path = path * np.exp(1j * np.angle(np.vdot(path, driven)))
        else:
            start = start_pose(self._log, from_seconds(vector[DELAY]))
            path = complex(*start[:2]) + path * np.exp(1j * start.theta)
            path, driven = path[is_drive], driven[is_drive]
        return float(np.sqrt(np.mean(np.abs(path - driven) ** 2)))

    def moves_before(self, vector: np.ndarray) -> bool:
        """Return whether the car moves in the second before its first command takes effect."""
        since = self._times - vector[DELAY]
        places = self._log.poses[(since > -1.0) & (since <= 0.0), :2]
        half = len(places) // 2
        if not half:
            return False
        moved = math.dist(places[:half].mean(axis=0), places[half:].mean(axis=0))
        return moved > _MOVED + 4.0 * self.noise.position * math.sqrt(2.0 / half)

    def misfit(self, vector: np.ndarray) -> Misfit:
        """Return where a drive differs most from the fitted car.

        For each segment, this is the score test for an additional constant velocity in it. Such a
        velocity also shows in some residuals after its segment, so those of every fourth segment
        are tested together.
        """
        residuals = self.residuals(vector[None])[0] / math.sqrt(self.scale(vector))
        stamps = self._log.stamps[1:] - from_seconds(vector[DELAY])
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
                information = np.maximum(np.bincount(groups, white**2), 1e-30)
                is_large = np.abs(scores) > _SMALL_DIFFERENCE * information
                sizes = np.where(is_large, np.abs(scores) / np.sqrt(information), 0.0)
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
            rows.append(index)
    return ends, rows
