#!/usr/bin/python3
"""Compare recorded drives with their prediction, and fit the parameters of the car."""

import argparse
import os
import sys
from functools import partial
from typing import List

import numpy as np

from mushr_ros_intro.car.profile import named_car, names_in
from mushr_ros_intro.comparison import diagnosis
from mushr_ros_intro.comparison.bag_file import read_bag
from mushr_ros_intro.comparison.drive_log import compare, start_pose
from mushr_ros_intro.comparison.fit import Fit, combined, fit
from mushr_ros_intro.comparison.profile_file import vesc_text, write_profile
from mushr_ros_intro.errors import UserError, exit_status
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters, number
from mushr_ros_intro.paths import package_folder, user_path
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.replay.report_files import write_trajectory
from mushr_ros_intro.ros.commands import as_typed
from mushr_ros_intro.stamps import from_seconds

show = partial(print, sep="\n")
_MUX = "/car/mux/ackermann_cmd_mux"


def run() -> int:
    """Compare the drives, and print the result; return 0, or 2 if nothing known explains a drive.

    Raises:
        UserError: the program was called wrongly, or there is no drive to compare.
    """
    profiles = package_folder("config/cars")
    arguments = parse_arguments(profiles)
    options = Parameters(vars(arguments), "--")
    profile, car_name, car = named_car(arguments.car, profiles)
    offset = options.get(number("pose_offset", 0.0, "m", -10.0, 10.0))
    topics = (arguments.commands, arguments.pose)
    logs = [read_bag(path, *topics, offset, car.command_timeout) for path in arguments.bags]

    fits: List[Fit] = []
    sentences: List[str] = []
    for index, log in enumerate(logs):
        result = fit(log, car)
        fits.append(result)
        found = compare(log, car, result.delay)
        show(*diagnosis.comparison_text(log, found, car_name), "")
        if arguments.out:
            name = f"{index + 1}_{os.path.splitext(os.path.basename(log.name))[0]}"
            folder = os.path.join(user_path(arguments.out), name)
            write_paths(folder, found, start_pose(log, from_seconds(result.delay)))
            show(f"written: {folder}", "")
        show(*diagnosis.fit_text(result), "")
        sentences.append(f"{log.name}: {diagnosis.sentence(log, result)}")
    both = combined(fits)
    is_certain = all(each.is_certain for each in fits)
    is_profile = all(each.is_profile for each in fits)
    if len(fits) > 1 and is_certain:
        show(*diagnosis.combined_text(both), "")
    if arguments.vesc and is_certain:
        show(*vesc_text(both.car, user_path(arguments.vesc)), "")
    if arguments.fit and is_profile:
        path = user_path(arguments.fit)
        write_profile(path, both, profile, arguments.bags)
        show(f"written: {path}", "")
    show(*sentences)
    expected = "expected drives of one cause that a correction of the gains leaves"
    if arguments.vesc and not is_certain:
        raise UserError(f"--vesc: no values, because of what was found; {expected}")
    if arguments.fit and not is_profile:
        raise UserError(f"--fit: no profile, because no profile describes this car; {expected}")
    return 0 if all(each.is_found for each in fits) else 2


def write_paths(folder: str, drive: Drive, start: Pose) -> None:
    """Write trajectory.csv and path.png of a drive from a start pose into a folder.

    Raises:
        UserError: the folder or a file cannot be written.
    """
    from mushr_ros_intro.replay.pictures import picture  # matplotlib is slow to import

    seconds = np.searchsorted(drive.times, np.arange(1.0, drive.times[-1])).tolist()
    title = f"final error {drive.distances[-1]:.3f} m"
    figure = picture(drive, title, error_indices=[*seconds, len(drive.times) - 1])
    try:
        os.makedirs(folder, exist_ok=True)
        write_trajectory(folder, drive, start)
        figure.savefig(os.path.join(folder, "path.png"), dpi=120)
    except OSError as error:
        text = f"{error.filename or folder} cannot be written ({error.strerror})"
        raise UserError(f"--out: {text}; expected a folder") from None


def parse_arguments(profiles: str) -> argparse.Namespace:
    """Return the arguments of the command line; exit with status 2 if they are wrong."""
    parser = argparse.ArgumentParser(
        prog="compare_drive.py",
        description="Compare recorded drives with their prediction, and fit the parameters of the "
        "car. The exit status is 0 if there is a result, 2 if nothing known explains a drive.",
        epilog=as_typed(
            "Example: rosrun mushr_ros_intro compare_drive.py drive.bag --car mushr_nano"
        ),
    )
    add = parser.add_argument
    cars = ", ".join(names_in(profiles))
    add("bags", metavar="BAG", nargs="+", help="a recorded drive")
    add("--car", metavar="CAR", default="ideal", help=f"path of a profile, or one of {cars}")
    commands_help = "the commands that reached the car; default %(default)s"
    add("--commands", metavar="TOPIC", default=f"{_MUX}/output", help=commands_help)
    pose_help = "the poses of the car; default %(default)s"
    add("--pose", metavar="TOPIC", default="/car/car_pose", help=pose_help)
    offset_help = "how far in front of the rear axle the reported point is; default 0"
    add("--pose_offset", metavar="METRES", default=0.0, help=offset_help)
    add("--fit", metavar="FILE.yaml", help="write the profile of the fitted car")
    add("--vesc", metavar="FILE.yaml", help="MuSHR's vesc.yaml, to compute new values")
    add("--out", metavar="FOLDER", help="write both paths as a table and as a picture")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(exit_status("compare_drive.py", run))
