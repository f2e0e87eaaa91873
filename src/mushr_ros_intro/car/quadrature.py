"""Follow the path of a car on which speed and steering angle change at constant rates."""

import math
from typing import Tuple

from mushr_ros_intro.car.bicycle import Pose, curvature, drive_arc
from mushr_ros_intro.car.model import Car, Piece, Wheels, wheel_ratios

_LARGEST_STEP = 0.125
"""By how much at most [rad] things turn in a step of the quadrature.

Its error grows with the seventh power; along figure_8 it comes to some 1e-11 m.
"""

_MOST_STEPS = 1000
"""More steps than this the quadrature does not take, for angles next to a right angle."""

_ROOT = math.sqrt(15.0)

_NODES = (0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10)

_WEIGHTS = (5 / 18, 4 / 9, 5 / 18)

_TO_NODES = (
    (5 / 36, 2 / 9 - _ROOT / 15, 5 / 36 - _ROOT / 30),
    (5 / 36 + _ROOT / 24, 2 / 9, 5 / 36 - _ROOT / 24),
    (5 / 36 + _ROOT / 30, 2 / 9 + _ROOT / 15, 5 / 36),
)
"""Weights of the values at the nodes in the integral up to each node."""


def follow(piece: Piece, seconds: float, car: Car) -> Tuple[Pose, Wheels]:
    """Return the pose, and how far each wheel has turned [rad], some time into a piece."""
    if seconds == 0.0:
        return piece.pose, piece.wheel_angles
    if piece.steering_rate != 0.0 and (piece.speed != 0.0 or piece.acceleration != 0.0):
        return integrate(piece, seconds, car)
    distance = piece.speed * seconds + 0.5 * piece.acceleration * seconds * seconds
    if distance == 0.0:
        return piece.pose, piece.wheel_angles
    pose = drive_arc(piece.pose, distance, curvature(piece.steering_angle, car.wheelbase))
    ratios = wheel_ratios(piece.steering_angle, car)
    wheel_angles = Wheels(
        *(
            angle + distance * ratio / car.wheel_radius
            for angle, ratio in zip(piece.wheel_angles, ratios)
        )
    )
    return pose, wheel_angles


def integrate(piece: Piece, seconds: float, car: Car) -> Tuple[Pose, Wheels]:
    """Return the same as `follow`, where the steering angle changes on the way.

    The turn rate does not depend on the pose, so this is a matter of two integrals, one in the
    other. Both are taken at the three Gauss-Legendre points of each of many short steps
    (collocation, see Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I",
    section II.7).
    """
    fastest = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))
    end_angle = piece.steering_angle + piece.steering_rate * seconds
    bend = max(1.0, abs(math.tan(piece.steering_angle)), abs(math.tan(end_angle)))
    change = (fastest / car.wheelbase + abs(piece.steering_rate)) * bend * seconds  # about [rad]
    steps = max(1, min(_MOST_STEPS, math.ceil(change / _LARGEST_STEP)))
    step = seconds / steps
    x, y, theta = piece.pose
    ways = [0.0, 0.0, 0.0, 0.0]
    for number in range(steps):
        nodes = [(number + node) * step for node in _NODES]
        distances = [(piece.speed + piece.acceleration * node) * step for node in nodes]
        angles = [piece.steering_angle + piece.steering_rate * node for node in nodes]
        turns = [s * curvature(angle, car.wheelbase) for s, angle in zip(distances, angles)]
        for to_node, weight, distance, angle in zip(_TO_NODES, _WEIGHTS, distances, angles):
            heading = theta + sum(part * turn for part, turn in zip(to_node, turns))
            x += weight * distance * math.cos(heading)
            y += weight * distance * math.sin(heading)
            for wheel, ratio in enumerate(wheel_ratios(angle, car)):
                ways[wheel] += weight * distance * ratio
        theta += sum(weight * turn for weight, turn in zip(_WEIGHTS, turns))
    wheel_angles = Wheels(
        *(angle + way / car.wheel_radius for angle, way in zip(piece.wheel_angles, ways))
    )
    return Pose(x, y, theta), wheel_angles
