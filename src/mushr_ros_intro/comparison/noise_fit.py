"""Estimate the random errors of drives, and how far a fitted number may be wrong because of it."""

import math
from typing import List, Sequence, Tuple

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

from mushr_ros_intro.comparison.pose_filter import MAX_NOISE, MIN_NOISE, NOISE_FACTORS, Noise
from mushr_ros_intro.comparison.problem import Problem

_STEP = 1e-3
"""For the derivative by the logarithm of a noise."""

_LONG_STEP = 0.1
"""For the second derivative."""

_GRID = np.arange(-3.0, 4.25, 0.5)
"""Noises to integrate over, in standard deviations from the best one."""

_MIN_VARIANCE = 1e-30
"""So that the variance of a fixed number has a logarithm."""


class NoiseFit:
    """The noise of a problem with the largest restricted likelihood.

    The likelihood alone would give too small a noise, because the fit has adapted the free numbers
    to it.
    """

    def __init__(self, problem: Problem, vector: np.ndarray, unknown: Sequence[int]) -> None:
        self._problem = problem
        self._unknown = unknown
        self._free = np.flatnonzero(problem.widths(problem.usual, unknown))
        self._apart = (vector - problem.default)[self._free]
        self._neighbours = [
            problem.neighbours(vector, self._free, index) for index in range(len(problem.drives))
        ]

    def best(self, noise: Noise) -> Noise:
        """Return the noise, searched from `noise` on."""

        def cost(logarithms: np.ndarray) -> Tuple[float, np.ndarray]:
            """Return the cost and its derivatives."""
            count = len(logarithms)
            here, *others = self._costs(logarithms + _STEP * np.eye(count + 1, count, k=-1))[0]
            return here, (np.array(others) - here) / _STEP

        bounds = [(math.log(low), math.log(high)) for low, high in zip(MIN_NOISE, MAX_NOISE)]
        options = {"ftol": 1e-7, "maxiter": 30}
        begin = np.log(noise)
        result = minimize(cost, begin, method="L-BFGS-B", jac=True, bounds=bounds, options=options)
        return Noise(*np.exp(result.x).tolist())

    def _costs(self, logarithms: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return minus twice the logarithm of the restricted likelihood of some noises.

        Also return the variances that follow from each noise, (noises, numbers + 2): of the
        fitted numbers, and of the speed gain and the steering offset of the next drive.
        """
        problem, free = self._problem, self._free
        noises = [Noise(*each) for each in np.exp(logarithms).tolist()]
        apart = (logarithms - np.log(problem.usual)) / np.log(NOISE_FACTORS)
        widths = np.array([problem.widths(each, self._unknown)[free] for each in noises])
        costs = np.sum(apart**2, axis=1) + np.sum((self._apart / widths) ** 2, axis=1)
        costs += 2.0 * np.sum(np.log(widths), axis=1)
        information = np.array([np.diag(each**-2) for each in widths])
        for drive, near in zip(problem.drives, self._neighbours):
            weights = drive.weights(near.steps, noises)
            residuals = drive.residuals(near.steps, weights)
            costs += np.sum(residuals[:, 0] ** 2, axis=1) + weights.log_determinants
            for each, part in zip(information, residuals):
                jacobian = near.jacobian(part)
                each[np.ix_(near.free, near.free)] += jacobian @ jacobian.T
        costs += np.linalg.slogdet(information)[1]
        variances = np.zeros((len(noises), len(problem.default)))
        variances[:, free] = np.diagonal(np.linalg.inv(information), axis1=1, axis2=2)
        spreads = np.exp(2.0 * logarithms[:, -2:])
        return costs, np.column_stack([variances, variances[:, [0, 2]] + spreads])

    def range_factors(self, noise: Noise) -> Tuple[List[float], List[float]]:
        """Return how far the 95 % range of each number reaches, in standard errors.

        It is more than 1.96, because the drives hardly determine the noise, and a number is
        normally distributed for a given noise only. So its range is that of a mixture, over the
        noises along the direction in which they change its variance most, for their probability.

        Also return by which factor the 95 % ellipse of the next drive is larger for this reason, if
        it comes from the speed gain or from the steering offset.
        """
        covariance, gradients = self._shape(noise)
        slopes = covariance @ gradients
        deviations = np.sqrt(np.sum(gradients * slopes, axis=0))
        directions = (slopes / np.maximum(deviations, 1e-9)).T
        grid = np.log(noise) + _GRID[:, None, None] * directions
        grid = np.clip(grid, np.log(MIN_NOISE), np.log(MAX_NOISE))
        flat = np.concatenate([np.log(noise)[None], grid.reshape(-1, len(noise))])
        costs, variances = self._costs(flat)
        variances = np.maximum(variances, _MIN_VARIANCE)
        numbers = len(directions)
        costs = costs[1:].reshape(-1, numbers)
        weights = np.exp(0.5 * (costs.min(axis=0) - costs))
        ratios = variances[1:].reshape(-1, numbers, numbers).diagonal(axis1=1, axis2=2)
        columns = list(zip((ratios / variances[0]).T, weights.T))
        of_numbers = [range_factor(*each, 1) for each in columns[:-2]]
        normal = math.sqrt(chi2.ppf(0.95, 2))
        return of_numbers, [range_factor(*each, 2) / normal for each in columns[-2:]]

    def _shape(self, noise: Noise) -> Tuple[np.ndarray, np.ndarray]:
        """Return how the logarithms of the noise and of the variances depend on each other.

        Returns:
            The covariance of the logarithms of the noise, from the second derivatives of the cost,
            and the derivatives of those of the variances in `_costs` by them.
        """
        count = len(noise)
        ahead = _LONG_STEP * np.eye(count)
        pairs = [(i, j) for i in range(count) for j in range(i)]
        steps = [np.zeros(count), *ahead, *-ahead, *(ahead[i] + ahead[j] for i, j in pairs)]
        costs, variances = self._costs(np.log(noise) + np.array(steps))
        here, larger, smaller, both = np.split(costs, [1, count + 1, 2 * count + 1])
        curvature = np.diag(larger + smaller - 2.0 * here)
        for (i, j), value in zip(pairs, both):
            curvature[i, j] = curvature[j, i] = value - larger[i] - larger[j] + here[0]
        values, vectors = np.linalg.eigh(0.5 * curvature / _LONG_STEP**2)
        # Without the drives, the noise is known to these factors.
        values = np.maximum(values, 1.0 / np.log(max(NOISE_FACTORS)) ** 2)
        logarithms = np.log(np.maximum(variances[1 : 2 * count + 1], _MIN_VARIANCE))
        gradients = (logarithms[:count] - logarithms[count:]) / (2.0 * _LONG_STEP)
        return (vectors / values) @ vectors.T, gradients


def range_factor(ratios: np.ndarray, weights: np.ndarray, dimensions: int) -> float:
    """Return the size of the region that contains 95 % of a mixture of normal distributions.

    Args:
        ratios: of the variance of each distribution and a reference, (N,).
        weights: of the distributions, (N,).
        dimensions: 1 for a range, 2 for an ellipse.

    Returns:
        The distance from the mean, in standard deviations of the reference.
    """
    inverses = 1.0 / ratios
    shares = weights / np.sum(weights)

    def missing(factor: float) -> float:
        return float(shares @ chi2.cdf(factor**2 * inverses, dimensions)) - 0.95

    return float(brentq(missing, 1e-3, 1e3))
