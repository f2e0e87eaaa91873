"""Read the parameters of a car from a profile in config/cars/, or from a node's parameters."""

import math
import os
from typing import Any, Dict, List, Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters, Values, flag, integer, number
from mushr_ros_intro.paths import find_file
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.wording import similar
from mushr_ros_intro.yaml_file import read_mapping

NUMBERS = (
    ("wheelbase", "m", 0.01, 100.0, "distance between the axles"),
    ("track", "m", 0.01, 100.0, "distance between the left and the right wheels"),
    ("wheel_radius", "m", 0.001, 10.0, "radius of the wheels"),
    ("speed_limit", "m/s", 0.001, math.inf, "highest speed, forward and in reverse"),
    ("steering_limit_left", "rad", 0.0, math.inf, "largest steering angle to the left"),
    ("steering_limit_right", "rad", 0.0, math.inf, "the same to the right, positive, too"),
    ("acceleration", "m/s^2", 0.01, math.inf, "highest rate of change of the speed"),
    ("steering_rate", "rad/s", 0.01, math.inf, "highest rate of change of the steering angle"),
    ("speed_gain", "", 0.1, 10.0, "driven speed, relative to the command"),
    ("steering_gain", "", 0.1, 10.0, "driven steering angle, relative to the command"),
    ("steering_offset", "rad", -0.5, 0.5, "added to the steering angle of each command"),
    ("speed_noise", "m/s", 0.0, 10.0, "standard deviation per command"),
    ("steering_noise", "rad", 0.0, 1.0, "standard deviation per command"),
    ("speed_gain_spread", "", 0.0, 1.0, "standard deviation of the gain between drives"),
    ("steering_offset_spread", "rad", 0.0, 1.0, "the same of the offset"),
    ("odom_distance_noise", "m", 0.0, 10.0, "standard deviation of the odometry after 1 m"),
    ("odom_heading_noise", "rad", 0.0, 10.0, "standard deviation of the odometry after 1 m"),
)
"""The numbers of a car: name, unit, range, and meaning."""

_IDEAL = Car()

CAR_PARAMETERS = (
    flag("noise", False, "add random errors to the commands and to the odometry"),
    *(number(each[0], getattr(_IDEAL, each[0]), *each[1:]) for each in NUMBERS),
    number(
        "command_timeout",
        _IDEAL.command_timeout / NANOSECONDS,
        "s",
        0.001,
        10.0,
        "how long a command is valid after its stamp",
    ),
    integer("seed", _IDEAL.seed, 0, 1e9, "of the errors; the same seed gives the same errors"),
)
"""The parameters of a car; the defaults are those of the ideal car."""


def names_in(folder: str) -> List[str]:
    """Return the names of the profiles in a folder, sorted."""
    return sorted(each[:-5] for each in os.listdir(folder) if each.endswith(".yaml"))


def read_profile(path: str) -> Dict[str, Any]:
    """Return the parameters in the file of a profile.

    Raises:
        UserError: the file cannot be read, or is not a mapping.
    """
    return read_mapping(path, "parameters such as 'track: 0.25'")


def read_parameters(name: str, config: str) -> Dict[str, Any]:
    """Return the parameters of the simulated car with a profile, without noise.

    Args:
        name: of the profile.
        config: the folder of car_sim.yaml and cars/.

    Raises:
        UserError: there is no such profile, or it is wrong.
    """
    names = names_in(os.path.join(config, "cars"))
    if name not in names:
        close = similar(name, names)
        raise UserError(f"car is '{name}'; expected one of {', '.join(names)}{close}")
    parameters = {
        **read_profile(os.path.join(config, "car_sim.yaml")),
        **read_profile(os.path.join(config, "cars", f"{name}.yaml")),
    }
    car_from(Parameters(parameters, f"car {name}: "))  # raises an error here, not in each replay
    return parameters


def named_car(name: str, folder: str) -> Tuple[str, str, Car]:
    """Return the path of a profile, the name of its car, and the car with its noise.

    Args:
        name: path of the profile, or its name in `folder`.
        folder: of the profiles.

    Raises:
        UserError: there is no such profile, or it is wrong.
    """
    path = find_file(name, folder, ".yaml")
    car_name = os.path.splitext(os.path.basename(path))[0]
    parameters = Parameters({**read_profile(path), "noise": True}, f"{path}: ")
    parameters.refuse_unknown(CAR_PARAMETERS)
    return path, car_name, car_from(parameters)


def car_from(parameters: Parameters) -> Car:
    """Return the car that parameters describe; the defaults are those of the ideal car.

    Raises:
        UserError: a parameter is of the wrong type or out of range.
    """
    return car_of(parameters.read(CAR_PARAMETERS))


def car_of(values: Values) -> Car:
    """Return the car with the values of CAR_PARAMETERS."""
    numbers = {name: values[name] for name, *_ in NUMBERS}
    timeout = from_seconds(values["command_timeout"])
    car = Car(command_timeout=timeout, seed=values["seed"], **numbers)
    if values["noise"]:
        return car
    return car._replace(
        speed_noise=0.0,
        steering_noise=0.0,
        speed_gain_spread=0.0,
        steering_offset_spread=0.0,
        odom_distance_noise=0.0,
        odom_heading_noise=0.0,
        seed=0,
    )
