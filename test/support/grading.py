"""Run grade.py, and read its results."""

import glob
import os
import subprocess

import pytest
from roslib.packages import find_node

from mushr_ros_intro.classroom.grades import PlanGrade
from mushr_ros_intro.classroom.store import load_all
from mushr_ros_intro.replay.following import judge_drive
from support.helpers import ForkedProcess, Process

PLAN = "0,0,0.5\n1.0,0.1\n2.0,-0.1\n1.5,0.2\n1.0,-0.2\n"
_PROBE = ("bwrap", "--unshare-user", "--unshare-pid", "--bind", "/", "/", "--proc", "/proc", "true")
ISOLATED = pytest.mark.skipif(
    subprocess.run(_PROBE, stderr=subprocess.DEVNULL).returncode != 0,
    reason="this system refuses namespaces, so that grade.py cannot isolate nodes",
)
PRIVILEGED = pytest.mark.skipif(
    subprocess.run(["unshare", "--mount", "--uts", "true"], capture_output=True).returncode != 0,
    reason="only root may mount, or rename a machine, and not in a container without privileges",
)

_FILTER = """
import os, sys
from mushr_ros_intro.isolation.system_calls import make_filter
make_filter(has_locks=True).load()
os.execvp(sys.argv[1], sys.argv[1:])
"""
WITHOUT_NAMESPACES = ("/usr/bin/python3", "-c", _FILTER)
"""Runs a command as in a container whose filter of system calls forbids namespaces."""


def grade(*arguments, prefix=(), **environment):
    """Run grade.py, in a fork if there is no prefix; return its exit status and its output."""
    command = (*prefix, find_node("mushr_ros_intro", "grade.py")[0], *arguments)
    kind = Process if prefix else ForkedProcess
    with kind(*map(str, command), **environment) as process:
        return process.wait(300), process.output


def assert_status(expected, *arguments, **options):
    """Run grade.py, and check its exit status; return its output."""
    status, output = grade(*arguments, **options)
    assert status == expected, output + verdicts(arguments)
    return output


def verdicts(arguments):
    """Return the results in the folder after --out."""
    folder = dict(zip(arguments, arguments[1:])).get("--out", "")
    return "\n".join(map(verdicts_of, map(load, sorted(glob.glob(f"{folder}/data/*.json")))))


def load(path):
    """Return the result of a stored submission, judged with the default tolerances."""
    folder, name = os.path.split(os.path.dirname(path))[0], os.path.basename(path)
    (grade,) = (each for each in load_all(folder) if f"{each.name}.json" == name)
    drives = [each for each in grade.drives if each.recorded]
    plans = (PlanGrade(each.plan, judge_drive(each.recorded, {})) for each in drives)
    return grade._replace(plans=tuple(plans))


def verdicts_of(result):
    """Return a result as text: why there is no verdict, or the verdict on each plan."""
    reasons = (result.name, result.fault, result.error)
    return "\n".join((*reasons, *(plan.judgement.verdict for plan in result.plans)))
