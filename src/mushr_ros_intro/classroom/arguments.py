"""The command line of grade.py."""

import argparse
import os
import re
import sys
from typing import Any, Dict, List, Sequence

from mushr_ros_intro.classroom.drawn_plans import DRAWN
from mushr_ros_intro.classroom.store import load_settings
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.parse import read_named_plan
from mushr_ros_intro.replay.reference import Exercise, read_references
from mushr_ros_intro.ros.commands import as_typed

_DEFAULTS: Dict[str, Any] = {
    **{"file": "path_publisher.py", "points": None, "remap": [], "params": ""},
    **{"car": "ideal", "map": None},
}
"""The options that a results folder remembers, and their defaults."""

_OF_A_CLASS = ("secret", "jobs", "gradescope")
"""Options that `--node` does not use."""


def _add_exercise_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what submissions do, and how it is judged.

    An autograder gives them to grade.py. Each of them takes a value; None if it is not given.
    """
    add = parser.add_argument
    add("--file", help="the node in each submission; default path_publisher.py")
    help_text = "names in plans/, or paths; drawn: a plan of its own for each submission"
    add("--plans", nargs="+", metavar="PLAN", help=help_text)
    help_text = "determines the drawn plans, together with the name of the submission"
    add("--secret", metavar="TEXT", help=help_text)
    add("--follow", nargs="+", metavar="PATH", help="grade controllers that follow these paths")
    add("--points", metavar="FILE", help="points per check and plan, and tolerances")
    add("--remap", nargs="+", metavar="FROM:=TO", help="for the nodes, as for rosrun")
    add("--params", metavar="FILE", help="parameters of the node; in each submission")
    add("--car", help="as in sim.launch; default ideal")
    add("--map", help="as in sim.launch; default sandbox, or none with --follow")


def words_of(options: Dict[str, Any]) -> List[str]:
    """Return the options that have a value as words of a command line."""
    words = []
    for name, value in options.items():
        if value not in (None, "", []):
            values = value if isinstance(value, list) else [value]
            option = f"--{name.replace('_', '-')}"
            is_like_option = values == [value] and str(value).startswith(("-", "@"))
            words += [f"{option}={value}"] if is_like_option else [option, *map(str, values)]
    return words


def _use_settings(arguments: argparse.Namespace) -> None:
    """Set the options that are not given to those of the earlier run in --out, or the defaults.

    Say which ones of the earlier run are used.

    Raises:
        UserError: the settings of the earlier run cannot be read.
    """
    is_class = arguments.out and not (arguments.node or arguments.autograder)
    folders = arguments.merge or ([arguments.out] if is_class else [])
    all_known = [load_settings(folder) for folder in folders]
    used = {}
    for name, default in _DEFAULTS.items():
        if getattr(arguments, name) is None:
            values = [known.get(name, default) for known in all_known] or [default]
            if any(_content(name, each) != _content(name, values[0]) for each in values):
                option = f"--{name.replace('_', '-')}"
                text = f"the folders of --merge have different values of {option}; expected one"
                raise UserError(f"{text} on the command line")
            setattr(arguments, name, values[0])
            if values[0] != default:
                used[name] = values[0]
    if used:
        print(f"{folders[0]}: as in the earlier run: {' '.join(words_of(used))}", file=sys.stderr)


def _content(name: str, value: Any) -> Any:
    """Return the value of an option to compare; of a file with points, its text."""
    if name != "points" or value is None:
        return value
    with open(value, "rb") as file:
        return file.read()


def _complete(arguments: argparse.Namespace) -> str:
    """Set the default map; return what is wrong with the options of exercises, "" if nothing."""
    arguments.map = arguments.map or ("none" if arguments.follow else "sandbox")
    for each in arguments.remap:
        if not re.fullmatch(r"[^:=\s]+:=[^:=\n]+", each):
            return f"found --remap '{each}'; expected --remap FROM:=TO, such as control:=/cmd"
    if not re.fullmatch(r"[^-/\s][^/\n]*", arguments.file):
        return f"found --file '{arguments.file}'; expected a file name without a folder"
    if not arguments.node and (
        os.path.isabs(arguments.params) or ".." in arguments.params.split("/")
    ):
        return f"found --params '{arguments.params}'; expected the path of a file in a submission"
    if (DRAWN in (arguments.plans or [])) != bool(arguments.secret):
        return f"expected --secret TEXT together with {DRAWN} in --plans"
    return ""


def read_exercises(arguments: argparse.Namespace, plans: Sequence[str]) -> Dict[str, Exercise]:
    """Return by name what a node has to do: the paths of --follow, or plans.

    Raises:
        UserError: a file is missing, or has faults, or two have the same name.
    """
    if arguments.follow:
        return {**read_references(arguments.follow, package_folder("plans"))}
    found: Dict[str, Exercise] = {}
    for plan in (read_named_plan(each) for each in plans if each != DRAWN):
        if plan.name in found:
            raise UserError(f"{plan.path}: there are two plans with the name '{plan.name}'")
        found[plan.name] = plan
    return found


def parse_arguments(words: Sequence[str], description: str) -> argparse.Namespace:
    """Return the command line; exit with status 2 if it is wrong."""
    form = argparse.RawDescriptionHelpFormatter
    usage = "grade.py PLAN... --node PACKAGE FILE [OPTION...]\n       grade.py SUBMISSION... "
    usage += "--plans PLAN... --out FOLDER [OPTION...]"
    example = as_typed(
        "Example: rosrun mushr_ros_intro grade.py test_drive --node my_ros_intro path_publisher.py"
    )
    parser = argparse.ArgumentParser(
        "grade.py",
        usage,
        description=description,
        epilog=example,
        formatter_class=form,
        fromfile_prefix_chars="@",  # of an autograder: a node could read a command line
    )
    add = parser.add_argument
    add("inputs", nargs="*", metavar="PLAN or SUBMISSION")
    add("--node", nargs=2, metavar=("PACKAGE", "FILE"), help="the node, as for rosrun")
    _add_exercise_options(parser)
    add("--out", metavar="FOLDER", help="write the results to this folder")
    add("--jobs", type=int, default=2 * len(os.sched_getaffinity(0)), help="simultaneous replays")
    add("--merge", nargs="+", metavar="FOLDER", help="put the results of several runs together")
    add("--gradescope", metavar="FILE", help="also write results.json of one submission")
    add("--autograder", metavar="FILE", help="write a zip for Gradescope; grade nothing")
    arguments = parser.parse_args(words)
    values = vars(arguments)
    given = [name for name in _OF_A_CLASS if values[name] != parser.get_default(name)]
    if fault := _fault(arguments, given):
        parser.error(fault)
    _use_settings(arguments)
    arguments.settings = {
        name: values[name] for name, default in _DEFAULTS.items() if values[name] != default
    }
    if fault := _complete(arguments):
        parser.error(fault)
    return arguments


def _fault(arguments: argparse.Namespace, of_a_class: Sequence[str]) -> str:
    """Return what is wrong with the combination of arguments; "" if nothing.

    `of_a_class` contains the options that need submissions.
    """
    is_class = not (arguments.node or arguments.merge or arguments.autograder)
    plans = arguments.plans or arguments.follow
    grades = arguments.inputs or plans or arguments.node or arguments.autograder or of_a_class
    if arguments.merge and (grades or not arguments.out):
        return "expected --merge FOLDER... --out FOLDER without submissions: it grades nothing"
    if arguments.node and of_a_class:
        option = of_a_class[0].replace("_", "-")
        return f"--{option} needs submissions; --node grades one installed node"
    if arguments.follow and arguments.plans:
        return "expected --follow or --plans"
    if arguments.node and (arguments.plans or bool(arguments.inputs) == bool(arguments.follow)):
        return "expected PLAN... --node PACKAGE FILE, or --follow PATH... --node PACKAGE FILE"
    if is_class and not (arguments.inputs and plans and arguments.out):
        return "expected PLAN... --node PACKAGE FILE, or SUBMISSION... --plans PLAN... --out FOLDER"
    if arguments.autograder and (arguments.inputs or not plans):
        return "expected --autograder FILE, and --plans PLAN... or --follow PATH..."
    if arguments.out and os.path.exists(arguments.out) and not os.path.isdir(arguments.out):
        return f"--out: {arguments.out} is not a folder"
    if arguments.jobs < 1:
        return "expected --jobs of at least 1"
    return ""
