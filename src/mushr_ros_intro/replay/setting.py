"""Describe replays: find the car, the map and the node."""

import glob
import math
import os
import shlex
from itertools import islice
from typing import Any, Dict, Iterator, Sequence, Tuple

import roslib.packages
import rospkg
import yaml

from mushr_ros_intro.car.profile import read_parameters
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import find_file
from mushr_ros_intro.program_file import faults_of, name_faults
from mushr_ros_intro.replay.job import Job, Setting
from mushr_ros_intro.replay.reference import Exercise
from mushr_ros_intro.wording import similar
from mushr_ros_intro.world.map_file import read_map
from mushr_ros_intro.yaml_file import read_mapping

MAX_PARAMETERS = 1000
"""Limit of the number of parameters of a file; aliases can repeat a value without end."""


def read_setting(package: str, car: str, map_name: str, **others: Any) -> Setting:
    """Return the setting with a car and a map of this package.

    Args:
        package: the folder of this package.
        car: the name of a profile.
        map_name: the name or the path of a map, or "none".
        others: the other fields.

    Raises:
        UserError: there is no such car or map.
    """
    config = os.path.join(package, "config")
    parameters = read_parameters(car, config)
    mux = read_mapping(os.path.join(config, "ackermann_cmd_mux.yaml"), "inputs")
    grid = None
    if map_name != "none":
        grid = read_map(find_file(map_name, os.path.join(package, "maps"), ".yaml"))
    return Setting(car, parameters, mux, grid, **others)


def parameter_words(path: str) -> Tuple[str, ...]:
    """Return the parameters in a YAML file as arguments of a node, such as "_pid/kp:=1".

    Raises:
        UserError: the file cannot be read, or is not a mapping.
    """

    def words(prefix: str, values: Dict[str, Any]) -> Iterator[str]:
        for name, value in values.items():
            if isinstance(value, dict):
                yield from words(f"{prefix}{name}/", value)
            else:
                text = yaml.safe_dump([value], default_flow_style=True, width=math.inf)
                yield f"{prefix}{name}:={text.strip()[1:-1]}"  # rospy reads YAML

    mapping = read_mapping(path, "keys with the names of parameters")
    return tuple(islice(words("_", mapping), MAX_PARAMETERS))


def find_executable(package: str, name: str) -> str:
    """Return the path of a node.

    Raises:
        UserError: there is no such package, no such executable or more than one in it, or it
            cannot be started.
    """
    rospack = rospkg.RosPack()
    try:
        found = roslib.packages.find_node(package, name)
    except rospkg.ResourceNotFound:
        raise UserError(
            f"there is no package '{package}' (rospack find {package})"
            f"{similar(package, rospack.list()) or '.'} "
            "Is its workspace sourced (source devel/setup.bash)?"
        ) from None
    if not found:
        folder = glob.escape(rospack.get_path(package))
        files = filter(os.path.isfile, glob.glob(f"{folder}/**/*", recursive=True))
        programs = {os.path.basename(path): os.path.normpath(path) for path in files}
        hint = similar(name, programs)
        if name in programs:
            hint = f". It is not executable; type: chmod +x {shlex.quote(programs[name])}"
        raise UserError(f"there is no node '{name}' in the package '{package}'{hint}")
    path = str(found[0])
    for problem, remedy in (*name_faults(found, rospack.get_path(package)), *faults_of(path)):
        raise UserError(f"{problem}. {remedy}")
    return path


def job_for(words: Sequence[str], plan: Exercise, setting: Setting) -> Job:
    """Return the replay of a plan with an installed node.

    Args:
        words: the package, the name of the executable, and arguments.
        plan: the plan, or the path.
        setting: the setting.

    Raises:
        UserError: there is no such node.
    """
    command = (find_executable(*words[:2]), *words[2:])
    return Job(" ".join(words), command, plan, setting)
