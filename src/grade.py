#!/usr/bin/python3
"""Grade nodes that drive plans: one node, or the submissions of a class.

A node:   grade.py PLAN... --node PACKAGE FILE [--remap FROM:=TO...]
A class:  grade.py SUBMISSION... --plans PLAN... --out FOLDER [--points FILE]
Parts:    grade.py --merge FOLDER... --out FOLDER [--points FILE]

The exit status is 0 if all checks passed, 1 if some failed, 2 if the command line or an input is
wrong, and 3 if a result is missing because grading itself failed.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from typing import Iterable, List

from mushr_ros_intro.classroom import grades, tables
from mushr_ros_intro.classroom.arguments import parse_arguments
from mushr_ros_intro.classroom.grader import grade, job_for, probe, read_setting
from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.points import Points, read_points
from mushr_ros_intro.classroom.submissions import collect
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.parse import read_plans
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.replay.job import ReplayError, Setting, run_job
from mushr_ros_intro.replay.judge import Check, Tolerances
from mushr_ros_intro.replay.report_files import write_report
from mushr_ros_intro.replay.sandbox import Sandbox, make_sandbox
from mushr_ros_intro.replay.workspace import temporary_folder
from mushr_ros_intro.wording import counted

PASSED, FAILED, USAGE, NOT_GRADED = range(4)
"""The exit status."""


def main() -> int:
    """Grade what the command line names; return the exit status."""
    arguments = parse_arguments(sys.argv[1:], __doc__ or "")
    os.environ["ROS_HOSTNAME"] = "localhost"  # works even if the machine's name does not resolve
    try:
        if arguments.merge:
            return merge(arguments)
        return grade_node(arguments) if arguments.node else grade_class(arguments)
    except UserError as error:
        print(f"grade.py: {error}", file=sys.stderr)
        return NOT_GRADED if isinstance(error, ReplayError) else USAGE
    except OSError as error:
        print(f"grade.py: {error}", file=sys.stderr)
    except KeyboardInterrupt:
        print("grade.py: interrupted; no results are written", file=sys.stderr)
    return NOT_GRADED


def setting_from(arguments: argparse.Namespace, sandbox: Sandbox) -> Setting:
    """Return the setting that the command line describes."""
    values = ((name, getattr(arguments, f"{name}_tolerance")) for name in Tolerances._fields)
    return read_setting(
        package_folder("."),
        arguments.car,
        arguments.map,
        arguments.seed,
        remap=tuple(arguments.remap),
        patience=arguments.patience,
        tolerances={name: value for name, value in values if value is not None},
        sandbox=sandbox,
        ros=sandbox.copy_workspaces(),
    )


def open_output(folder: str) -> str:
    """Create the folder of the results, or remove the results of an earlier run; return its path.

    Raises:
        UserError: it contains something else.
    """
    os.makedirs(folder, 0o700, exist_ok=True)
    entries = set(os.listdir(folder))
    if entries and not {grades.FOLDER, "index.html"} <= entries:
        raise UserError(f"--out {folder}: expected a new or empty folder, or an earlier result")
    shutil.rmtree(os.path.join(folder, grades.FOLDER), ignore_errors=True)
    return os.path.realpath(folder)


def grade_node(arguments: argparse.Namespace) -> int:
    """Grade one installed node; print each verdict."""
    setting = setting_from(arguments, Sandbox())
    status = PASSED
    for plan_name, plan in read_plans(arguments.inputs, package_folder("plans")).items():
        job = job_for(arguments.node, plan, setting)
        if arguments.bag:
            os.makedirs(arguments.out, exist_ok=True)
            job = job._replace(bag=os.path.abspath(f"{arguments.out}/{plan_name}.bag"))
        judgement = run_job(job)
        print(judgement.verdict, flush=True)
        status = max(status, PASSED if judgement.passed else FAILED)
        if arguments.out:
            write_report(os.path.join(arguments.out, plan_name), judgement, vars(arguments))
    return status


def grade_class(arguments: argparse.Namespace) -> int:
    """Grade submissions; print a line for each, and write the results."""
    plans = read_plans(arguments.plans, package_folder("plans"))
    check_authors(plans.values(), arguments.inputs)
    points = read_points(arguments.points, list(plans))
    folder = open_output(arguments.out)
    paths = [*arguments.inputs, *(plan.path for plan in plans.values())]
    hidden = [each if os.path.isdir(each) else os.path.dirname(each) for each in paths]
    bags = os.path.join(folder, "bags") if arguments.bag else ""
    if bags:
        os.makedirs(bags, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=temporary_folder()) as workspace:
        os.chmod(workspace, 0o711)
        sandbox, missing = make_sandbox(arguments.user, [*hidden, folder], workspace)
        if missing:
            print(missing, file=sys.stderr)
        setting = setting_from(arguments, sandbox)
        submissions = collect(arguments.inputs, workspace, arguments.file)
        number, count = arguments.shard
        chosen = submissions[number - 1 :: count]
        if len(chosen) != 1 and (arguments.gradescope or arguments.classroom50 or arguments.github):
            raise UserError(
                f"{counted(len(chosen), 'submission')} found; a result for Gradescope, "
                "Classroom 50 or GitHub needs one submission"
            )
        probe(next(iter(plans.values())), setting)
        began = time.monotonic()
        results = []
        for each in grade(chosen, plans, setting, arguments.jobs, bags):
            results.append(each)
            print_line(each, points, len(results), len(chosen))
    print_progress("")
    grades.store(os.path.join(folder, grades.FOLDER), results)
    if len(results) == 1:
        write_special(arguments, results[0], points, time.monotonic() - began)
    return finish(arguments.out, results, points, list(plans))


def check_authors(plans: Iterable[Plan], submissions: Iterable[str]) -> None:
    """Refuse a plan in a submission, whose author may have written it.

    The name figure_8 means figure_8.txt in the current directory, if there is one, and that
    directory may be the checkout of a submission.

    Args:
        plans: the plans.
        submissions: the paths of submissions, or of folders with submissions.

    Raises:
        UserError: a plan is in one of these folders, but not in the folder of this package's plans.
    """
    known = package_folder("plans")
    folders = [os.path.join(os.path.realpath(each), "") for each in submissions]
    for path in (os.path.realpath(plan.path) for plan in plans):
        if os.path.dirname(path) != known and path.startswith(tuple(folders)):
            raise UserError(
                f"{path}: this plan is in a submission, whose author may have written it; expected "
                f"the path of another plan, such as {known}/figure_8.txt"
            )


def merge(arguments: argparse.Namespace) -> int:
    """Put results of several runs together."""
    results: List[Grade] = []
    for folder in arguments.merge:
        try:
            results += grades.load(os.path.join(folder, grades.FOLDER))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise UserError(f"{folder}: not the output of grade.py ({error})") from None
    if not results:
        raise UserError(f"{', '.join(arguments.merge)}: expected at least one result")
    results.sort(key=lambda each: each.name)
    names = [each.name for each in results]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UserError(f"several results for {', '.join(twice)}; expected one for each submission")
    plans = list(dict.fromkeys(plan.plan for each in results for plan in each.plans))
    points = read_points(arguments.points, plans)
    grades.store(os.path.join(open_output(arguments.out), grades.FOLDER), results)
    return finish(arguments.out, results, points, plans)


def finish(folder: str, results: List[Grade], points: Points, plans: List[str]) -> int:
    """Write the tables and pages; print a summary; return the exit status."""
    tables.write_results(folder, results, points, plans)
    passed = sum(each.passed for each in results)
    print(f"{passed} of {counted(len(results), 'submission')} passed; see {folder}/index.html")
    if any(each.error for each in results):
        return NOT_GRADED
    return PASSED if passed == len(results) else FAILED


def write_special(
    arguments: argparse.Namespace, each: Grade, points: Points, seconds: float
) -> None:
    """Write the result of a single submission in the formats of grading services."""
    formats = {
        arguments.gradescope: lambda: tables.gradescope(each, points, seconds),
        arguments.classroom50: lambda: tables.classroom50(each, points, os.environ, time.time()),
        arguments.github: lambda: tables.github(each, points),
    }
    for path, convert in formats.items():
        if path is not None:
            with open(path, "w", encoding="ascii") as file:
                json.dump(convert(), file, indent=2)


def print_line(each: Grade, points: Points, number: int, count: int) -> None:
    """Print the result of a submission, and the progress on a terminal."""
    print_progress("")
    state = "passed" if each.passed else "FAILED"
    text = each.fault.splitlines()[0] if each.fault else ""
    if each.error:
        state, text = "ERROR", each.error.splitlines()[0]
    failed = [f"{plan.plan}: {', '.join(names(plan.checks))}" for plan in each.plans]
    text = text or "; ".join(each for each in failed if not each.endswith(": "))
    text = text or "; ".join(each.notes)
    score = f"{points.score(each):g}/{points.max_score():g}"
    print(f"{each.name:30s} {state} {score:>7s} {text}"[:200].rstrip(), flush=True)
    print_progress(f"[{'#' * (40 * number // count):40s}] {number} of {count}")


def names(checks: Iterable[Check]) -> List[str]:
    """Return the names of the checks that failed."""
    return [check.name for check in checks if not check.passed]


def print_progress(text: str) -> None:
    """Replace the line of progress, which is shown on a terminal only."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
