#!/usr/bin/python3
"""Compare recorded drives with their prediction, and fit the parameters of the car."""

import argparse
import json
import os
import signal
import sys
from functools import partial
from typing import Any, Dict, List

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import named_car, names_in
from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.bag_file import Source, read_bag, record
from mushr_ros_intro.comparison.comparison import compare
from mushr_ros_intro.comparison.drive_log import DriveLog, with_rows_of
from mushr_ros_intro.comparison.fit import Fit, combined, fit
from mushr_ros_intro.comparison.profile_file import vesc_text, write_profile
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import REQUIRED, Parameters, number
from mushr_ros_intro.paths import find_file, package_folder, user_path
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.ros.commands import as_typed

_MUX = "/car/mux/ackermann_cmd_mux"


def main() -> int:
    """Compare the drives on the command line; return the exit status."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly if the output is cut off
    try:
        return run()
    except UserError as error:
        print(f"compare_drive.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 128 + signal.SIGINT  # as in a shell


def run() -> int:
    """Compare the drives, and print the result; return 0, or 2 if nothing known explains a drive.

    Raises:
        UserError: the program was called wrongly, or there is no drive to compare.
    """
    profiles = package_folder("config/cars")
    arguments = parse_arguments(profiles)
    options = Parameters(vars(arguments), "--")
    profile, car_name, car = named_car(arguments.car, profiles)
    logs = read_logs(arguments, options, car)


    show = (lambda *lines: None) if arguments.json else partial(print, sep="\n")
    drives: List[Dict[str, Any]] = []
    fits: List[Fit] = []
    for index, log in enumerate(logs):
        result = fit(log, car)
        fits.append(result)
        found = compare(log, car, result.delay)
        drives.append(diagnosis.as_json(found, result, car_name))
        show(*diagnosis.as_text(found, car_name), "")
        if arguments.out:
            from mushr_ros_intro.comparison import error_plot  # matplotlib is slow to import

            name = f"{index + 1}_{os.path.splitext(os.path.basename(log.name))[0]}"
            folder = os.path.join(user_path(arguments.out), name)
            error_plot.write_files(folder, found)
            show(f"written: {folder}", "")
        show(*diagnosis.fit_text(result, car), "")
    both = combined(fits, car)
    is_certain = all(each.is_certain for each in fits)
    is_profile = all(each.is_profile for each in fits)
    if len(fits) > 1 and is_certain:
        show(*diagnosis.combined_text(both, car), "")
    if (arguments.fit or arguments.vesc) and is_certain:
        show(*vesc_text(both.car, arguments.vesc and user_path(arguments.vesc)), "")
    if arguments.fit and is_profile:
        path = user_path(arguments.fit)
        write_profile(path, both, profile, arguments.bags)
        show(f"written: {path}", "")
    show(*(f"{each['drive']}: {each['result']}" for each in drives))
    if arguments.json:
        json.dump({"drives": drives}, sys.stdout, allow_nan=False)
        print()
    expected = "expected drives of one cause that a correction of the gains leaves"
    if arguments.vesc and not is_certain:
        raise UserError(f"--vesc: no values, because of what was found; {expected}")
    if arguments.fit and not is_profile:
        raise UserError(f"--fit: no profile, because no profile describes this car; {expected}")
    return 0 if all(each.is_found for each in fits) else 2


def read_logs(arguments: argparse.Namespace, options: Parameters, car: Car) -> List[DriveLog]:
    """Return the drives in the bags, the first of which is recorded before, if asked for.

    Raises:
        UserError: an argument or the plan is wrong, or a bag has no drive of the plan.
    """
    frames = tuple(arguments.tf) if arguments.tf else None
    pose_offset = options.get(number("pose_offset", 0.0, "m", -10.0, 10.0))
    source = Source(arguments.commands, arguments.pose, frames, pose_offset)
    if arguments.record is not None:
        seconds = options.get(number("record", REQUIRED, "s", 1.0, 1e5))
        print(f"recording {', '.join(source.topics)} for {seconds:g} s", file=sys.stderr)
        record(arguments.bags[0], source, seconds)
    logs = [read_bag(path, source, car.command_timeout) for path in arguments.bags]
    if arguments.plan:
        plan = read_plan(find_file(arguments.plan, package_folder("plans"), ".txt"))
        logs = [with_rows_of(log, plan) for log in logs]
    return logs


def parse_arguments(profiles: str) -> argparse.Namespace:
    """Return the arguments of the command line; exit with status 2 if they are wrong."""
    parser = argparse.ArgumentParser(
        prog="compare_drive.py",
        description="Compare recorded drives with their prediction, and fit the parameters of the "
        "car. The exit status is 0 if there is a result, 2 if nothing known explains a drive.",
        epilog=as_typed(
            "Example: rosrun mushr_ros_intro compare_drive.py drive.bag --plan figure_8"
        ),
    )
    add = parser.add_argument
    cars = ", ".join(names_in(profiles))
    add("bags", metavar="BAG", nargs="+", help="a recorded drive")
    add("--plan", metavar="PLAN", help="the plan that was driven: a path, or a name in plans/")
    add("--car", metavar="CAR", default="ideal", help=f"path of a profile, or one of {cars}")
    commands_help = "the commands that reached the car; default %(default)s"
    add("--commands", metavar="TOPIC", default=f"{_MUX}/output", help=commands_help)
    pose_help = "the poses of the car; default %(default)s"
    add("--pose", metavar="TOPIC", default="/car/car_pose", help=pose_help)
    tf_help = "use the pose of the frame BASE in the frame MAP, from /tf, and not --pose"
    add("--tf", metavar=("MAP", "BASE"), nargs=2, help=tf_help)
    offset_help = "how far in front of the rear axle the reported point is; default 0"
    add("--pose_offset", metavar="METRES", default=0.0, help=offset_help)
    record_help = "first record the drive of the running system, for so long or until Ctrl-C"
    add("--record", metavar="SECONDS", help=record_help)
    add("--fit", metavar="FILE.yaml", help="write the profile of the fitted car")
    add("--vesc", metavar="FILE.yaml", default="", help="MuSHR's vesc.yaml, to compute new values")
    add("--out", metavar="FOLDER", help="write both paths, and pictures of them and of the error")
    add("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    if arguments.record is not None and len(arguments.bags) > 1:
        parser.error("--record records one drive; expected one BAG")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
