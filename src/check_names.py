#!/usr/bin/python3
"""Check the names of a car and of a map: check_names.py CAR MAP.

roslaunch runs this program while it loads sim.launch. It prints the name of the car. If there is no
such car or map, it prints a message instead, and its exit status is 1: then roslaunch stops.
"""

import os
import sys

import rospkg

from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import find_file


def check(car: str, map_name: str) -> None:
    """Check that there is a profile of the car, and a file of the map unless its name is `none`.

    Raises:
        UserError: there is not; the message names the argument of sim.launch and the valid names.
    """
    package = rospkg.RosPack().get_path("mushr_ros_intro")
    cars = names_in(os.path.join(package, "config/cars"))
    if car not in cars:
        raise UserError(f"car:={car}: no such car; expected one of {', '.join(cars)}")
    if map_name != "none":
        try:
            find_file(map_name, os.path.realpath(os.path.join(package, "maps")), ".yaml")
        except UserError as error:
            raise UserError(f"map:={error}, none") from None


if __name__ == "__main__":
    try:
        check(*sys.argv[1:])
    except UserError as error:
        sys.exit(f"\nsim.launch: {error}\n")
    print(sys.argv[1], end="")
