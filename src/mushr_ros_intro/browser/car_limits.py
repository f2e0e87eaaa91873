"""What the page needs to know about a car."""

import os
from typing import Any, Dict

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.yaml_file import read_mapping


def car_limits(parameters: Parameters) -> Dict[str, Any]:
    """Return the commands of driving by hand within a car's limits.

    Also return the `car` as text, which shows whether it is still the same car.

    Args:
        parameters: of the simulated car; empty without one.

    Raises:
        UserError: a parameter is of the wrong type or out of range.
    """
    car = car_from(parameters)
    path = os.path.join(package_folder("config"), "keyboard_teleop.yaml")
    hand = read_mapping(path, "the keys speed and steering_angle")
    angles = hand["steering_angle"], car.steering_limit_left, car.steering_limit_right
    return {
        "hand": {"speed": min(hand["speed"], car.speed_limit), "steering_angle": min(angles)},
        "car": str(car),
    }
