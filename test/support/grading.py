"""Run grade.py, and read its results."""

import glob
import json
import subprocess

import pytest
from roslib.packages import find_node

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
    texts = []
    for path in sorted(glob.glob(f"{folder}/data/*.json")):
        texts.append(verdicts_of(load(path)))
    return "\n".join(texts)


def load(path):
    """Return a stored result, with the verdicts on its drives as `plans`."""
    with open(path) as file:
        result = json.load(file)
    return {**result, "plans": [each["grade"] for each in result["drives"].values()]}


def verdicts_of(result):
    """Return a result as text: why there is no verdict, or the verdict on each plan."""
    reasons = (result["name"], result["fault"], result["error"])
    return "\n".join((*reasons, *(plan["verdict"] for plan in result["plans"] if plan)))
