"""Find out when a car touches a wall."""

from typing import NamedTuple, Optional

from mushr_ros_intro.car.bicycle import Pose, curvature, drive_arc
from mushr_ros_intro.car.model import Car, Piece
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.world.footprint import Footprint, free_way, is_free
from mushr_ros_intro.world.grid import Grid

_NUDGE = 1e-7
"""A car at a wall tries to drive this far [m] to find out whether the wall is in its way."""


class World(NamedTuple):
    """What the car may hit, and with what."""

    grid: Grid
    """The map."""
    footprint: Footprint = Footprint()
    """The car's body."""


def is_blocked(
    here: Piece, piece: Piece, direction: float, car: Car, world: Optional[World]
) -> bool:
    """Say whether the wall at which the car stands is in the way of a piece.

    The distance to the wall is known to TOUCH; if the car could go further it would creep.
    """
    if world is None or here.collision is None:
        return False
    bend = curvature(piece.steering_angle, car.wheelbase)
    return not is_free(*world, drive_arc(here.pose, direction * _NUDGE, bend))


def free_time(piece: Piece, seconds: float, car: Car, world: World) -> float:
    """Return for how long the car can follow a piece before it hits something, at most [s]."""
    speed = max(abs(piece.speed), abs(piece.speed + piece.acceleration * seconds))

    def at(way: float) -> Pose:
        return follow(piece, way / speed, car)[0]

    way = free_way(*world, at, speed * seconds)
    return seconds if way == speed * seconds else way / speed
