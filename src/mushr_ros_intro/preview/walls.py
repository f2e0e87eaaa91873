"""Check a plan against the walls and the edges of a map."""

import math
from typing import Iterator, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.contact import free_time
from mushr_ros_intro.car.model import Car, Contact
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.geometry import Pose, compose, curvature
from mushr_ros_intro.plan.plan import Fault, Plan
from mushr_ros_intro.preview.prediction import Leg, drive
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, World, is_free, on_map
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


def map_fault(plan: Plan, car: Car, grid: Grid) -> Tuple[Optional[Fault], Optional[Contact]]:
    """Return the first fault of a plan on a map, and the hit if the fault is a wall on the way.

    The car is driven until it touches a wall or an edge of the map.
    """
    if not on_map(grid, Footprint(), plan.start):
        return plan.fault(-1, 0, "the start pose is off the map, at least in part"), None
    if not is_free(grid, Footprint(), plan.start):
        return plan.fault(-1, 0, "the start pose is in a wall, at least in part"), None
    corner = compose(grid.origin, Pose(-grid.resolution, -grid.resolution, 0.0))
    fenced = Grid(np.pad(grid.cells, 1, constant_values=100), grid.resolution, corner)
    for leg in drive(plan, car):
        for piece, seconds in leg.pieces():
            turn_rate = abs(piece.speed * curvature(piece.steering_angle, car.wheelbase))
            if turn_rate and not (piece.acceleration or piece.steering_rate):
                seconds = min(seconds, math.tau / turn_rate)  # a second circle has no new points
            free = free_time(piece, seconds, car, World(fenced)) if piece.direction else seconds
            if free == seconds:
                continue
            pose = follow(piece, free, car)
            now = leg.state.stamp + round((piece.begin + free) * NANOSECONDS)
            x, y = (round(each, 1) + 0.0 for each in pose[:2])  # no negative zero
            where = f"at t = {now / NANOSECONDS:.1f} s, ({x}, {y})"
            is_rolling = leg.row == len(plan.rows)
            name = "the car, rolling on after the last row," if is_rolling else f"row {leg.row + 1}"
            grown = Footprint(*(each + _MARGIN for each in Footprint()))
            if not on_map(grid, grown, pose):
                return plan.fault(leg.row, 0, f"{name} leaves the map {where}"), None
            text = f"{name} hits a wall {where}; it stops there"
            return plan.fault(leg.row, 0, text), Contact(now, pose)
    return None, None
