"""Check a plan, predict its drive, and publish the predicted path."""

import math
import os
from typing import NamedTuple, Optional, Sequence, Tuple

import rosgraph
import rospy
from nav_msgs.msg import OccupancyGrid, Path
from rospy.numpy_msg import numpy_msg

from mushr_ros_intro.car.model import Car, State
from mushr_ros_intro.car.profile import car_from, names_in, read_profile
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters, Values, choice, flag, number
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.plan import Fault, Plan, fault_lines
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview.limits import slowed
from mushr_ros_intro.preview.report import Report, check
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.ros.connections import is_published
from mushr_ros_intro.simulator.car_parameters import EXPECTS_MAP, simulated_car_parameters
from mushr_ros_intro.stamps import CONNECTION_TIMEOUT, NANOSECONDS
from mushr_ros_intro.wording import counted
from mushr_ros_intro.world.footprint import World
from mushr_ros_intro.world.grid import Grid


class Prediction(NamedTuple):
    """The predicted end of a drive."""

    pose: Pose
    """The final pose, in the map frame if the car is placed at the start pose."""
    rest: int
    """When the car comes to rest, counted from the first command [ns]."""
    distance: Optional[float]
    """The driven distance, forward and in reverse [m]; None if noise or a wall changes it."""
    is_placed: bool
    """Whether the car is placed at the start pose."""
    is_exact: bool
    """Whether the parameters of the car are known, and it has no noise."""


PREVIEW_PARAMETERS = (
    choice(
        "car",
        names_in(package_folder("config/cars")),
        None,
        "car of the check and prediction, a name in config/cars; empty: the simulated car",
    ),
    number("max_speed", math.inf, "m/s", 0.001, math.inf, "faster rows are slowed down"),
    flag("strict", False, "do not drive a plan that has faults"),
)
"""The parameters for the check and the prediction, of the node that drives a plan."""


class Preview:
    """The check and the prediction of a plan before the drive.

    Publishes ``/CAR_NAME/predicted_path`` (nav_msgs/Path), latched.
    """

    def __init__(self, plan: Plan, values: Values, car_name: str, is_placed: bool) -> None:
        """Advertise the topics, and limit the speeds of the plan.

        Args:
            plan: the plan.
            values: of PREVIEW_PARAMETERS.
            car_name: the name of the car.
            is_placed: whether the car is placed at the start pose.

        Raises:
            UserError: the profile of the car cannot be read.
        """
        rospy.loginfo(
            "plan %s: %s, %g s, %.2f m",
            plan.path,
            counted(len(plan.rows), "row"),
            plan.duration / NANOSECONDS,
            prediction.length(plan),
        )
        self._car_name = car_name
        self._is_placed = is_placed
        self._is_strict = values["strict"]
        self._profile: Optional[Parameters] = None
        self._profile_name = values["car"] or "car"
        if values["car"]:
            path = os.path.join(package_folder("config/cars"), f"{values['car']}.yaml")
            self._profile = Parameters(read_profile(path), "~car: ")
        self.plan, changes = slowed(plan, values["max_speed"])
        """The plan with its speeds limited to ~max_speed."""
        _warn(changes)
        self._pub_path = rospy.Publisher(
            f"/{car_name}/predicted_path", Path, queue_size=1, latch=True
        )

    def show(self) -> Prediction:
        """Check the plan, log its faults, publish the predicted path, and return the prediction.

        Raises:
            UserError: ~strict is set and the plan has faults or walls cannot be checked, or a
                parameter of the car is invalid.
        """
        simulated = simulated_car_parameters(self._car_name, must_run=True)
        profile = self._profile or simulated
        car = car_from(profile)
        grid = read_walls(simulated, self._is_placed, self._is_strict)
        report, states = predict(self.plan, self._profile_name, car, grid)
        if report.faults and self._is_strict:
            faults = "\n".join(fault_lines(report.faults))
            raise UserError(f"~strict is set and the plan has faults; it is not driven\n{faults}")
        _warn(report.faults)
        self._pub_path.publish(conversions.path_to_msg(states, ros_time.now()))
        return Prediction(
            states[-1].pose,
            states[-1].stamp,
            report.length if states is report.states else None,
            is_placed=self._is_placed,
            is_exact=bool(profile) and not car.has_command_noise,
        )


def predict(
    plan: Plan, car_name: str, car: Car, grid: Optional[Grid]
) -> Tuple[Report, Sequence[State]]:
    """Return the check of a plan, and the predicted states from the first command to the rest.

    The check ignores noise, and ends at the first wall. The prediction contains the noise, which
    depends on the seed only, and what the car does after it has hit a wall.

    Args:
        plan: the plan.
        car_name: the name of the car in messages.
        car: the car.
        grid: the map, or None.
    """
    report = check(plan, car_name, car, grid=grid)
    if not report.collision and not car.has_command_noise:
        return report, report.states
    world = World(grid) if grid and report.collision else None
    return report, tuple(prediction.trajectory(plan, car, world))


def read_walls(simulated: Parameters, is_placed: bool, is_strict: bool) -> Optional[Grid]:
    """Return the map on /map; None, with a message in the log, if walls cannot be checked.

    Args:
        simulated: the parameters of the simulated car; empty if none runs.
        is_placed: whether the car is placed at the start pose.
        is_strict: whether to refuse a plan whose faults are not known.

    Raises:
        UserError: walls cannot be checked, there may be some, and `is_strict` is set.
    """
    problem = "the car is not placed at the start pose of the plan"
    expects_map = simulated.get(EXPECTS_MAP)
    if is_placed:
        try:
            return receive_map(expects_map)
        except UserError as error:
            problem = str(error)
    may_have_walls = expects_map if simulated else is_placed
    if may_have_walls and is_strict:
        raise UserError(
            f"~strict is set, but walls cannot be checked: {problem}; the plan is not driven"
        )
    log = rospy.logwarn if may_have_walls else rospy.loginfo
    log("walls are not checked: %s", problem)
    return None


def receive_map(is_expected: bool) -> Grid:
    """Return the map on /map.

    Args:
        is_expected: whether to wait for a node that publishes one; perhaps it starts with the car.

    Raises:
        UserError: no node publishes one that can be read.
    """
    topic = rospy.resolve_name("/map")
    try:
        if is_expected or is_published(topic):
            msg = rospy.wait_for_message(topic, numpy_msg(OccupancyGrid), CONNECTION_TIMEOUT)
            return conversions.grid_from_msg(msg)
    except rospy.ROSInterruptException:
        raise
    except (rospy.ROSException, rosgraph.MasterException, conversions.MessageError) as error:
        if is_published(topic):
            raise UserError(f"the map on {topic} cannot be read: {error}") from None
    raise UserError(f"no node publishes a map on {topic}; map_server.py does")


def _warn(faults: Sequence[Fault]) -> None:
    """Log a bounded number of faults as warnings."""
    for line in fault_lines(faults):
        rospy.logwarn("%s", line)
