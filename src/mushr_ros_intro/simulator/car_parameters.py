"""The parameters that several nodes of a simulated car have, or that other nodes read."""

import sys

import rosgraph
import rospy

from mushr_ros_intro.parameters import Parameter, Parameters, choice, flag
from mushr_ros_intro.ros.connections import is_alive
from mushr_ros_intro.world.footprint import BODY, POINT

EXPECTS_MAP = flag("expects_map", False, "the car is ready only when it has received a map")
FOOTPRINTS = {"body": BODY, "point": POINT}
COLLISION = choice(
    "collision",
    tuple(FOOTPRINTS),
    "body",
    "what walls stop: the car's body, or the point at its rear axle",
)
FRAME_PREFIX = Parameter(
    "frame_prefix",
    lambda _: rosgraph.names.get_ros_namespace(argv=sys.argv).lstrip("/"),
    "text",
    str,
    "precedes the names of the frames; by default CAR_NAME/",
)
"""Of the car in the node's namespace; it may be empty."""


def simulated_car_parameters(car_name: str, must_run: bool = False) -> Parameters:
    """Return the parameters of a simulated car; they are empty if it has never been started.

    With `must_run`, they are also empty if the car has ended: its parameters remain at the master.
    A node that starts together with the car does not set it, because the car may not run yet.

    Raises:
        OSError: the master does not answer.
    """
    name = f"/{car_name}/car_sim"
    is_valid = not must_run or is_alive(name)
    return Parameters(rospy.get_param(name, {}) if is_valid else {}, f"{name}/")
