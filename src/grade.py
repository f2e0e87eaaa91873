#!/usr/bin/python3
"""Grade nodes that drive plans: one node, or the submissions of a class.

A node:   grade.py PLAN... --node PACKAGE FILE [--remap FROM:=TO...]
          grade.py --follow PATH... --node PACKAGE FILE
A class:  grade.py SUBMISSION... --plans PLAN... --out FOLDER [--points FILE]
Results:  grade.py --merge FOLDER... --out FOLDER [--points FILE]
A zip:    grade.py --autograder FILE --plans PLAN... [--points FILE]   (for Gradescope)

A class may be interrupted: the same command grades only what is missing or has changed.
Exit status: 0 if all checks passed, 1 if some failed, 2 if the command line or an input is wrong,
3 if a result is missing because grading itself failed or was interrupted; scripts/grade ends with
130 after Ctrl-C.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import traceback
from typing import Any, Dict, List

from mushr_ros_intro.classroom import tables
from mushr_ros_intro.classroom.arguments import parse_arguments, read_exercises
from mushr_ros_intro.classroom.assignment import Plans, setting_from
from mushr_ros_intro.classroom.autograders import write_autograder
from mushr_ros_intro.classroom.grades import Grade
from mushr_ros_intro.classroom.gradescope import gradescope
from mushr_ros_intro.classroom.grading import Grading, Task, judged, judges
from mushr_ros_intro.classroom.points import Points, read_points
from mushr_ros_intro.classroom.progress import grade_with_progress
from mushr_ros_intro.classroom.store import Store, give_to_user, load_all, make_folder, write_text
from mushr_ros_intro.classroom.submissions import collect
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox, make_sandbox
from mushr_ros_intro.isolation.workspace import temporary_folder
from mushr_ros_intro.replay.job import run_job
from mushr_ros_intro.replay.own_process import ReplayError
from mushr_ros_intro.replay.reference import Reference, refuse_walls
from mushr_ros_intro.replay.report_files import write_report
from mushr_ros_intro.replay.setting import job_for
from mushr_ros_intro.wording import counted

PASSED, FAILED, USAGE, NOT_GRADED = range(4)
"""The exit status."""


def main() -> int:
    """Grade what the command line names; return the exit status."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly if the output of --help is cut off
    try:
        arguments = parse_arguments(sys.argv[1:], __doc__ or "")
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        os.environ["ROS_HOSTNAME"] = "localhost"  # works if the machine's name does not resolve
        signal.signal(signal.SIGINT, interrupt)
        signal.signal(signal.SIGTERM, interrupt)
        if arguments.autograder:
            print(write_autograder(arguments))
            return PASSED
        if arguments.merge:
            return merge(arguments)
        return grade_node(arguments) if arguments.node else grade_class(arguments)
    except UserError as error:
        print(f"grade.py: {error}", file=sys.stderr)
        return NOT_GRADED if isinstance(error, ReplayError) else USAGE
    except OSError as error:
        print(f"grade.py: {error}", file=sys.stderr)
    except KeyboardInterrupt:
        print("grade.py: interrupted", file=sys.stderr)
    except Exception:  # a defect of grading: 1 would mean that the node has failed
        traceback.print_exc()
    return NOT_GRADED


def interrupt(*_: Any) -> None:
    """Interrupt the grading, once: scripts/grade sends the signal of Ctrl-C again."""
    for each in (signal.SIGINT, signal.SIGTERM):
        # Not SIG_IGN: Python prints an error if a signal has arrived just before.
        signal.signal(each, lambda *_: None)
    raise KeyboardInterrupt


