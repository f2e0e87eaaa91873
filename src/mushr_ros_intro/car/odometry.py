"""Compute the odometry that a car measures.

A car measures the turns of its motor, and knows the steering angle that it has commanded. So its
odometry contains neither the gains nor the steering offset of the car, and drifts at random. The
odometry of a car without gains and noise is exact.
"""

import math
from typing import NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car, State
from mushr_ros_intro.car.motion import normals
from mushr_ros_intro.geometry import ORIGIN, compose, curvature, drive_arc, inverse
from mushr_ros_intro.plan.plan import MAX_STEERING_ANGLE
from mushr_ros_intro.stamps import NANOSECONDS

_ROUNDING = 1e-9
"""A shorter step, or distance from the start, is a rounding error [m, rad]."""

_EXACT = np.zeros((3, 3))


class Odometry(NamedTuple):
    """The measured odometry at one instant."""

    state: State
    """The true state, but with measured speed and steering angle, and with the `map_from_odom` that
    makes `odom_pose` the measured pose. So `pose` stays the true one."""
    yaw_rate: float
    """The measured yaw rate [rad/s]."""
    pose_covariance: np.ndarray = _EXACT
    """Of x, y [m] and the heading [rad] in the frame of the odometry, (3, 3)."""
    twist_variances: Tuple[float, float] = (0.0, 0.0)
    """Of the speed [m^2/s^2] and of the yaw rate [rad^2/s^2]."""


class Odometer:
    """Measures the states of a car, in their order.

    The random errors depend on the seed, and on how many states since the car was placed show that
    it has moved. So they are the same in every drive in lock-step.
    """

    def __init__(self, car: Car) -> None:
        self._car = car
        gains = (car.speed_gain, car.steering_gain, car.steering_offset)
        self._is_exact = gains == (1.0, 1.0, 0.0) and not car.has_odom_noise
        self._last: Optional[State] = None
        self._number = 0
        self._pose = ORIGIN
        self._covariance = _EXACT

    def read(self, state: State) -> Odometry:
        """Return the odometry at a state, which is not before the last one."""
        car, last = self._car, self._last
        if self._is_exact:
            return Odometry(state, state.yaw_rate(car))
        self._last = state
        true_pose = state.odom_pose
        if last is None or (state.command is None and true_pose.is_close_to(ORIGIN, _ROUNDING)):
            self._pose, self._covariance, self._number = true_pose, _EXACT, 0
            return self._odometry(state, 0.0, 0.0, 0.0, 1.0)
        step = compose(inverse(last.odom_pose), true_pose)
        chord = math.copysign(math.hypot(step.x, step.y), step.x)
        seconds = (state.stamp - last.stamp) / NANOSECONDS
        if abs(chord) < _ROUNDING or seconds <= 0.0:
            return self._odometry(state, 0.0, 0.0, 0.0, 1.0)
        half = 0.5 * step.theta
        distance = chord * (half / math.sin(half) if half else 1.0)
        angle = self._commanded(math.atan(car.wheelbase * step.theta / distance))
        # Commands have numbers from 1 on, so these errors are independent of those of the commands.
        self._number += 1
        of_distance, of_heading = normals(car.seed, -self._number)
        root = math.sqrt(abs(distance))
        moved = distance / car.speed_gain + car.odom_distance_noise * root * of_distance
        turned = distance / car.speed_gain * curvature(angle, car.wheelbase)
        turned += car.odom_heading_noise * root * of_heading
        if state.map_from_odom != last.map_from_odom or state.drive_commands < last.drive_commands:
            self._number = 0  # the car has been placed; this step belongs to the drive before
        self._drive(moved, turned, abs(distance))
        return self._odometry(state, moved, turned, abs(distance), seconds)

    def _commanded(self, steering_angle: float) -> float:
        """Return a steering angle without the gain and the offset of the car [rad]."""
        angle = self._car.command_for(steering_angle)
        return max(-MAX_STEERING_ANGLE, min(angle, MAX_STEERING_ANGLE))

    def _drive(self, moved: float, turned: float, distance: float) -> None:
        """Advance the measured pose and its covariance by a step [m, rad, m]."""
        car, before = self._car, self._pose
        after = drive_arc(before, moved, turned / moved) if moved else before
        self._pose = after._replace(theta=before.theta + turned)
        east, north = after.x - before.x, after.y - before.y
        change = np.array([[1.0, 0.0, -north], [0.0, 1.0, east], [0.0, 0.0, 1.0]])
        ahead = np.array([math.cos(before.theta), math.sin(before.theta), 0.0])
        added = car.odom_distance_noise**2 * np.outer(ahead, ahead)
        added[2, 2] = car.odom_heading_noise**2
        self._covariance = change @ self._covariance @ change.T + distance * added

    def _odometry(
        self, state: State, moved: float, turned: float, distance: float, seconds: float
    ) -> Odometry:
        """Return the odometry after a measured step [m, rad, m, s]."""
        density = distance / seconds**2
        measured = state._replace(
            map_from_odom=compose(state.pose, inverse(self._pose)),
            speed=moved / seconds,
            steering_angle=self._commanded(state.steering_angle),
        )
        noise = self._car.odom_distance_noise, self._car.odom_heading_noise
        return Odometry(
            measured,
            turned / seconds,
            self._covariance,
            (density * noise[0] ** 2, density * noise[1] ** 2),
        )
