"""Drives in a folder that grade.py or replay.test has written."""

import json
import os
from typing import Any, Dict, Iterator, Tuple

import numpy as np

from mushr_ros_intro.classroom import grades


def drives(folder: str) -> Dict[str, Dict[str, Any]]:
    """Return the graded drives in a folder by their names, such as SUBMISSION/PLAN or PLAN.

    Files that are something else are skipped. See docs/web.md for the values.
    """
    return dict(sorted([*_of_class(os.path.join(folder, grades.FOLDER)), *_of_node(folder)]))


def _of_class(folder: str) -> Iterator[Tuple[str, Dict[str, Any]]]:
    if not os.path.isdir(folder):
        return
    for each in grades.load(folder):
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


def _of_node(folder: str) -> Iterator[Tuple[str, Dict[str, Any]]]:
    """Yield the drives of one node: a report in the folder, or in a folder for each plan."""
    for place, _, files in os.walk(folder):
        if {"report.json", "trajectory.csv"} <= set(files):
            with open(os.path.join(place, "report.json"), encoding="utf-8") as file:
                report = json.load(file)
            path = os.path.join(place, "trajectory.csv")
            table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
            chosen = np.unique(np.linspace(0, len(table) - 1, grades.MAX_POINTS).astype(int))
            table = table[chosen].tolist()
            yield (
                os.path.relpath(place, folder),
                {
                    "passed": report["passed"],
                    "verdict": "\n".join(report["verdict"]),
                    "times": [row[0] for row in table],
                    "driven": [row[1:4] for row in table],
                    "predicted": [row[4:7] for row in table],
                },
            )
