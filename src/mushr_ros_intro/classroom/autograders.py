"""Collect the contents of an autograder for Gradescope: see docs/grading.md."""

import os
import re
import shutil
from typing import NamedTuple, Optional, Sequence

import yaml

from mushr_ros_intro.car.profile import names_in, read_profile
from mushr_ros_intro.classroom.points import read_points
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import find_file
from mushr_ros_intro.plan.parse import read_plans
from mushr_ros_intro.preview.walls import refuse_walls
from mushr_ros_intro.wording import counted
from mushr_ros_intro.world.map_file import read_map
from mushr_ros_intro.yaml_file import read_mapping

FILES = (
    *("LICENSE", "package.xml", "setup.py", "src/grade.py"),
    *("scripts/grade", "scripts/loopback.c", "scripts/packages", "scripts/setup"),
)
FOLDERS = ("config", "src/mushr_ros_intro", "underlay/ackermann_msgs")
LEFT_OUT = ("authoring", "browser", "doctor", "drive", "__pycache__", ".*")
"""What of this package is needed for grading, and what of its folders is not.

The rest is not in the zip, above all path_publisher.py and the examples, which are solutions.
"""

SOURCE = "/autograder/source"
"""Where Gradescope unpacks the zip."""

SILENCE = 300.0
"""All plans together wait at most so long for a node that hangs [s of wall-clock time].

Gradescope ends a run after 600 s. With half a core, a drive of a figure 8 takes about 3 s.
"""

MIN_TIMEOUT, MAX_TIMEOUT = 10.0, 30.0
"""One plan waits so long [s of wall-clock time]; with half a core, a node starts in about 2 s."""


class Options(NamedTuple):
    """What the autograder grades, as for grade.py."""

    plans: Sequence[str]
    points: Optional[str]
    file: str
    remap: Sequence[str]
    car: str
    map: str


def fill(folder: str, options: Options, package: str) -> str:
    """Write the contents of the autograder to an empty folder; return a summary.

    Args:
        folder: the folder.
        options: what the autograder grades.
        package: the folder of this package.

    Raises:
        UserError: an option or a file is wrong.
        OSError: a file cannot be read or written.
    """
    plans = read_plans(options.plans, os.path.join(package, "plans"))
    most = int(SILENCE / MIN_TIMEOUT)
    if len(plans) > most:
        raise UserError(f"there are {len(plans)} plans; expected at most {most}")
    points = read_points(options.points, list(plans))
    _check(options, names_in(os.path.join(package, "config", "cars")))
    copy = os.path.join(folder, "mushr_ros_intro")
    for each in ("plans", "mushr_ros_intro/maps"):
        os.makedirs(os.path.join(folder, each))
    map_name = "none"
    if options.map != "none":
        map_file = find_file(options.map, os.path.join(package, "maps"), ".yaml")
        grid = read_map(map_file)
        map_name = _copy_map(map_file, os.path.join(copy, "maps"))
        files = ("car_sim.yaml", f"cars/{options.car}.yaml")
        profiles = (read_profile(os.path.join(package, "config", each)) for each in files)
        refuse_walls(plans.values(), {**next(profiles), **next(profiles)}, grid)
    for name, plan in plans.items():
        shutil.copyfile(plan.path, os.path.join(folder, "plans", f"{name}.txt"))
    _copy_package(package, copy)
    for each in ("setup.sh", "run_autograder"):
        shutil.copy(os.path.join(package, "scripts", "autograder", each), folder)

    # Hidden plans last: a node could store what it learns of them, and print it in another drive.
    names = sorted(plans, key=points.is_hidden)
    timeout = min(SILENCE / len(plans), MAX_TIMEOUT)
    words = ["--plans", *(f"{SOURCE}/plans/{name}.txt" for name in names)]
    words += ["--file", options.file, "--car", options.car, "--map", map_name]
    words += ["--timeout", f"{timeout:g}"]
    words += ["--remap", *options.remap] if options.remap else []
    if options.points is not None:
        shutil.copyfile(options.points, os.path.join(folder, "points.yaml"))
        words += ["--points", f"{SOURCE}/points.yaml"]
    with open(os.path.join(folder, "arguments"), "w", encoding="utf-8") as file:
        file.writelines(f"{word}\n" for word in words)
    hidden = sum(map(points.is_hidden, names))
    return f"{counted(len(plans), 'plan')}, {hidden} hidden; {points.max_score():g} points"


def _check(options: Options, cars: Sequence[str]) -> None:
    """Check the options that are no files.

    Raises:
        UserError: one is wrong.
    """
    if options.car not in cars:
        raise UserError(f"--car is '{options.car}'; expected one of {', '.join(cars)}")
    for each in options.remap:
        if not re.fullmatch(r"[^:=\s]+:=[^:=\n]+", each):
            raise UserError(f"--remap is '{each}'; expected FROM:=TO, such as control:=/cmd")
    if not re.fullmatch(r"[^-/\s][^/\n]*", options.file):
        raise UserError(f"--file is '{options.file}'; expected a file name without a folder")


def _copy_package(package: str, copy: str) -> None:
    """Copy what grading needs; CMakeLists.txt without the programs that are not in the copy."""
    for each in FILES:
        os.makedirs(os.path.dirname(os.path.join(copy, each)), exist_ok=True)
        shutil.copy(os.path.join(package, each), os.path.join(copy, each))
    for each in FOLDERS:
        ignored = shutil.ignore_patterns(*LEFT_OUT)
        shutil.copytree(os.path.join(package, each), os.path.join(copy, each), ignore=ignored)
    with open(os.path.join(package, "CMakeLists.txt"), encoding="utf-8") as file:
        text = file.read()
    for program in re.findall(r"^ +(src/\w+\.py)\n", text, re.MULTILINE):
        if not os.path.exists(os.path.join(copy, program)):
            text = text.replace(f"    {program}\n", "")
    with open(os.path.join(copy, "CMakeLists.txt"), "w", encoding="utf-8") as file:
        file.write(text)


def _copy_map(path: str, folder: str) -> str:
    """Copy a map without faults to a folder; return its name there."""
    values = read_mapping(path, "a map")
    image = os.path.join(os.path.dirname(path), values["image"])
    name = os.path.splitext(os.path.basename(path))[0]
    values["image"] = name + os.path.splitext(image)[1]
    shutil.copyfile(image, os.path.join(folder, values["image"]))
    with open(os.path.join(folder, f"{name}.yaml"), "w", encoding="utf-8") as file:
        yaml.safe_dump(values, file)
    return name
