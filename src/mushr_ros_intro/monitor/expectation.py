"""Check the plan of a drive, and predict the drive."""

import math
import os
from typing import Any, Optional, Sequence, Tuple

import rospy
from nav_msgs.msg import OccupancyGrid, Path
from rospy.numpy_msg import numpy_msg

from mushr_ros_intro.car.model import Car, State
from mushr_ros_intro.car.profile import car_from, read_profile
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.monitor.drive import Expectation
from mushr_ros_intro.monitor.senders import Sender, plan_of
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.plan import Plan, fault_lines
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview.limits import slowed
from mushr_ros_intro.preview.report import Report, check
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.ros.connections import is_published
from mushr_ros_intro.simulator.car_parameters import (
    COLLISION,
    EXPECTS_MAP,
    FOOTPRINTS,
    simulated_car_parameters,
)
from mushr_ros_intro.stamps import CONNECTION_TIMEOUT, NANOSECONDS
from mushr_ros_intro.wording import counted
from mushr_ros_intro.world.footprint import BODY, Footprint, World
from mushr_ros_intro.world.grid import Grid


class Expectations:
    """What is expected of the drives of a car; it is shown on /CAR_NAME/predicted_path.

    Args:
        car_name: the name of the car.
        profile: the name of its profile in config/cars; None: the simulated car.
        plan: the plan of all drives; None: that of the node.
    """

    def __init__(self, car_name: str, profile: Optional[str], plan: Optional[Plan]) -> None:
        self._car_name, self._profile, self._plan = car_name, profile, plan
        self._key: Any = None
        self._latest: Optional[Expectation] = None
        self._problem = ""
        self._publisher = rospy.Publisher(
            f"/{car_name}/predicted_path", Path, queue_size=1, latch=True
        )

    def of(self, sender: Optional[Sender]) -> Tuple[Optional[Expectation], str]:
        """Check, predict and show the drive of a node.

        The check and the prediction are logged, unless they are the same as last time.

        Returns:
            What is expected; or None, and the reason.
        """
        name = sender.name if sender else "an unknown node"
        try:
            plan = self._plan or (plan_of(sender) if sender else None)
            if plan is None:
                return None, f"{name} has no parameter ~plan_file"
            is_placed = sender is None or sender.places_car
            max_speed = sender.max_speed if sender else math.inf
            car = rospy.get_param(f"/{self._car_name}/car_sim", {})
            key = name, plan, is_placed, max_speed, car
            if self._latest is None or key != self._key:
                size = f"{counted(len(plan.rows), 'row')}, {plan.duration / NANOSECONDS:g} s"
                distance = prediction.length(plan)
                rospy.loginfo("the plan of %s: %s, %s, %.2f m", name, plan.path, size, distance)
                self._key = key
                self._latest = self._foresee(plan, is_placed, max_speed)
        except (UserError, OSError) as error:
            problem = f"the plan of {name} cannot be driven or predicted"
            if f"{problem}: {error}" != self._problem:
                self._problem = f"{problem}: {error}"
                rospy.logerr("%s", self._problem)
            return None, problem
        self._publisher.publish(conversions.path_to_msg(self._latest.states, ros_time.now()))
        return self._latest, ""

    def _foresee(self, plan: Plan, is_placed: bool, max_speed: float) -> Expectation:
        """Check a plan, predict its drive, and log its faults.

        Args:
            plan: the plan.
            is_placed: whether the node places the car at the start pose.
            max_speed: the node slows faster rows down to it [m/s].

        Raises:
            UserError: the profile cannot be read, or a parameter of the car is invalid.
        """
        slow_plan, changes = slowed(plan, max_speed)
        simulated = simulated_car_parameters(self._car_name, must_run=True)
        parameters = simulated
        if self._profile:
            path = os.path.join(package_folder("config/cars"), f"{self._profile}.yaml")
            parameters = Parameters(read_profile(path), "~car: ")
        car = car_from(parameters)
        grid = read_walls(simulated.get(EXPECTS_MAP), is_placed)
        footprint = FOOTPRINTS[simulated.get(COLLISION)]
        report, states = predict(slow_plan, self._profile or "car", car, grid, footprint)
        for line in fault_lines([*changes, *report.faults]):
            rospy.logwarn("%s", line)
        distance = report.length if states is report.states else None
        is_exact = bool(parameters) and not car.has_command_noise
        return Expectation(slow_plan, states, distance, is_placed, is_exact)


def predict(
    plan: Plan,
    car_name: str,
    car: Car,
    grid: Optional[Grid],
    footprint: Footprint = BODY,
) -> Tuple[Report, Sequence[State]]:
    """Return the check of a plan, and the predicted states from the first command to the rest.

    The check ignores noise, and ends at the first wall. The prediction contains the noise, which
    depends on the seed only, and what the car does after it has hit a wall.

    Args:
        plan: the plan.
        car_name: the name of the car in messages.
        car: the car.
        grid: the map, or None.
        footprint: what walls stop.
    """
    report = check(plan, car_name, car, grid=grid, footprint=footprint)
    if not report.collision and not car.has_command_noise:
        return report, report.states
    world = World(grid, footprint) if grid and report.collision else None
    return report, tuple(prediction.trajectory(plan, car, world))


def read_walls(expects_map: bool, is_placed: bool) -> Optional[Grid]:
    """Return the map on /map; None, with a message in the log, if walls cannot be checked.

    Args:
        expects_map: whether the simulated car has a map, whose node perhaps starts with the car.
        is_placed: whether the car is placed at the start pose.
    """
    topic = rospy.resolve_name("/map")
    problem = f"no node publishes a map on {topic}; map_server.py does"
    if not is_placed:
        problem = "the car is not placed at the start pose of the plan"
    elif expects_map or is_published(topic):
        try:
            msg = rospy.wait_for_message(topic, numpy_msg(OccupancyGrid), CONNECTION_TIMEOUT)
            return conversions.grid_from_msg(msg)
        except rospy.ROSInterruptException:
            raise
        except (rospy.ROSException, conversions.MessageError) as error:
            problem = f"the map on {topic} cannot be read: {error}"
    (rospy.logwarn if expects_map else rospy.loginfo)("walls are not checked: %s", problem)
    return None
