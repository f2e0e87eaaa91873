#!/usr/bin/python3
"""Say why the car does not move, and what to type. Looks at the running system, changes nothing.

It is no node: it asks the master and the nodes, and listens to each publisher on the way to the
car by itself, so that it sees who sends what. Nothing that it waits for takes longer than a few
seconds, whoever is stopped or gone.
"""

import argparse
import glob
import ipaddress
import os
import re
import shlex
import shutil
import signal
import socket
import sys
from contextlib import suppress
from typing import List

try:
    import rosgraph
    import rospkg
    import roswtf.context
    import roswtf.network

    from mushr_ros_intro.doctor import rules
    from mushr_ros_intro.doctor.facts import Finding
    from mushr_ros_intro.ros.observation import Doctor

    missing = ""
except ImportError as error:  # the workspace is not sourced; main() says so
    missing = error.name or str(error)

PACKAGE = "mushr_ros_intro"


def look_at_files(package: str) -> List["Finding"]:
    """See whether this package and `package` are known to ROS and their programs can be started."""
    rospack = rospkg.RosPack()
    found = []
    for name in dict.fromkeys((PACKAGE, package)):
        try:
            folder = rospack.get_path(name)
        except rospkg.ResourceNotFound:
            found.append(
                Finding(
                    f"ROS does not know the package {name}: it is not in ROS_PACKAGE_PATH",
                    f"Type: source {_setup_file()}"
                    if name == PACKAGE
                    else "In the workspace that it is in, type: catkin_make && "
                    "source devel/setup.bash",
                )
            )
            continue
        installed = os.path.join(folder, "..", "..", "lib", name)
        inside = ("src",) if name == PACKAGE else ("", "bin", "nodes", "scripts", "src")
        for each in (*(os.path.join(folder, part) for part in inside), installed):
            found += _look_at_programs(os.path.normpath(each))
    return found


def _look_at_programs(folder: str) -> List["Finding"]:
    """See whether the programs in a folder can be started."""
    found = []
    for path in sorted(glob.glob(os.path.join(glob.escape(folder), "*"))):
        if not os.path.isfile(path) or os.path.basename(path) == "setup.py":
            continue
        try:
            with open(path, "rb") as file:
                text = file.read(100_000)
        except OSError:
            continue
        is_python = path.endswith(".py") and re.search(rb"__main__|\binit_node\(", text)
        if text.startswith(b"#!") or is_python:
            line = text.split(b"\n")[0] + b"\n"
            fault = rules.program_fault(path, os.access(path, os.X_OK), line, _is_program)
            found += [fault] if fault else []
    return found


def _is_program(name: str) -> bool:
    """Say whether a program is there: a path, or a name to be looked for."""
    return shutil.which(name) is not None


def import_fault(name: str, python: str, is_sourced: bool) -> str:
    """Return why Python does not find a module of ROS, and what to type.

    Args:
        name: of the module.
        python: the path of the Python that runs this.
        is_sourced: whether some workspace is sourced.
    """
    what = f"{python} does not find {name}:"
    if os.path.realpath(python) != os.path.realpath("/usr/bin/python3"):
        return (
            f"{what} it is not the Python that ROS is made for. "
            f"Type: /usr/bin/python3 {shlex.quote(os.path.realpath(__file__))}"
        )
    if is_sourced and name.split(".")[0] not in (PACKAGE, "ackermann_msgs"):
        return f"{what} it is not installed. Type: sudo apt-get install python3-{name}"
    return f"{what} the workspace is not sourced in this terminal. Type: source {_setup_file()}"


def _setup_file() -> str:
    """Return the file to be sourced so that ROS knows this package, as a shell takes it."""
    folder = os.path.dirname(os.path.realpath(__file__))
    while folder != os.path.dirname(folder):
        folder = os.path.dirname(folder)
        for each in ("setup.bash", "devel/setup.bash", "build/.workspace/devel/setup.bash"):
            path = os.path.join(folder, each)
            if os.path.isfile(path):
                return shlex.quote(path)
    return "devel/setup.bash"


def look_at_network() -> List["Finding"]:
    """Return what roswtf finds wrong with ROS_HOSTNAME and ROS_IP."""
    context = roswtf.context.WtfContext.from_env()
    with suppress(OSError):  # a machine that does not know its own name
        roswtf.network.wtf_check(context)
    # On a machine whose localhost is ::1 first, roswtf does not know it for a local address.
    knows_better = _is_loopback(os.environ.get("ROS_HOSTNAME", ""))
    return [
        Finding(
            " ".join(each.msg.split()).rstrip("."),
            "Set it right, in every terminal; if everything runs on this machine, type: "
            "export ROS_HOSTNAME=localhost",
        )
        for each in context.warnings
        if not (knows_better and "ROS_HOSTNAME may be incorrect" in each.msg)
    ]


def _is_loopback(name: str) -> bool:
    """Say whether a host's name stands for this machine's loopback interface."""
    try:
        addresses = [each[4][0] for each in socket.getaddrinfo(name, 0)] if name else []
    except OSError:
        return False
    return bool(addresses) and all(ipaddress.ip_address(each).is_loopback for each in addresses)


def _parser() -> argparse.ArgumentParser:
    """Return what reads the command line; it ends the program with status 2 on a bad one."""
    parser = argparse.ArgumentParser(
        prog="doctor.py",
        description="Say why the car does not move, and what to type. Ends with status 0 if "
        "nothing is wrong, 1 if something is, 2 if it has been called wrongly.",
    )
    parser.add_argument("--car", metavar="NAME", type=_name, default="car", help="default car")
    parser.add_argument(
        "--package",
        metavar="PKG",
        default=PACKAGE,
        help="see as well whether the programs of this package, such as yours, can be started",
    )
    return parser


def _name(text: str) -> str:
    """Return the name of a car, such as car or team/car."""
    name = text.strip("/")
    if not re.fullmatch(r"[A-Za-z]\w*(/[A-Za-z]\w*)*", name, re.ASCII):
        raise argparse.ArgumentTypeError(f"'{text}'; expected the name of a car, such as car2")
    return name


def main() -> int:
    """Look, and say what is wrong; return the exit status."""
    arguments = _parser().parse_args()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    if missing:
        print(import_fault(missing, sys.executable, "ROS_PACKAGE_PATH" in os.environ))
        return 1
    faults = look_at_files(arguments.package) + look_at_network()
    facts = Doctor(arguments.car, rosgraph.get_master_uri()).look(faults)
    findings = rules.diagnose(facts)
    for line in [str(each) for each in findings] or [rules.health(facts)]:
        print(line)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
