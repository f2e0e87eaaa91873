#!/usr/bin/python3
"""Check plans before they are driven, without a roscore."""

import argparse
import json
import os
import signal
import sys
from typing import Optional

import rospkg

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from, names_in, read_profile
from mushr_ros_intro.parameters import ParameterError, Parameters
from mushr_ros_intro.plan.find import find_plan, read_plan
from mushr_ros_intro.plan.model import PlanError
from mushr_ros_intro.preview.check import Report, Scatter, as_json, as_text, check, scatter, verdict
from mushr_ros_intro.preview.ensemble import count_ticks
from mushr_ros_intro.world.grid import Grid, MapError, find_map, read_map

MOST_RUNS = 10_000_000
MOST_CAR_TICKS = 20_000_000_000
"""More of the commands of a plan times the runs are refused: they take about half an hour."""


def main() -> int:
    """Check the plans that the command line names; return the exit status."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # who reads only the first lines may go
    try:
        package = os.path.realpath(rospkg.RosPack().get_path("mushr_ros_intro"))
    except rospkg.ResourceNotFound:
        return _refuse(
            "ROS does not know the package mushr_ros_intro; expected a shell in which the "
            "workspace's devel/setup.bash has been sourced"
        )
    plans, maps = (os.path.realpath(os.path.join(package, each)) for each in ("plans", "maps"))
    profiles = os.path.join(package, "config", "cars")
    arguments = _parser(profiles).parse_args()
    if arguments.plot and len(arguments.plans) > 1:
        return _refuse("--plot draws one plan; expected one PLAN")
    try:
        path = os.path.join(profiles, f"{arguments.car}.yaml")
        car = car_from(Parameters({**read_profile(path), "noise": True}, f"{path}: "))
        map_path, grid = "", None
        if arguments.map is not None:
            map_path = _shortened(find_map(arguments.map, maps))
            grid = read_map(map_path)
    except (MapError, ParameterError) as error:
        return _refuse(str(error))

    is_clean = True
    results = []
    for number, name in enumerate(arguments.plans):
        if number and not arguments.json:
            print()
        try:
            path = _shortened(find_plan(name, plans))
            report = _check(path, arguments.car, car, map_path, grid)
        except PlanError as error:
            is_clean = False
            results.append({"plan": name, "faults": [each._asdict() for each in error.faults]})
            if not arguments.json:
                for line in verdict(error.faults):
                    print(line)
            continue
        is_clean = is_clean and not report.faults
        result = None
        if arguments.runs:
            if count_ticks(report.plan) * arguments.runs > MOST_CAR_TICKS:
                return _refuse(
                    f"{arguments.runs} runs of {path} are "
                    f"{count_ticks(report.plan) * arguments.runs} commands to be driven; "
                    f"expected {MOST_CAR_TICKS} at most, so fewer --runs"
                )
            result = scatter(report, car, arguments.runs, arguments.seed)
        if arguments.json:
            results.append(as_json(report, result))
        else:
            for line in as_text(report, result):
                print(line)
        if arguments.plot and not _plot(arguments.plot, report, result, grid):
            return 2
    if arguments.json:
        json.dump(results, sys.stdout, allow_nan=False)
        print()
    return 0 if is_clean else 1


def _parser(profiles: str) -> argparse.ArgumentParser:
    """Return what reads the command line; it ends the program with status 2 on a bad one."""
    parser = argparse.ArgumentParser(
        prog="check_plan.py",
        description="Check plans before they are driven: what they do, whether the car can do "
        "that, and whether it hits a wall. Ends with status 0 if all is well, 1 if there are "
        "faults, 2 if it has been called wrongly.",
    )
    parser.add_argument("plans", metavar="PLAN", nargs="+", help="a name in plans/, or a path")
    parser.add_argument(
        "--car", choices=names_in(profiles), default="ideal", help="the car; default ideal"
    )
    parser.add_argument(
        "--map", metavar="MAP", help="a name in maps/, or a yaml file; default none"
    )
    parser.add_argument("--json", action="store_true", help="print JSON: a list, one item a plan")
    parser.add_argument("--plot", metavar="FILE.png", help="draw the path, speed and steering")
    parser.add_argument(
        "--runs",
        metavar="N",
        type=_whole(2, MOST_RUNS),
        help="drive the plan N times, each time with errors of its own, and say how that spreads",
    )
    parser.add_argument(
        "--seed", metavar="S", type=_whole(0, 2**32), default=1, help="of the errors; default 1"
    )
    return parser


class _whole:  # noqa: N801, argparse calls it as it calls int
    """Reads a whole number within bounds."""

    def __init__(self, least: int, most: int):
        self._least, self._most = least, most

    def __call__(self, text: str) -> int:
        """Return the number that `text` stands for."""
        try:
            value: Optional[int] = int(text)
        except ValueError:
            value = None
        if value is None or not self._least <= value <= self._most:
            raise argparse.ArgumentTypeError(
                f"'{text}'; expected a whole number from {self._least} to {self._most}"
            )
        return value


def _shortened(path: str) -> str:
    """Return a path as seen from here, where that is shorter."""
    return min(path, os.path.relpath(path), key=len)


def _check(path: str, car_name: str, car: Car, map_path: str, grid: Optional[Grid]) -> Report:
    """Read and check the plan in a file.

    Raises:
        PlanError: it is no plan.
    """
    return check(read_plan(path), car_name, car, map_path, grid)


def _plot(path: str, report: Report, result: Optional[Scatter], grid: Optional[Grid]) -> bool:
    """Draw a plan into a file; say whether that went well."""
    from mushr_ros_intro.preview.plot import draw  # only who draws pays for matplotlib

    try:
        draw(path, report, result, grid)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        _refuse(f"--plot {path} cannot be written: {reason}; expected such as figure_8.png")
        return False
    return True


def _refuse(text: str) -> int:
    """Say what is wrong with how this was called; return the exit status."""
    print(f"check_plan.py: {text}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
