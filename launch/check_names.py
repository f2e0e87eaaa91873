"""Check the arguments `car` and `map` of sim.launch: check_names.py CAR MAP.

roslaunch runs it while it loads sim.launch. If it prints the valid names instead of CAR and exits
with status 1, roslaunch starts no node.
"""

import sys

from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import find_file, package_folder

if __name__ == "__main__":
    _, car, map_name = sys.argv
    cars = names_in(package_folder("config/cars"))
    if car not in cars:
        sys.exit(f"\nsim.launch: car:={car}: no such car; expected one of {', '.join(cars)}\n")
    try:
        if map_name != "none":
            find_file(map_name, package_folder("maps"), ".yaml")
    except UserError as error:
        sys.exit(f"\nsim.launch: map:={error}, none\n")
    print(car, end="")
