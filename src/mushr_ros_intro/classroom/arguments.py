"""The command line of grade.py."""

import argparse
import os
import re
from contextlib import suppress
from typing import Dict, Sequence

from mushr_ros_intro.classroom.drawn_plans import DRAWN
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.parse import read_plans
from mushr_ros_intro.replay.following import TOLERANCE_UNITS, tolerance_fault
from mushr_ros_intro.replay.reference import OFFSETS, Exercise, read_references
from mushr_ros_intro.ros.commands import as_typed

_OF_A_CLASS = (
    *("secret", "points", "jobs", "only", "rejudge"),
    "gradescope",
)
"""Options that `--node` does not use."""


def tolerance(text: str) -> float:
    """Return a number that is not negative; raise ArgumentTypeError for any other text."""
    with suppress(ValueError):
        if float(text) >= 0.0:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r}; expected a number of at least 0")


def add_exercise_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what submissions do, and how it is judged.

    An autograder has these options, and gives them to grade.py. Each of them takes a value.
    """
    add = parser.add_argument
    add("--file", default="path_publisher.py", help="the node in each submission")
    help_text = "names in plans/, or paths; drawn: a plan of its own for each submission"
    add("--plans", nargs="+", metavar="PLAN", help=help_text)
    help_text = "determines the drawn plans, together with the name of the submission"
    add("--secret", default="", metavar="TEXT", help=help_text)
    add("--follow", nargs="+", metavar="PATH", help="grade controllers that follow these paths")
    add("--starts", type=int, default=1, help="start each path of --follow at so many poses")
    add("--points", metavar="FILE", help="points per check and plan; default one point each")
    add("--remap", nargs="+", default=[], metavar="FROM:=TO", help="for the nodes, as for rosrun")
    add("--params", default="", metavar="FILE", help="parameters of the node; in each submission")
    add("--car", default="ideal", help="as in sim.launch; default ideal")
    add("--map", help="as in sim.launch; default sandbox, or none with --follow")
    for name, unit in TOLERANCE_UNITS.items():
        option = f"--{name.replace('_', '-')}-tolerance"
        add(option, type=tolerance, metavar=unit, help="see docs/grading.md")


def complete(arguments: argparse.Namespace) -> str:
    """Set the default map; return what is wrong with the options of exercises, "" if nothing."""
    arguments.map = arguments.map or ("none" if arguments.follow else "sandbox")
    if not 1 <= arguments.starts <= len(OFFSETS):
        return f"expected --starts of 1 to {len(OFFSETS)}"
    for each in arguments.remap:
        if not re.fullmatch(r"[^:=\s]+:=[^:=\n]+", each):
            return f"found --remap '{each}'; expected --remap FROM:=TO, such as control:=/cmd"
    if not re.fullmatch(r"[^-/\s][^/\n]*", arguments.file):
        return f"found --file '{arguments.file}'; expected a file name without a folder"
    is_node = getattr(arguments, "node", None)  # make_autograder has no such option
    if not is_node and (os.path.isabs(arguments.params) or ".." in arguments.params.split("/")):
        return f"found --params '{arguments.params}'; expected the path of a file in a submission"
    if (DRAWN in (arguments.plans or [])) != bool(arguments.secret):
        return f"expected --secret TEXT together with {DRAWN} in --plans"
    values = ((name, getattr(arguments, f"{name}_tolerance")) for name in TOLERANCE_UNITS)
    given = [name for name, value in values if value is not None]
    return tolerance_fault(given, bool(arguments.follow))


def read_exercises(arguments: argparse.Namespace, plans: Sequence[str]) -> Dict[str, Exercise]:
    """Return by name what a node has to do: the paths of --follow, or plans.

    Raises:
        UserError: a file is missing, or has faults.
    """
    folder = package_folder("plans")
    if arguments.follow:
        return {**read_references(arguments.follow, folder, arguments.starts)}
    return {**read_plans([each for each in plans if each != DRAWN], folder)}


def parse_arguments(words: Sequence[str], description: str) -> argparse.Namespace:
    """Return the command line; exit with status 2 if it is wrong."""
    form = argparse.RawDescriptionHelpFormatter
    usage = "grade.py PLAN... --node PACKAGE FILE [OPTION...]\n       grade.py SUBMISSION... "
    usage += "--plans PLAN... --out FOLDER [OPTION...]"
    example = as_typed(
        "Example: rosrun mushr_ros_intro grade.py test_drive --node my_ros_intro path_publisher.py"
    )
    parser = argparse.ArgumentParser(
        "grade.py", usage, description=description, epilog=example, formatter_class=form
    )
    add = parser.add_argument
    add("inputs", nargs="*", metavar="PLAN or SUBMISSION")
    add("--node", nargs=2, metavar=("PACKAGE", "FILE"), help="the node, as for rosrun")
    add_exercise_options(parser)
    add("--out", metavar="FOLDER", help="write the results to this folder")
    add("--timeout", type=float, default=15.0, metavar="S", help="a node may send nothing so long")
    add("--jobs", type=int, default=2 * len(os.sched_getaffinity(0)), help="simultaneous replays")
    add(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME",
        help="grade these submissions again; also names of students",
    )
    add("--rejudge", action="store_true", help="judge stored drives again; drive nothing")
    add("--merge", nargs="+", metavar="FOLDER", help="put the results of several runs together")
    add("--gradescope", metavar="FILE", help="also write results.json of one submission")
    arguments = parser.parse_args(words)
    values = vars(arguments)
    given = [name for name in _OF_A_CLASS if values[name] != parser.get_default(name)]
    if fault := complete(arguments) or _fault(arguments, given):
        parser.error(fault)
    return arguments


def _fault(arguments: argparse.Namespace, of_a_class: Sequence[str]) -> str:
    """Return what is wrong with the combination of arguments; "" if nothing.

    `of_a_class` contains the options that need submissions.
    """
    is_class = not (arguments.node or arguments.merge)
    if arguments.node and of_a_class:
        option = of_a_class[0].replace("_", "-")
        return f"--{option} needs submissions; --node grades one installed node"
    if arguments.follow and arguments.plans:
        return "expected --follow or --plans"
    if arguments.node and (arguments.plans or bool(arguments.inputs) == bool(arguments.follow)):
        return "expected PLAN... --node PACKAGE FILE, or --follow PATH... --node PACKAGE FILE"
    plans = arguments.plans or arguments.follow
    if is_class and not (arguments.inputs and plans and arguments.out):
        return "expected PLAN... --node PACKAGE FILE, or SUBMISSION... --plans PLAN... --out FOLDER"
    if arguments.merge and not arguments.out:
        return "expected --out FOLDER"
    if arguments.out and os.path.exists(arguments.out) and not os.path.isdir(arguments.out):
        return f"--out: {arguments.out} is not a folder"
    if arguments.jobs < 1 or not arguments.timeout > 0.0:
        return "expected --jobs of at least 1 and --timeout above 0"
    return ""
