"""Estimate the random errors of drives, and how far a fitted number may be wrong because of it."""

import math
from typing import Sequence, Tuple

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import norm

from mushr_ros_intro.comparison.pose_filter import MAX_NOISE, MIN_NOISE, NOISE_FACTORS, Noise
from mushr_ros_intro.comparison.problem import Problem

_STEP = 1e-3
"""For the derivative by the logarithm of a noise."""

_LONG_STEP = 0.1
"""For the second derivative."""

NORMAL_FACTOR = float(norm.ppf(0.975))
"""So many standard deviations does a 95 % range reach to each side."""

_POINTS, _WEIGHTS = np.polynomial.hermite_e.hermegauss(41)
"""To integrate over a normal distribution."""


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
        spreads = np.exp(2.0 * logarithms[:, 4:])
        return costs, np.column_stack([variances, variances[:, [0, 2]] + spreads])

    def range_factors(self, noise: Noise) -> np.ndarray:
        """Return how many standard deviations the 95 % ranges reach to each side, (numbers + 2,).

        For the numbers see `_costs`. It is more than 1.96, because the drives say little about the
        noise. The logarithm of the noise is about normally distributed, with the second derivative
        of the cost as the inverse of its covariance (Laplace's approximation, as in Rue, Martino
        and Chopin, "Approximate Bayesian inference for latent Gaussian models", 2009).
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
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.log(variances[1 : 2 * count + 1])
            gradient = logarithms[:count] - logarithms[count:]
        gradient = np.nan_to_num(gradient) / (2.0 * _LONG_STEP)
        deviations = np.sqrt(np.sum((vectors.T @ gradient) ** 2 / values[:, None], axis=0))
        return np.array([range_factor(each) for each in deviations.tolist()])


def range_factor(deviation: float) -> float:
    """Return how many standard deviations a 95 % range reaches to each side of a normal number.

    Args:
        deviation: standard deviation of the logarithm of the variance of the number.
    """
    scales = np.exp(-0.5 * deviation * _POINTS)
    weights = _WEIGHTS / np.sum(_WEIGHTS)
    return brentq(lambda factor: weights @ norm.cdf(factor * scales) - 0.975, 1.0, 100.0)
