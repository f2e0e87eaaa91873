#!/usr/bin/python3
"""Check plans before they are driven, without a roscore.

The time grows linearly with the number of rows. A plan of 100,000 rows takes about 10 s for the
ideal car and 30 s for a car with ramps, and up to twice as long on a map.
"""

import argparse
import os
import sys
from typing import List

from mushr_ros_intro.car.profile import named_car, names_in
from mushr_ros_intro.errors import exit_status
from mushr_ros_intro.parameters import Parameters, integer
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Fault, PlanError
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.preview.spread import spread
from mushr_ros_intro.preview.text import as_text, verdict
from mushr_ros_intro.ros.commands import as_typed
from mushr_ros_intro.world.map_file import read_map

MAX_RUNS = 100_000


def run() -> int:
    """Check the plans; return 0 if they have no faults, else 1.

    Raises:
        UserError: the program was called wrongly.
    """
    plans, maps, profiles = map(package_folder, ("plans", "maps", "config/cars"))
    arguments = parse_arguments(profiles)
    options = Parameters(vars(arguments), "--")
    runs = 0 if arguments.runs is None else options.get(integer("runs", 2, 2, MAX_RUNS))
    seed = options.get(integer("seed", 1, 0, 2**32))
    _, car_name, car = named_car(arguments.car, profiles)
    map_path, grid = "", None
    if arguments.map != "none":
        map_path = shortened(find_file(arguments.map, maps, ".yaml"))
        grid = read_map(map_path)

    faults: List[Fault] = []
    report = result = None
    for index, name in enumerate(arguments.plans):
        try:
            plan = read_plan(shortened(find_file(name, plans, ".txt")))
        except PlanError as error:
            faults += error.faults
            text = verdict(error.faults)
        else:
            report = check(plan, car_name, car, map_path, grid)
            faults += report.faults
            result = spread(plan, car, runs, seed) if runs else None
            text = as_text(report, result)
        print(*([""] if index else []), *text, sep="\n")
    if arguments.plot and report:
        from mushr_ros_intro.preview.plot import write_picture  # matplotlib is slow to import

        write_picture(arguments.plot, report, result, grid)
    return 1 if faults else 0


def parse_arguments(profiles: str) -> argparse.Namespace:
    """Return the arguments of the command line; exit with status 2 if they are wrong."""
    parser = argparse.ArgumentParser(
        prog="check_plan.py",
        description="Check plans before they are driven: what they do, whether the car can do "
        "that, and whether it hits a wall. The exit status is 0 if there are no faults, 1 if "
        "there are, 2 if the program was called wrongly.",
        epilog=as_typed("Example: rosrun mushr_ros_intro check_plan.py figure_8 --map sandbox"),
    )
    cars = ", ".join(names_in(profiles))
    spread_help = "drive the plan N times, each time with random errors, and print the spread"
    add = parser.add_argument
    add("plans", metavar="PLAN", nargs="+", help="path of a plan, or a name here or in plans/")
    car_help = f"path of a profile, or one of {cars}; default ideal"
    add("--car", metavar="CAR", default="ideal", help=car_help)
    map_help = "path of a map, or a name here or in maps/; default none"
    add("--map", metavar="MAP", default="none", help=map_help)
    add("--plot", metavar="FILE.png", help="draw the path, speed and steering angle")
    add("--runs", metavar="N", help=spread_help)
    add("--seed", metavar="S", default=1, help="of the random errors; default 1")
    arguments = parser.parse_args()
    if arguments.plot and len(arguments.plans) > 1:
        parser.error("--plot draws one plan; expected one PLAN")
    return arguments


def shortened(path: str) -> str:
    """Return the shorter one of a path and its form relative to the current directory."""
    return min(path, os.path.relpath(path), key=len)


if __name__ == "__main__":
    sys.exit(exit_status("check_plan.py", run))
