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
    """Raise SystemExit if an argument of roslaunch is not one of its launch files.

    Args:
        command: the command line of roslaunch. If no launch file in it is of this folder, one of
            them includes one that is, and may have any arguments.
    """
    folder = os.path.dirname(os.path.realpath(__file__))
    known, names = [], []
    for package, name in zip(command, command[1:]):
        path = os.path.join(folder, name if package == "mushr_ros_intro" else os.path.abspath(name))
        if name.endswith((".launch", ".xml")) and os.path.isfile(path):
            arguments = ElementTree.parse(path).getroot().findall("arg")
            known += [each.attrib["name"] for each in arguments]
            names += [name] if os.path.dirname(os.path.realpath(path)) == folder else []
    for each in (word.partition(":=")[0] for word in command if ":=" in word):
        if names and each not in known and not each.startswith("__"):
            expected = f"one of {', '.join(known)}{similar(each, known)}"
            sys.exit(f"\n{names[0]}: there is no argument {each}; expected {expected}\n")


def roslaunch_command() -> List[str]:
    """Return the command line of the program that started this one, without the interpreter."""
    with open(f"/proc/{os.getppid()}/cmdline") as file:
        return file.read().split("\0")[1:-1]


if __name__ == "__main__":
    refuse_unknown(roslaunch_command())
    print(sys.argv[1], end="")
