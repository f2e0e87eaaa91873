"""Drives in a folder that grade.py, replay.test or compare_drive.py has written."""

import json
import os
from typing import Any, Dict, Iterator, Tuple

import numpy as np

from mushr_ros_intro.classroom.grades import thinned
from mushr_ros_intro.classroom.store import FOLDER, load_all
from mushr_ros_intro.errors import UserError


def list_drives(folder: str) -> Dict[str, Any]:
    """Return the names of the drives in a folder, and whether they passed; None if not graded.

    Raises:
        UserError: a folder or a file cannot be read.
    """
    found = drives(folder)
    return {"results": [{"name": name, "passed": found[name]["passed"]} for name in found]}


def drive_named(folder: str, name: str) -> Dict[str, Any]:
    """Return the drive with a name.

    Raises:
        UserError: a folder or a file cannot be read.
        LookupError: there is no such drive.
    """
    found = drives(folder)
    if name not in found:
        raise LookupError(f"there is no result {name!r}")
    return {"name": name, **found[name]}


def drives(folder: str) -> Dict[str, Dict[str, Any]]:
    """Return the drives in a folder by their names, such as SUBMISSION/PLAN or PLAN.

    Files that are something else are skipped. See docs/view.md for the values.

    Raises:
        UserError: a folder or a file cannot be read.
    """
    try:
        return dict(sorted([*_of_class(folder), *_of_node(folder)]))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder} cannot be read: {error}") from None


def _of_class(folder: str) -> Iterator[Tuple[str, Dict[str, Any]]]:
    if not os.path.isdir(os.path.join(folder, FOLDER)):
        return
    for each in (record.grade for record in load_all(folder)):
        for plan in each.plans:
            if plan.times:
                yield (
                    f"{each.name}/{plan.plan}",
                    {
                        "passed": plan.passed,
                        "verdict": plan.verdict,
                        "times": plan.times,
                        "driven": plan.driven,
                        "predicted": plan.predicted,
                    },
                )


def _raise(error: OSError) -> None:
    raise error


def _of_node(folder: str) -> Iterator[Tuple[str, Dict[str, Any]]]:
    """Yield the drives of one node: a report in the folder, or in a folder for each plan."""
    for place, _, files in os.walk(folder, onerror=_raise):
        if {"report.json", "trajectory.csv"} <= set(files):
            with open(os.path.join(place, "report.json"), encoding="utf-8") as file:
                report = json.load(file)
            path = os.path.join(place, "trajectory.csv")
            rows = thinned(np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)).tolist()
            yield (
                os.path.relpath(place, folder),
                {
                    "passed": report["passed"],
                    "verdict": "\n".join(report["verdict"]),
                    "times": [row[0] for row in rows],
                    "driven": [row[1:4] for row in rows],
                    "predicted": [row[4:7] for row in rows],
                },
            )
