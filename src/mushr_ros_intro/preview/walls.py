"""Check a plan against the walls and the edges of a map."""

import math
from typing import Any, Dict, Iterable, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.contact import free_time
from mushr_ros_intro.car.model import Car, Contact
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.car.quadrature import follow
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose, compose, curvature
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.plan.plan import Fault, Plan
from mushr_ros_intro.preview.prediction import Leg, legs_of
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, World, is_free, on_map
from mushr_ros_intro.world.grid import Grid

_MARGIN = 1e-6
"""The car is at the edge of the map if a body that is larger by this [m] is not on the map."""


def map_fault(
    plan: Plan, legs: Iterable[Leg], car: Car, grid: Grid
) -> Tuple[Optional[Fault], Optional[Contact]]:
    """Return the first fault of a plan on a map, and the contact if the car hits a wall.

    Args:
        plan: the plan.
        legs: its legs, without walls.
        car: the parameters of the car.
        grid: the map.
    """
    if not on_map(grid, Footprint(), plan.start):
        return plan.fault(-1, 0, "the start pose is off the map, at least in part"), None
    if not is_free(grid, Footprint(), plan.start):
        return plan.fault(-1, 0, "the start pose is in a wall, at least in part"), None
    corner = compose(grid.origin, Pose(-grid.resolution, -grid.resolution, 0.0))
    fenced = Grid(np.pad(grid.cells, 1, constant_values=100), grid.resolution, corner)
    for leg in legs:
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
            name = "the car, rolling on after the last row," if is_rolling else "the car"
            grown = Footprint(*(each + _MARGIN for each in Footprint()))
            if not on_map(grid, grown, pose):
                return plan.fault(leg.row, 0, f"{name} leaves the map {where}"), None
            text = f"{name} hits a wall {where}; it stops there"
            return plan.fault(leg.row, 0, text), Contact(now, pose)
    return None, None


def refuse_walls(plans: Iterable[Plan], parameters: Dict[str, Any], grid: Optional[Grid]) -> None:
    """Refuse plans that no node can drive.

    Args:
        plans: the plans.
        parameters: of the simulated car; its noise does not count.
        grid: the map, or None.

    Raises:
        UserError: a plan hits a wall, or leaves the map.
    """
    car = car_from(Parameters({**parameters, "noise": False}))
    for plan in plans if grid is not None else ():
        fault, _ = map_fault(plan, legs_of(plan, car), car, grid)  # type: ignore[arg-type]
        if fault:
            raise UserError(f"{fault}. No node can pass; expected another plan, or another --map")
