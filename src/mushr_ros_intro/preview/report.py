"""Check a plan before it is driven, and report what it does.

All values come from the kinematics of the simulated car. Poses are those of base_footprint, the
middle of the rear axle on the ground, in the map frame. A drive that hits a wall ends there.
"""

from typing import Iterable, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.car.model import Car, Contact, State
from mushr_ros_intro.car.motion import advance
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Fault, Plan
from mushr_ros_intro.preview.limits import Step, limit_faults, ramp_faults
from mushr_ros_intro.preview.prediction import Leg, legs_of, sampled
from mushr_ros_intro.preview.walls import map_fault
from mushr_ros_intro.world.footprint import BODY, Footprint
from mushr_ros_intro.world.grid import Grid


class Report(NamedTuple):
    """The result of a check."""

    plan: Plan
    car_name: str
    car: Car
    map_name: str
    """The map that the plan was checked against, or an empty text."""
    steps: Tuple[Step, ...]
    """The motion during each row that is driven, and during the stop after the last row."""
    states: Tuple[State, ...]
    """The states of the car along the drive; see `prediction.sampled`. The last one is at rest, or
    at the wall."""
    faults: Tuple[Fault, ...]
    collision: Optional[Contact]
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
    def box(self) -> Tuple[float, float, float, float]:
        """Smallest and largest x, smallest and largest y of the path [m]."""
        x, y, _ = zip(*(state.pose for state in self.states))
        return min(x), max(x), min(y), max(y)

    @property
    def final_pose(self) -> Pose:
        """The pose at which the car comes to rest."""
        return self.steps[-1].pose


def check(
    plan: Plan,
    car_name: str,
    car: Car,
    map_name: str = "",
    grid: Optional[Grid] = None,
    footprint: Footprint = BODY,
) -> Report:
    """Check a plan against the limits of a car without its noise, and against a map, if any.

    The plan is simulated once. The names of car and map are for messages; walls stop the footprint.
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    legs = list(legs_of(plan, car))
    steps = _steps(legs, car)
    faults = [*limit_faults(plan, car_name, car), *ramp_faults(plan, steps, car_name, car)]
    collision = None
    if grid is not None:
        fault, collision = map_fault(plan, legs, car, grid, footprint)
        faults += [fault] if fault else []
    if collision is not None:
        last = next(index for index, leg in enumerate(legs) if leg.end >= collision.stamp)
        legs[last:] = [legs[last]._replace(end=collision.stamp)]
        steps = _steps(legs, car)
    states = tuple(sampled(legs, car, steps[-1].end))
    faults.sort(key=lambda fault: (fault.line, fault.column))
    return Report(plan, car_name, car, map_name, steps, states, tuple(faults), collision)


def _steps(legs: Iterable[Leg], car: Car) -> Tuple[Step, ...]:
    steps: List[Step] = []
    for leg in legs:
        state = leg.state
        if leg.row == len(steps):  # otherwise it is a repeated command of the same row
            begin = Step(state.stamp, 0, state.speed, state.steering_angle, 0.0, state.pose)
            steps.append(begin)
        distance = steps[-1].distance
        for piece, seconds in leg.pieces():
            distance += abs(piece.speed + 0.5 * piece.acceleration * seconds) * seconds
        steps[-1] = steps[-1]._replace(
            end=leg.end,
            distance=distance,
            pose=advance(state, leg.end, car).pose,
        )
    return tuple(steps)