def grade_node(arguments: argparse.Namespace) -> int:
    """Grade one installed node; print each verdict."""
    exercises = read_exercises(arguments, arguments.inputs)
    points = read_points(arguments.points, exercises, bool(arguments.follow))
    setting = setting_from(arguments, Sandbox(), points.tolerances)
    status = PASSED
    refuse_walls(exercises.values(), setting.parameters, setting.grid)
    for plan_name, plan in exercises.items():
        job = job_for(arguments.node, plan, setting)
        report = os.path.join(arguments.out or "", plan_name)
        if arguments.out:
            make_folder(report)
        judgement = run_job(job)
        print(judgement.verdict, flush=True)
        status = max(status, PASSED if judgement.passed else FAILED)
        if arguments.out:
            write_report(report, judgement)
            for each in os.scandir(report):
                give_to_user(each.path)
    return status


def grade_class(arguments: argparse.Namespace) -> int:
    """Grade submissions; print a line for each new result, and write the results."""
    plans = Plans(arguments)
    points = read_points(arguments.points, plans.names, bool(arguments.follow))
    folder = os.path.realpath(arguments.out)
    for each in filter(os.path.isdir, arguments.inputs):
        if f"{folder}/".startswith(f"{os.path.realpath(each)}/"):
            text = f"--out {arguments.out} is in {each}, which is graded"
            raise UserError(f"{text}; expected a folder outside of the submissions")
    store = Store(arguments.out)
    inputs = [each if os.path.isdir(each) else os.path.dirname(each) for each in arguments.inputs]
    hidden = [*inputs, *map(os.path.dirname, plans.paths), folder]
    with tempfile.TemporaryDirectory(dir=temporary_folder()) as workspace:
        os.chmod(workspace, 0o711)
        sandbox, missing = make_sandbox(hidden, workspace)
        if missing:
            print(missing, file=sys.stderr)
        setting = setting_from(arguments, sandbox, points.tolerances)
        plans.check_map(setting)
        found = collect(arguments.inputs, workspace, arguments.file)
        if len(found) != 1 and arguments.gradescope:
            text = f"found {counted(len(found), 'submission')}; --gradescope needs one"
            raise UserError(text)
        tasks = [Task(each, plans.of(each, setting)) for each in found]
        store.save_settings(arguments.settings)
        grading = Grading(setting, store, arguments.jobs, missing, arguments.params)
        results = grade_with_progress(grading, tasks, points)
    if arguments.gradescope:
        report = json.dumps(gradescope(results[0], points), indent=2)
        write_text(arguments.gradescope, report)
    return finish(arguments.out, results, points)


def merge(arguments: argparse.Namespace) -> int:
    """Put results of several runs together; of several of a submission, the last one counts."""
    grades: Dict[str, Grade] = {}
    for folder in arguments.merge:
        for each in load_all(folder):
            if each.name in grades:
                print(f"{each.name}: that of {folder} is used", file=sys.stderr)
            grades[each.name] = each
    if not grades:
        raise UserError(f"{', '.join(arguments.merge)}: expected at least one result")
    store = Store(arguments.out)
    store.save_settings(arguments.settings)
    stored = [grades[name] for name in sorted(grades)]
    for each in stored:
        store.save(each)
    drives = [drive for each in stored for drive in each.drives]
    plans = dict.fromkeys(each.plan for each in drives)
    follows = any(each.recorded and isinstance(each.recorded.plan, Reference) for each in drives)
    # If no submission could be run, there are no points.
    points = read_points(arguments.points, plans, follows) if plans else Points()
    with judges() as pool:
        results = judged(stored, points.tolerances, pool)
    return finish(arguments.out, results, points)


def finish(folder: str, results: List[Grade], points: Points) -> int:
    """Write the tables and pages; print a summary; return the exit status."""
    tables.write_results(folder, results, points)
    passed = sum(each.passed for each in results)
    missing = sum(bool(each.error) for each in results)
    text = f"{passed} of {counted(len(results), 'submission')} passed"
    text += f", {missing} not graded" if missing else ""
    print(f"{text}; see {folder}/index.html")
    if missing:
        return NOT_GRADED
    return PASSED if passed == len(results) else FAILED


if __name__ == "__main__":
    sys.exit(main())
