"""Check the arguments of sim.launch: check_names.py CAR MAP NODE.

roslaunch runs it while it loads sim.launch. If there is no such car or map, or if the car NODE is
running already, it prints a message instead of CAR and exits with status 1; then roslaunch starts
no node.
"""

import os
import sys
from contextlib import suppress

import rosgraph
from check_arguments import refuse_unknown, roslaunch_command

from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.ros.xmlrpc_client import CallError, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT
from mushr_ros_intro.wording import similar


def is_running(node: str) -> bool:
    """Return whether a node responds at the master that roslaunch is going to use."""
    program, *words = roslaunch_command()
    # rostest, and roslaunch -p, start a master of their own; roslaunch --nodes starts nothing.
    if os.path.basename(program) != "roslaunch" or any(each.startswith("-") for each in words):
        return False
    with suppress(CallError):  # no master runs, it has no such node, or the node does not respond
        uri = ask(rosgraph.get_master_uri(), CALL_TIMEOUT, "/sim_launch", "lookupNode", node)
        ask(uri, CALL_TIMEOUT, "/sim_launch", "getPid")
        return True
    return False


if __name__ == "__main__":
    refuse_unknown(roslaunch_command())
    _, car, map_name, node = sys.argv
    cars = names_in(package_folder("config/cars"))
    if car not in cars:
        expected = f"{', '.join(cars)}{similar(car, cars)}"
        sys.exit(f"\nsim.launch: car:={car}: no such car; expected one of {expected}\n")
    try:
        if map_name != "none":
            find_file(map_name, package_folder("maps"), ".yaml")
    except UserError as error:
        sys.exit(f"\nsim.launch: map:={error}, none\n")
    if is_running(node):
        sys.exit(
            f"\nsim.launch: {node} is running already; end it first (Ctrl-C in its terminal), "
            "or start another car, such as car_name:=car2\n"
        )
    print(car, end="")
