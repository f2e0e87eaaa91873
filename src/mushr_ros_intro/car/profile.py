"""Read what a car is: from its profile in config/cars/, or from the parameters of car_sim."""

import os
from typing import Any, Dict, List, Mapping

import yaml

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.parameters import ParameterError, flag, number
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

_INFINITY = float("inf")


class _Loader(yaml.SafeLoader):
    """Knows no aliases: a few lines of them can stand for more than fits in memory."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.MarkedYAMLError(None, None, "found an alias", mark)
        return super().compose_node(parent, index)


def names_in(folder: str) -> List[str]:
    """Return the names of the profiles in a folder, sorted."""
    return sorted(each[:-5] for each in os.listdir(folder) if each.endswith(".yaml"))


def read_profile(path: str) -> Dict[str, Any]:
    """Return the parameters that stand in the file of a profile.

    Raises:
        ParameterError: the file cannot be read, or holds no parameters.
    """
    try:
        with open(path, "rb") as file:
            values = yaml.load(file, _Loader)  # noqa: S506, a SafeLoader
    except Exception as error:  # yaml lets out whatever its tags, such as !!int, stumble over
        said = " ".join(str(error).split()) or type(error).__name__
        raise ParameterError(f"{path}: {said}; expected parameters in yaml") from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ParameterError(f"{path}: there are no parameters; expected such as 'track: 0.25'")
    return values


def car_from(values: Mapping[str, Any], place: str) -> Car:
    """Return the car that parameters describe; what is missing is as the ideal car has it.

    Args:
        values: the parameters by name; others than a car's do no harm.
        place: what stands before their names in messages, such as ``~``.

    Raises:
        ParameterError: one is of the wrong kind or out of range.
    """
    usual = Car()

    def parameter(name: str, default: float, unit: str, least: float, most: float) -> float:
        return number(place + name, values.get(name, default), unit, least, most)

    has_noise = flag(f"{place}noise", values.get("noise", False))
    timeout = usual.command_timeout / NANOSECONDS
    speed_noise = parameter("speed_noise", usual.speed_noise, "m/s", 0.0, 10.0)
    steering_noise = parameter("steering_noise", usual.steering_noise, "rad", 0.0, 1.0)
    seed = parameter("seed", usual.seed, "", 0, 1e9)
    if seed != int(seed):
        raise ParameterError(f"parameter {place}seed is {seed:g}; expected a whole number")
    return Car(
        wheelbase=parameter("wheelbase", usual.wheelbase, "m", 0.01, 100.0),
        track=parameter("track", usual.track, "m", 0.01, 100.0),
        wheel_radius=parameter("wheel_radius", usual.wheel_radius, "m", 0.001, 10.0),
        command_timeout=from_seconds(parameter("command_timeout", timeout, "s", 0.001, 10.0)),
        speed_limit=parameter("speed_limit", usual.speed_limit, "m/s", 0.001, _INFINITY),
        steering_limit_left=parameter(
            "steering_limit_left", usual.steering_limit_left, "rad", 0.0, _INFINITY
        ),
        steering_limit_right=parameter(
            "steering_limit_right", usual.steering_limit_right, "rad", 0.0, _INFINITY
        ),
        acceleration=parameter("acceleration", usual.acceleration, "m/s^2", 0.01, _INFINITY),
        steering_rate=parameter("steering_rate", usual.steering_rate, "rad/s", 0.01, _INFINITY),
        speed_noise=speed_noise if has_noise else 0.0,
        steering_noise=steering_noise if has_noise else 0.0,
        seed=int(seed) if has_noise else 0,
    )
