"""Read the parameters of a car from a profile in config/cars/, or from a node's parameters."""

import math
import os
from typing import Any, Dict, List

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.yaml_file import read_mapping


def names_in(folder: str) -> List[str]:
    """Return the names of the profiles in a folder, sorted."""
    return sorted(each[:-5] for each in os.listdir(folder) if each.endswith(".yaml"))


def read_profile(path: str) -> Dict[str, Any]:
    """Return the parameters in the file of a profile.

    Raises:
        UserError: the file cannot be read, or is not a mapping.
    """
    return read_mapping(path, "parameters such as 'track: 0.25'")


def car_from(parameters: Parameters) -> Car:
    """Return the car that parameters describe; the defaults are those of the ideal car.

    Raises:
        UserError: a parameter is of the wrong type or out of range.
    """
    ideal, number = Car(), parameters.number
    has_noise = parameters.flag("noise", False)
    timeout = number("command_timeout", ideal.command_timeout / NANOSECONDS, "s", 0.001, 10.0)
    car = Car(
        wheelbase=number("wheelbase", ideal.wheelbase, "m", 0.01, 100.0),
        track=number("track", ideal.track, "m", 0.01, 100.0),
        wheel_radius=number("wheel_radius", ideal.wheel_radius, "m", 0.001, 10.0),
        command_timeout=from_seconds(timeout),
        speed_limit=number("speed_limit", ideal.speed_limit, "m/s", 0.001, math.inf),
        steering_limit_left=number("steering_limit_left", math.inf, "rad", 0.0, math.inf),
        steering_limit_right=number("steering_limit_right", math.inf, "rad", 0.0, math.inf),
        acceleration=number("acceleration", ideal.acceleration, "m/s^2", 0.01, math.inf),
        steering_rate=number("steering_rate", ideal.steering_rate, "rad/s", 0.01, math.inf),
        speed_gain=number("speed_gain", ideal.speed_gain, "", 0.1, 10.0),
        steering_gain=number("steering_gain", ideal.steering_gain, "", 0.1, 10.0),
        steering_offset=number("steering_offset", ideal.steering_offset, "rad", -0.5, 0.5),
        speed_noise=number("speed_noise", ideal.speed_noise, "m/s", 0.0, 10.0),
        steering_noise=number("steering_noise", ideal.steering_noise, "rad", 0.0, 1.0),
        seed=parameters.integer("seed", ideal.seed, 0, 1e9),
    )
    return car if has_noise else car._replace(speed_noise=0.0, steering_noise=0.0, seed=0)
