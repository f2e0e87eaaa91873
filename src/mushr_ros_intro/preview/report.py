"""Check a plan before it is driven, and report what it does.

All values come from the kinematics of the simulated car. Poses are those of base_footprint, the
middle of the rear axle on the ground, in the map frame. A drive that hits a wall ends there.
"""

import math
from typing import Iterable, List, NamedTuple, Optional, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, curvature
from mushr_ros_intro.car.model import Car, Contact, Piece
from mushr_ros_intro.car.motion import advance
from mushr_ros_intro.plan.model import Fault, Plan
from mushr_ros_intro.preview.limits import Step, limit_faults, ramp_faults
from mushr_ros_intro.preview.prediction import Leg, drive, sampled
from mushr_ros_intro.preview.walls import drive_to, map_fault
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint
from mushr_ros_intro.world.grid import Grid

_SAMPLE_PERIOD = NANOSECONDS // 100
"""Period of the samples for the bounding box [ns]: to 0.1 mm at 2 m/s on a radius of 0.5 m."""

_MAX_SAMPLES = 20_000
"""The samples of a longer drive are further apart."""


class Report(NamedTuple):
    """The result of a check."""

    plan: Plan
    car_name: str
    car: Car
    map_name: str
    """The map that the plan was checked against, or an empty text."""
    steps: Tuple[Step, ...]
    """The motion during each row that is driven, and during the stop after the last row."""
    box: Tuple[float, float, float, float]
    """Smallest and largest x, smallest and largest y of the path [m]."""
    radius: float
    """The smallest turning radius of the path [m]; infinite if the car only drives straight."""
    faults: Tuple[Fault, ...]
    hit: Optional[Contact]
    """The contact with a wall that ends the drive, or None."""

    @property
    def rest(self) -> int:
        """The time from the first command until the car is at rest, or hits a wall [ns]."""
        return self.steps[-1].end

    @property
    def length(self) -> float:
        """The distance driven, forward and in reverse, until the car is at rest [m]."""
        return sum(step.distance for step in self.steps)

    @property
    def final_pose(self) -> Pose:
        """The pose at which the car comes to rest."""
        return self.steps[-1].pose

    @property
    def closing_gap(self) -> Tuple[float, float]:
        """The distance [m] and the signed angle [rad] from the start pose to the final pose."""
        start, end = self.plan.start, self.final_pose
        return start.distance_to(end), math.remainder(end.theta - start.theta, math.tau)


def check(
    plan: Plan,
    car_name: str,
    car: Car,
    map_name: str = "",
    grid: Optional[Grid] = None,
    footprint: Footprint = Footprint(),  # noqa: B008, it is immutable
) -> Report:
    """Check a plan against the limits of a car without its noise, and against a map, if any.

    The names of car and map are for messages.
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    steps, radius = _driven(drive(plan, car), car)
    faults = [*limit_faults(plan, car_name, car), *ramp_faults(plan, steps, car_name, car)]
    hit = None
    if grid is not None:
        fault, hit = map_fault(plan, car, grid, footprint)
        faults += [fault] if fault else []
    if hit is not None:
        steps, radius = _driven(drive_to(hit, plan, car), car)
    box = _box(drive_to(hit, plan, car), car, steps[-1].end)
    faults.sort(key=lambda fault: (fault.line, fault.column))
    return Report(plan, car_name, car, map_name, steps, box, radius, tuple(faults), hit)


def _driven(legs: Iterable[Leg], car: Car) -> Tuple[Tuple[Step, ...], float]:
    """Return the steps of a drive and its smallest turning radius [m]."""
    steps: List[Step] = []
    bend = 0.0
    for leg in legs:
        state, pose = leg.state, advance(leg.state, leg.end, car).pose
        step = Step(state.stamp, leg.end, state.speed, state.steering_angle, 0.0, pose)
        if leg.row < len(steps):  # a repeated command of the same row
            step = steps.pop()._replace(end=leg.end, pose=pose)
        steps.append(step._replace(distance=step.distance + leg.distance(leg.end)))
        for piece, seconds in leg.pieces(leg.end):
            if piece.speed or piece.acceleration:
                bend = max(bend, _tightest_bend(piece, seconds, car))
    return tuple(steps), 1.0 / bend if bend else math.inf


def _box(legs: Iterable[Leg], car: Car, rest: int) -> Tuple[float, float, float, float]:
    """Return the bounding box of a drive that takes `rest` [ns], from samples of its path [m]."""
    period = max(_SAMPLE_PERIOD, rest // _MAX_SAMPLES)
    poses = np.array([state.pose for state in sampled(legs, car, period)])
    (left, bottom, _), (right, top, _) = poses.min(axis=0).tolist(), poses.max(axis=0).tolist()
    return left, right, bottom, top


def _tightest_bend(piece: Piece, seconds: float, car: Car) -> float:
    """Return the largest curvature on a piece of motion, left or right [1/m]."""
    end_angle = piece.steering_angle + piece.steering_rate * seconds
    return max(abs(curvature(angle, car.wheelbase)) for angle in (piece.steering_angle, end_angle))
