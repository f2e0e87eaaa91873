"""Check a plan against the walls and the edges of a map."""

import math
from typing import Iterator, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, compose, curvature
from mushr_ros_intro.car.contact import World, free_time
from mushr_ros_intro.car.model import Car, Contact, Piece
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.plan.model import Fault, Plan
from mushr_ros_intro.preview.prediction import Leg, drive
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, is_free, on_map
from mushr_ros_intro.world.grid import Grid

_MARGIN = 1e-6
"""The car is at the edge of the map if a body that is larger by this [m] is not on the map."""


def drive_to(hit: Optional[Contact], plan: Plan, car: Car) -> Iterator[Leg]:
    """Yield the legs of a plan without walls; if there is a hit, the last leg ends there."""
    for leg in drive(plan, car):
        if hit is not None and leg.end >= hit.stamp:
            yield leg._replace(end=hit.stamp)
            return
        yield leg


def map_fault(
    plan: Plan, car: Car, grid: Grid, footprint: Footprint
) -> Tuple[Optional[Fault], Optional[Contact]]:
    """Return the first fault of a plan on a map, and the hit if the fault is a wall on the way.

    The car is driven until it touches a wall or an edge of the map.
    """
    if not on_map(grid, footprint, plan.start):
        return plan.fault(-1, 0, "the start pose is off the map, at least in part"), None
    if not is_free(grid, footprint, plan.start):
        return plan.fault(-1, 0, "the start pose is in a wall, at least in part"), None
    world = World(_fenced(grid), footprint)
    diagonal = math.hypot(grid.width, grid.height) * grid.resolution
    for leg in drive(plan, car):
        for piece, seconds in leg.pieces(leg.end):
            if piece.speed == 0.0 == piece.acceleration:
                continue
            seconds = _until_repeated(piece, seconds, car, diagonal)
            free = free_time(piece, seconds, car, world)
            if free == seconds:
                continue
            pose = follow(piece, free, car)[0]
            grown = Footprint(*(each + _MARGIN for each in footprint))
            is_wall = on_map(grid, grown, pose)
            is_rolling = leg.row == len(plan.rows)
            name = "the car, rolling on after the last row," if is_rolling else f"row {leg.row + 1}"
            now = leg.state.moved + round((piece.begin + free) * NANOSECONDS)
            text = (
                f"{name} {'hits a wall' if is_wall else 'leaves the map'} "
                f"at t = {now / NANOSECONDS:.1f} s, "
                f"({round(pose.x, 1) + 0.0}, {round(pose.y, 1) + 0.0})"  # no negative zero
            )
            text += "; it stops there" if is_wall else ""
            return plan.fault(leg.row, 0, text), Contact(now, pose) if is_wall else None
    return None, None


def _until_repeated(piece: Piece, seconds: float, car: Car, diagonal: float) -> float:
    """Return how long the car takes to pass every point of a piece [s].

    That is `seconds`, the duration of the piece, or less at a constant speed and steering angle:
    the time for a full circle, or for the longest arc on a map with this diagonal [m].
    """
    if piece.acceleration or piece.steering_rate:
        return seconds
    bend = abs(curvature(piece.steering_angle, car.wheelbase))
    radius = min(1.0 / bend, diagonal) if bend else diagonal
    return min(seconds, math.tau * radius / abs(piece.speed))


def _fenced(grid: Grid) -> Grid:
    """Return a map with walls around it, one cell thick."""
    cells = np.pad(grid.cells, 1, constant_values=100)
    corner = Pose(-grid.resolution, -grid.resolution, 0.0)
    return Grid(cells, grid.resolution, compose(grid.origin, corner))
