"""Write an autograder for Gradescope: a zip with this package, the plans and the options."""

import argparse
import os
import re
import shutil
import tempfile

import yaml

from mushr_ros_intro.classroom.arguments import words_of
from mushr_ros_intro.classroom.assignment import Plans, setting_from
from mushr_ros_intro.classroom.points import read_points
from mushr_ros_intro.classroom.store import give_to_user
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.wording import counted
from mushr_ros_intro.yaml_file import read_mapping

FILES = (
    *("LICENSE", "package.xml", "setup.py", "src/grade.py", "plans/test_drive.txt"),
    *("scripts/grade", "scripts/dev/loopback.c", "scripts/dev/packages", "scripts/setup"),
)
FOLDERS = ("config", "src/mushr_ros_intro", "underlay/ackermann_msgs", "urdf", "web/results")
LEFT_OUT = ("authoring", "browser", "doctor", "drive", "__pycache__", ".*")
"""What of this package is needed for grading, and what of its folders is not.

The rest is not in the zip, above all path_publisher.py and the examples, which are solutions.
"""

SOURCE = "/autograder/source"
"""Where Gradescope unpacks the zip."""


def write_autograder(arguments: argparse.Namespace) -> str:
    """Write the zip that the command line names; return a summary.

    Raises:
        UserError: an option or a file is wrong; then no zip is written.
        OSError: a file cannot be read or written.
    """
    package = package_folder(".")
    if not os.path.exists(os.path.join(package, FILES[-1])):
        text = f"{package} has no {FILES[-1]}"
        raise UserError(f"{text}; expected a checkout of this package: an autograder contains it")
    out = os.path.realpath(arguments.autograder)
    # Beside the zip, which is replaced only when it is complete.
    with tempfile.TemporaryDirectory(prefix=".autograder", dir=os.path.dirname(out)) as folder:
        contents = os.path.join(folder, "contents")
        os.mkdir(contents)
        summary = _fill(contents, arguments, package)
        os.replace(shutil.make_archive(contents, "zip", contents), out)
    give_to_user(out)
    return f"{arguments.autograder}: {summary}; {os.path.getsize(out) // 1000} kB"


def _fill(folder: str, arguments: argparse.Namespace, package: str) -> str:
    """Write the contents of the autograder to an empty folder; return a summary.

    Errors as in `write_autograder`.
    """
    plans = Plans(arguments)
    kind = "path" if arguments.follow else "plan"
    points = read_points(arguments.points, plans.names, bool(arguments.follow))
    plans.check_map(setting_from(arguments, Sandbox(), points.tolerances))
    copy = os.path.join(folder, "mushr_ros_intro")
    for each in (f"{kind}s", "mushr_ros_intro/maps"):
        os.makedirs(os.path.join(folder, each))
    options = {**arguments.settings, "map": arguments.map, "secret": arguments.secret}
    if arguments.map != "none":
        map_file = find_file(arguments.map, os.path.join(package, "maps"), ".yaml")
        options["map"] = _copy_map(map_file, os.path.join(copy, "maps"))
    _copy_package(package, copy)
    for each in ("setup.sh", "run_autograder"):
        shutil.copy(os.path.join(package, "scripts/dev/autograder", each), folder)
    options["follow" if arguments.follow else "plans"] = [
        *(_copy_file(each, folder, f"{kind}s/{os.path.basename(each)}") for each in plans.paths),
        *plans.names[len(plans.paths) :],  # the drawn one, if any
    ]
    if arguments.points is not None:
        options["points"] = _copy_file(arguments.points, folder, "points.yaml")
    with open(os.path.join(folder, "arguments"), "w", encoding="utf-8") as file:
        file.writelines(f"{word}\n" for word in words_of(options))
    hidden = sum(map(points.is_hidden, plans.names))
    return f"{counted(len(plans.names), kind)}, {hidden} hidden; {points.max_score():g} points"


def _copy_file(path: str, folder: str, name: str) -> str:
    """Copy a file to the folder of the autograder; return its path on Gradescope."""
    shutil.copyfile(path, os.path.join(folder, name))
    return f"{SOURCE}/{name}"


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
    values = read_mapping(path, "a map", is_map=True)
    name = os.path.splitext(os.path.basename(path))[0]
    image = os.path.join(os.path.dirname(path), values["image"])
    values["image"] = os.path.basename(shutil.copy(image, folder))
    with open(os.path.join(folder, f"{name}.yaml"), "w", encoding="utf-8") as file:
        yaml.safe_dump(values, file)
    return name
