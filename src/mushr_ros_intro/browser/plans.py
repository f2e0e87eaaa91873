"""What the page shows of plans, which it knows by name only, and of the car."""

import glob
import os
from contextlib import suppress
from typing import Any, Dict, Optional, Sequence

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.paths import package_folder, user_path
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Fault, PlanError, shortest_decimal
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import BODY, Footprint
from mushr_ros_intro.yaml_file import read_mapping

SUFFIX = ".txt"

MAX_LISTED_SIZE = 1_000_000
"""Larger files are not listed [bytes]; checking them takes minutes."""

MAX_PATH_POINTS = 2000
"""Points of a path."""

MAX_ENTRIES = 1000
"""Rows and faults of a plan, of which the page makes elements; the others are counted."""


def find_plans(folders: Sequence[str]) -> Dict[str, str]:
    """Return the paths of all plans by their names; files in later folders come first.

    A folder that cannot be listed has no plans: the user may work in one of somebody else. It may
    also be the folder of a package.
    """
    found = {}
    for folder in folders:
        for path in glob.glob(f"{glob.escape(folder)}/*{SUFFIX}"):
            if os.path.isfile(path) and os.path.getsize(path) <= MAX_LISTED_SIZE:
                found[os.path.basename(path)[: -len(SUFFIX)]] = path
    found.pop("CMakeLists", None)
    return dict(sorted(found.items()))


def versions(folders: Sequence[str]) -> Dict[str, float]:
    """Return the time at which each plan was last written [s since 1970], by the plans' names."""
    times = {}
    for name, path in find_plans(folders).items():
        with suppress(FileNotFoundError):  # it has just been deleted
            times[name] = os.stat(path).st_mtime
    return times


def name_of(path: str, folders: Sequence[str]) -> Optional[str]:
    """Return the name of the plan with this path or name, or None if `folders` do not have it."""
    name = os.path.basename(path)
    name = name[: -len(SUFFIX)] if name.endswith(SUFFIX) else name
    found = find_plans(folders).get(name)
    if found is None:
        return None
    # A file of another folder can have the same name.
    is_other = os.sep in path and os.path.realpath(user_path(path)) != os.path.realpath(found)
    return None if is_other else name


def describe(
    name: str, path: str, car_name: str, car: Car, grid: Any, footprint: Footprint = BODY
) -> Dict[str, Any]:
    """Check a plan with a car, and on a map (a `Grid`) if there is one."""
    try:
        plan = read_plan(path)
    except PlanError as error:
        nothing: Dict[str, Any] = {"start": None, "rows": [], "row_count": 0, "path": []}
        return {"name": name, **nothing, **_faults(error.faults)}
    report = check(plan, car_name, car, "the map" if grid else "", grid, footprint)
    step = -(-len(report.states) // MAX_PATH_POINTS)
    states = [*report.states[:-1:step], report.states[-1]]
    return {
        "name": name,
        "start": plan.start,
        "start_line": plan.start_line,
        "rows": [
            {
                "line": row.line,
                "speed": shortest_decimal(row.speed),
                "steering_angle": shortest_decimal(row.steering_angle),
                "duration": row.duration / NANOSECONDS,
            }
            for row in plan.rows[:MAX_ENTRIES]
        ],
        "row_count": len(plan.rows),
        **_faults(report.faults),
        "length": report.length,
        "duration": plan.duration / NANOSECONDS,
        "wall": report.rest / NANOSECONDS if report.collision else None,
        "final_pose": report.final_pose,
        "path": [(state.pose.x, state.pose.y) for state in states],
        "ignores_noise": car.has_command_noise,
    }


def car_limits(parameters: Parameters) -> Dict[str, Any]:
    """Return the commands of driving by hand within a car's limits.

    Also return the `car` as text, which shows whether it is still the same car.

    Args:
        parameters: of the simulated car; empty without one.

    Raises:
        UserError: a parameter is of the wrong type or out of range.
    """
    car = car_from(parameters)
    path = os.path.join(package_folder("config"), "keyboard_teleop.yaml")
    hand = read_mapping(path, "the keys speed and steering_angle")
    angles = hand["steering_angle"], car.steering_limit_left, car.steering_limit_right
    return {
        "hand": {"speed": min(hand["speed"], car.speed_limit), "steering_angle": min(angles)},
        "car": str(car),
    }


def _faults(faults: Sequence[Fault]) -> Dict[str, Any]:
    shown = [
        {"line": each.line, "column": each.column, "text": each.text}
        for each in faults[:MAX_ENTRIES]
    ]
    return {"faults": shown, "fault_count": len(faults)}
