"""The random errors that the filter of the poses expects, against their integrals."""

import numpy as np
import pytest

from mushr_ros_intro.comparison.pose_filter import MIN_NOISE, Steps, _changes


def test_an_error_of_the_steering_angle_moves_the_car_to_the_side():
    """The heading is the integral of white noise over the distance, and y that of the heading."""
    steps = Steps(np.array([2.0 + 0.0j]), np.array([0.0]))
    noise = MIN_NOISE._replace(steering_noise=0.1, speed_noise=0.0, slip=0.0)
    (covariance,) = _changes(steps, np.array([1.0]), 0.3, noise)
    variance = covariance[2, 2]
    assert variance > 0.01
    assert covariance[1, 1] == pytest.approx(variance * 2.0**2 / 3.0)
    assert covariance[1, 2] == pytest.approx(variance * 2.0 / 2.0)
    assert covariance[0, 0] == pytest.approx(0.0, abs=1e-12)
