"""Refuse an argument that the launch file does not have: check_arguments.py VALUE.

roslaunch ignores such arguments, so a wrong name would start something else. The launch files of
this package set a parameter to the output of this program, which is VALUE. Otherwise it prints a
message and exits with status 1; then roslaunch starts no node.
"""

import os
import sys
import xml.etree.ElementTree as ElementTree
from typing import List

from mushr_ros_intro.wording import similar


def refuse_unknown(command: List[str]) -> None:
    """Raise SystemExit if an argument of roslaunch is not one of a launch file in this folder.

    Args:
        command: the command line of roslaunch. A launch file that is not in this folder may
            include one that is.
    """
    folder = os.path.dirname(os.path.realpath(__file__))
    given = [each.partition(":=")[0] for each in command if ":=" in each]
    for package, name in zip(command, command[1:]):
        path = os.path.join(folder, name if package == "mushr_ros_intro" else os.path.abspath(name))
        if not name.endswith(".launch") or os.path.dirname(os.path.realpath(path)) != folder:
            continue
        known = [each.attrib["name"] for each in ElementTree.parse(path).getroot().findall("arg")]
        for each in given:
            if each not in known and not each.startswith("__"):
                expected = f"one of {', '.join(known)}{similar(each, known)}"
                sys.exit(f"\n{name}: there is no argument {each}; expected {expected}\n")


def roslaunch_command() -> List[str]:
    """Return the command line of the program that started this one, without the interpreter."""
    with open(f"/proc/{os.getppid()}/cmdline") as file:
        return file.read().split("\0")[1:-1]


if __name__ == "__main__":
    refuse_unknown(roslaunch_command())
    print(sys.argv[1], end="")
