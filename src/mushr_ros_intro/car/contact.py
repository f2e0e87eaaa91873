"""Detect contact between the car and the walls."""

from typing import Optional

from mushr_ros_intro.car.model import Car, Piece
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.geometry import Pose, curvature, drive_arc
from mushr_ros_intro.world.footprint import World, free_distance, is_free

_NUDGE = 1e-7
"""How far a car that touches a wall is moved [m] to test whether the wall is in its path."""


def is_blocked(
    here: Piece, piece: Piece, direction: float, car: Car, world: Optional[World]
) -> bool:
    """Return whether the wall that the car touches is in the path of a piece.

    The position of the contact is exact to TOUCH only. If the car could drive on until the next
    hit, it would creep into the wall with each command.
    """
    if world is None or here.collision is None:
        return False
    bend = curvature(piece.steering_angle, car.wheelbase)
    return not is_free(*world, drive_arc(here.pose, direction * _NUDGE, bend))


def free_time(piece: Piece, seconds: float, car: Car, world: Optional[World]) -> float:
    """Return for how long the car can follow a piece before it hits a wall, at most `seconds`."""
    if world is None:
        return seconds
    speed = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))

    def at(distance: float) -> Pose:
        return follow(piece, distance / speed, car)

    distance = free_distance(*world, at, speed * seconds)
    return seconds if distance == speed * seconds else distance / speed
