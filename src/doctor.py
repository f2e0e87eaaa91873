#!/usr/bin/python3
"""Report why the car does not move, and what to type.

Looks at files, the network settings and the running system, and changes nothing. It joins the
system as a node for some seconds, however many nodes are stopped or unreachable.
"""

import argparse
import logging
import os
import re
import shlex
import signal
import sys
import tempfile
from functools import partial
from typing import List

try:
    import rosgraph
    import roslib.packages
    import rospkg
    from catkin.find_in_workspaces import find_in_workspaces

    from mushr_ros_intro.doctor.facts import Facts, Finding
    from mushr_ros_intro.doctor.listener import sign_off
    from mushr_ros_intro.doctor.network import advertised_findings, network_findings
    from mushr_ros_intro.doctor.observation import Observer
    from mushr_ros_intro.doctor.processes import masters
    from mushr_ros_intro.doctor.programs import no_program, program_findings
    from mushr_ros_intro.doctor.rules import (
        diagnose,
        health,
        hints,
        last_drive,
        left_parameters,
    )
    from mushr_ros_intro.paths import package_folder
    from mushr_ros_intro.ros.commands import as_typed
    from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER
    from mushr_ros_intro.wording import similar

    missing = ""
except ImportError as error:  # the workspace is not sourced, or the Python is not Debian's
    missing = error.name or str(error)

PACKAGE = "mushr_ros_intro"


def import_fault(module: str, python: str, is_sourced: bool) -> str:
    """Return why Python does not find a module of ROS, and what to type.

    Args:
        module: its full name.
        python: the path of the running Python.
        is_sourced: whether a workspace is sourced.
    """
    problem = f"{python} does not find the module {module}:"
    if os.path.realpath(python) != os.path.realpath("/usr/bin/python3"):
        return (
            f"{problem} ROS is installed for another Python. "
            f"Type: /usr/bin/python3 {shlex.quote(os.path.realpath(__file__))}"
        )
    name = module.split(".")[0]
    if is_sourced and name not in ("mushr_ros_intro", "ackermann_msgs"):
        from mushr_ros_intro.program_file import apt_package

        return f"{problem} it is not installed. Type: sudo apt-get install {apt_package(name)}"
    return f"{problem} the workspace is not sourced in this terminal. Type: source {_setup_file()}"


def _setup_file() -> str:
    """Return the quoted path of the setup file of the workspace with this package."""
    found = "devel/setup.bash"
    folder = os.path.dirname(os.path.realpath(__file__))
    while folder != os.path.dirname(folder):  # the user's workspace is further out than build/
        folder = os.path.dirname(folder)
        for each in ("setup.bash", "build/.workspace/devel/setup.bash", "devel/setup.bash"):
            path = os.path.join(folder, each)
            found = shlex.quote(path) if os.path.isfile(path) else found
    return found


def package_findings(package: str) -> List["Finding"]:
    """Return what is wrong with this package and `package`, and with their programs."""
    rospack = rospkg.RosPack()
    found = []
    for name in filter(None, dict.fromkeys((PACKAGE, package))):
        try:
            folder = rospack.get_path(name)
        except rospkg.ResourceNotFound:
            if name != package and "mushr_sim" in rospack.list():
                continue  # a student's workspace has the tools under this name
            problem = f"ROS does not find the package {name}: it is not in ROS_PACKAGE_PATH"
            remedy = "In its workspace, type: catkin_make && source devel/setup.bash"
            if hint := similar(name, rospack.list()).rstrip("?"):
                problem += hint
                remedy = "Correct the name, or make and source its workspace"
            if name == PACKAGE:
                remedy = f"Type: source {_setup_file()}"
            found.append(Finding(problem, remedy))
            continue
        find_node = partial(roslib.packages.find_node, name, rospack=rospack)  # reads folders once
        parts = ("src",) if _is_this(folder) else ("", "bin", "nodes", "scripts", "src")
        before = len(found)
        for part in (*parts, f"../../lib/{name}"):  # the last one if it is installed
            found += program_findings(folder, part, find_node)
        built = find_in_workspaces(["libexec"], project=name)
        has_programs = any(map(os.listdir, built)) or _is_this(folder)
        if len(found) == before and not has_programs:
            found += no_program(folder)
    return list(dict.fromkeys(found))


def _is_this(folder: str) -> bool:
    """Return whether a folder is that of this package; a student's can have the same name."""
    return os.path.realpath(folder) == package_folder(".")


def observe(car: str) -> "Facts":
    """Return the facts about the running system, without log output or a log file."""
    logging.disable()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_LOG_DIR"] = folder
        try:
            places = [DEFAULT_MASTER, *masters()]
            return Observer(car, rosgraph.get_master_uri(), masters=places).observe()
        finally:
            sign_off()


def _interrupt(*_: object) -> None:
    """End the observation at the first Ctrl-C; a second one must not interrupt signing off."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def car_name(text: str) -> str:
    """Return the name of a car, such as car or team/car; argparse reports the exception."""
    name = text.strip("/")
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", name, re.ASCII):
        raise argparse.ArgumentTypeError(f"'{text}'; expected the name of a car, such as car2")
    return name


def main() -> int:
    """Print the findings; return the exit status."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly if the output is cut off
    example = "Example: rosrun mushr_ros_intro doctor.py --package my_ros_intro"
    parser = argparse.ArgumentParser(
        prog="doctor.py",
        description="Report why the car does not move, and what to type. The exit status is 0 "
        "without findings, 1 with findings, 2 for wrong arguments.",
        epilog=example if missing else as_typed(example),
    )
    parser.add_argument("--car", metavar="NAME", type=car_name, default="car", help="default: car")
    parser.add_argument(
        "--package",
        metavar="PKG",
        default="",
        help="also check whether the programs of this package can be started",
    )
    arguments = parser.parse_args()
    signal.signal(signal.SIGINT, _interrupt)
    if missing:
        print(import_fault(missing, sys.executable, "ROS_PACKAGE_PATH" in os.environ))
        return 1
    network = network_findings()
    if network:  # the doctor's own node must not use these settings
        for name in ("ROS_HOSTNAME", "ROS_IP"):
            os.environ.pop(name, None)
    try:
        facts = observe(arguments.car)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    if not facts.moves:
        network = network or advertised_findings(facts.master.uri)
    found = [*package_findings(arguments.package), *network]
    found += diagnose(facts, arguments.package)
    lines = [str(each) for each in found] or [health(facts), *hints(facts)]
    for line in [*lines, *last_drive(facts), *left_parameters(facts)]:
        print(as_typed(line))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
