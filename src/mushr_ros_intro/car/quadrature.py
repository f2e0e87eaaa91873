"""Compute the path of a car whose speed and steering angle change at constant rates."""

import math

from mushr_ros_intro.car.model import Car, Piece
from mushr_ros_intro.geometry import Pose, curvature, drive_arc

_MAX_STEP = 0.125
"""The largest angle that the car or its front wheels turn in one step of the quadrature [rad].

The error of a step grows with its seventh power; along figure_8 it is about 1e-11 m.
"""

_MAX_STEPS = 1000
"""Limit of the number of steps, for steering angles close to a right angle."""

_ROOT = math.sqrt(15.0)

_NODES = (0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10)

_WEIGHTS = (5 / 18, 4 / 9, 5 / 18)

_TO_NODES = (
    (5 / 36, 2 / 9 - _ROOT / 15, 5 / 36 - _ROOT / 30),
    (5 / 36 + _ROOT / 24, 2 / 9, 5 / 36 - _ROOT / 24),
    (5 / 36 + _ROOT / 30, 2 / 9 + _ROOT / 15, 5 / 36),
)
"""Weights of the nodes in the integral up to each node."""


def follow(piece: Piece, seconds: float, car: Car) -> Pose:
    """Return the pose `seconds` after the beginning of a piece."""
    if seconds == 0.0:
        return piece.pose
    if piece.steering_rate != 0.0 and (piece.speed != 0.0 or piece.acceleration != 0.0):
        return _integrate(piece, seconds, car)
    distance = piece.speed * seconds + 0.5 * piece.acceleration * seconds * seconds
    if distance == 0.0:
        return piece.pose
    return drive_arc(piece.pose, distance, curvature(piece.steering_angle, car.wheelbase))


def _integrate(piece: Piece, seconds: float, car: Car) -> Pose:
    """Return the same as `follow` for a steering angle that changes.

    The yaw rate does not depend on the pose, so the pose is an integral over an integral. Each
    step evaluates both at its three Gauss-Legendre points (collocation, see Hairer, Norsett,
    Wanner, "Solving Ordinary Differential Equations I", section II.7).
    """
    fastest = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))
    end_angle = piece.steering_angle + piece.steering_rate * seconds
    bend = max(1.0, abs(math.tan(piece.steering_angle)), abs(math.tan(end_angle)))
    change = (fastest / car.wheelbase + abs(piece.steering_rate)) * bend * seconds  # about [rad]
    steps = max(1, min(_MAX_STEPS, math.ceil(change / _MAX_STEP)))
    step = seconds / steps
    x, y, theta = piece.pose
    for number in range(steps):
        nodes = [(number + node) * step for node in _NODES]
        distances = [(piece.speed + piece.acceleration * node) * step for node in nodes]
        angles = [piece.steering_angle + piece.steering_rate * node for node in nodes]
        turns = [s * curvature(angle, car.wheelbase) for s, angle in zip(distances, angles)]
        for to_node, weight, distance in zip(_TO_NODES, _WEIGHTS, distances):
            heading = theta + sum(part * turn for part, turn in zip(to_node, turns))
            x += weight * distance * math.cos(heading)
            y += weight * distance * math.sin(heading)
        theta += sum(weight * turn for weight, turn in zip(_WEIGHTS, turns))
    return Pose(x, y, theta)
