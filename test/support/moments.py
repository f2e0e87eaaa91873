"""Mean and covariance of the final pose of many cars without ramps: an oracle for the sampler.

With Z = x + iy and U = exp(i theta), one command is Z += U c, U *= e, theta += d, where c, e and d
do not depend on the past. So the moments of Z, U and theta obey linear recursions. The errors of a
command, and those of a whole run, are integrated by Gauss-Hermite quadrature.
"""

import functools
import math

import numpy as np

from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS

WHEELBASE = 0.33
RUN_NODES = 40
"""Per error of a run; enough if a standard deviation turns the car by up to two radians."""
COMMAND_NODES = 8


def nodes(deviation, count):
    """Return the nodes and weights that integrate over a normal distribution."""
    if deviation == 0.0:
        return np.zeros(1), np.ones(1)
    values, weights = np.polynomial.hermite_e.hermegauss(count)
    return values * deviation, weights / weights.sum()


def grid(one, other):
    """Return the nodes of two independent errors and their weights, as flat arrays."""
    (first, first_weights), (second, second_weights) = one, other
    return (
        np.repeat(first, len(second)),
        np.tile(second, len(first)),
        np.outer(first_weights, second_weights).ravel(),
    )


def moments(plan, errors):
    """Return the mean (3,) and the covariance (3, 3) of the final x, y and theta."""
    scale, offset, run_weights = grid(
        nodes(errors.speed_scale, RUN_NODES), nodes(errors.steering_offset, RUN_NODES)
    )

    @functools.lru_cache(None)
    def moments_of(speed, angle, seconds):
        """Return the moments of one command, for each node of the errors of a run."""
        noise = errors.speed * (speed != 0.0), errors.steering_angle * (speed != 0.0)
        v, delta, weights = grid(*(nodes(each, COMMAND_NODES) for each in noise))
        v = v + speed * (1.0 + scale[:, np.newaxis])
        delta = delta + angle + offset[:, np.newaxis]
        d = v * seconds * np.tan(delta) / WHEELBASE
        c = v * seconds * np.sinc(0.5 * d / math.pi) * np.exp(0.5j * d)
        e = np.exp(1j * d)
        products = (c, e, d, c * c, abs(c) ** 2, c * e, c.conj() * e, e * e, d * c, d * e, d * d)
        return [(each * weights).sum(axis=1) for each in products]

    # The moments at the start; capitals are conjugates.
    x, y, theta = plan.start
    variance = errors.start_heading**2
    one = np.ones(len(scale))
    z = one * complex(x, y)
    u = one * np.exp(1j * theta - 0.5 * variance)
    t, tt = one * theta, one * (theta**2 + variance)
    uu = one * np.exp(2j * theta - 2.0 * variance)
    tu = (t + 1j * variance) * u
    zz, zZ = z * z, abs(z) ** 2 + 2.0 * errors.start_position**2  # noqa: N806
    zu, Zu, tz = z * u, z.conj() * u, t * z  # noqa: N806

    for row in plan.rows:
        for begin in range(0, row.duration, COMMAND_PERIOD):
            seconds = min(COMMAND_PERIOD, row.duration - begin) / NANOSECONDS
            c, e, d, cc, cC, ce, Ce, ee, dc, de, dd = moments_of(  # noqa: N806
                row.speed, row.steering_angle, seconds
            )
            tz = tz + tu * c + d * z + u * dc
            zz, zZ = zz + 2.0 * zu * c + uu * cc, zZ + 2.0 * (Zu * c).real + cC  # noqa: N806
            zu, Zu = zu * e + uu * ce, Zu * e + Ce  # noqa: N806
            tt, tu = tt + 2.0 * t * d + dd, tu * e + u * de
            z, u, t, uu = z + u * c, u * e, t + d, uu * ee

    def over_runs(values):
        return float((values * run_weights).sum())

    mean = np.array([over_runs(each) for each in (z.real, z.imag, t)])
    xx, yy = over_runs(0.5 * (zZ + zz.real)), over_runs(0.5 * (zZ - zz.real))
    xy, xt, yt = over_runs(0.5 * zz.imag), over_runs(tz.real), over_runs(tz.imag)
    raw = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, over_runs(tt)]])
    return mean, raw - np.outer(mean, mean)
