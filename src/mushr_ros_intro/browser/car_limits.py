"""What the page needs to know about a car."""

from typing import Any, Dict

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Parameters

SPEED = 2.0
"""Of driving by hand [m/s]; this and the angle are those of config/keyboard_teleop.yaml."""

STEERING_ANGLE = 0.34
"""Of driving by hand [rad]."""


def car_limits(parameters: Parameters) -> Dict[str, Any]:
    """Return the commands of driving by hand within a car's limits, and whether it can have noise.

    Args:
        parameters: of the simulated car; empty without one.

    Raises:
        UserError: a parameter is of the wrong type or out of range.
    """
    car = car_from(parameters.with_values(noise=True))
    angles = STEERING_ANGLE, car.steering_limit_left, car.steering_limit_right
    return {
        "hand": {"speed": min(SPEED, car.speed_limit), "steering_angle": min(angles)},
        "has_noise": bool(car.speed_noise or car.steering_noise),
    }
