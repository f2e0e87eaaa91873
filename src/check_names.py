#!/usr/bin/python3
"""Check the arguments car, map and car_name of sim.launch: check_names.py CAR MAP CAR_NAME.

roslaunch runs it while it loads sim.launch. If it prints the reason instead of CAR and exits with
status 1, roslaunch starts no node, so it does not replace running nodes of the same name.
"""

import sys

from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import find_file, package_folder
from mushr_ros_intro.ros.connections import responds

if __name__ == "__main__":
    _, car, map_name, car_name = sys.argv
    cars = names_in(package_folder("config/cars"))
    if car not in cars:
        sys.exit(f"\nsim.launch: car:={car}: no such car; expected one of {', '.join(cars)}\n")
    try:
        if map_name != "none":
            find_file(map_name, package_folder("maps"), ".yaml")
    except UserError as error:
        sys.exit(f"\nsim.launch: map:={error}, none\n")
    for node in (f"/{car_name}/car_sim", f"/{car_name}/mux/ackermann_cmd_mux"):
        if responds(node):
            sys.exit(
                f"\nsim.launch: car_name:={car_name}: the node {node} is already running; end it "
                "with Ctrl-C in its terminal, or use another car_name\n"
            )
    print(car, end="")
