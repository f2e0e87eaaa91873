"""Check a plan against the walls and the edges of a map."""

import math
from typing import Iterable, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.contact import free_time
from mushr_ros_intro.car.model import Car, Contact
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.geometry import Pose, compose, curvature
from mushr_ros_intro.plan.plan import Fault, Plan
from mushr_ros_intro.preview.prediction import Leg
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import BODY, Footprint, World, is_free, on_map
from mushr_ros_intro.world.grid import Grid

LEAVES = "leaves the map"
_MARGIN = 1e-6
"""The car is at the edge of the map if a body that is larger by this [m] is not on the map."""


def map_fault(
    plan: Plan, legs: Iterable[Leg], car: Car, grid: Grid, footprint: Footprint = BODY
) -> Tuple[Optional[Fault], Optional[Contact]]:
    """Return the first fault of a plan on a map, and the contact if the car hits a wall.

    Args:
        plan: the plan.
        legs: its legs, without walls.
        car: the parameters of the car.
        grid: the map.
        footprint: what walls stop.
    """
    if text := start_fault(grid, plan.start, footprint):
        return plan.fault(-1, 0, text), None
    world = World(with_fence(grid), footprint)
    for leg in legs:
        for piece, seconds in leg.pieces():
            yaw_rate = abs(piece.speed * curvature(piece.steering_angle, car.wheelbase))
            if yaw_rate and not (piece.acceleration or piece.steering_rate):
                seconds = min(seconds, math.tau / yaw_rate)  # a second circle has no new points
            free = free_time(piece, seconds, car, world) if piece.direction else seconds
            if free == seconds:
                continue
            pose = follow(piece, free, car)
            now = leg.state.stamp + round((piece.begin + free) * NANOSECONDS)
            x, y = (round(each, 1) + 0.0 for each in pose[:2])  # no negative zero
            where = f"at t = {now / NANOSECONDS:.1f} s, ({x}, {y})"
            is_rolling = leg.row == len(plan.rows)
            name = "the car, rolling on after the last row," if is_rolling else "the car"
            if (what := fault_at(grid, pose, footprint)) == LEAVES:
                return plan.fault(leg.row, 0, f"{name} {what} {where}"), None
            fault = plan.fault(leg.row, 0, f"{name} {what} {where}; it stops there")
            return fault, Contact(now, pose)
    return None, None


def start_fault(grid: Grid, pose: Pose, footprint: Footprint = BODY) -> str:
    """Return why the car cannot start at a pose; "" if it can."""
    if not on_map(grid, footprint, pose):
        return "the start pose is off the map, at least in part"
    if not is_free(grid, footprint, pose):
        return "the start pose is in a wall, at least in part"
    return ""


def with_fence(grid: Grid) -> Grid:
    """Return a map with a wall around it, at which the car leaves the map."""
    corner = compose(grid.origin, Pose(-grid.resolution, -grid.resolution, 0.0))
    return Grid(np.pad(grid.cells, 1, constant_values=100), grid.resolution, corner)


def fault_at(grid: Grid, pose: Pose, footprint: Footprint = BODY) -> str:
    """Return what happens at a pose at which a wall of a map with a fence stops the car."""
    grown = Footprint(*(each + _MARGIN for each in footprint))
    return "hits a wall" if on_map(grid, grown, pose) else LEAVES
