"""Write the files of a replay's report: report.json, trajectory.csv, and two plots."""

import csv
import json
import os
from typing import Any, Dict, Sequence, Tuple

import numpy as np

from mushr_ros_intro.grading.judge import (
    Check,
    Replay,
    drive,
    first_pose,
    frechet_distance,
    verdict,
)
from mushr_ros_intro.plan.model import Plan


def write(folder: str, replay: Replay, checks: Sequence[Check], facts: Dict[str, Any]) -> None:
    """Write report.json, trajectory.csv, locations.png and distances.png into `folder`.

    The last three are left out where the car has not been driven.

    Args:
        folder: made if it is not there.
        replay: what was seen.
        checks: the verdicts.
        facts: more that report.json is to hold, such as what was started.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    content = {
        **facts,
        "passed": all(check.passed for check in checks),
        "verdict": verdict(checks, replay),
        "checks": [check._asdict() for check in checks],
        "commands": len(replay.sent),
    }
    if replay.sent and len(replay.stamps):
        begin = first_pose(replay)
        seconds, driven, predicted = drive(replay, begin)
        away = np.hypot(*(driven[:, :2] - replay.plan.start[:2]).T)
        names = ("x", "y", "theta")
        content["final_pose"] = dict(zip(names, driven[-1].tolist()))
        content["predicted_final_pose"] = dict(zip(names, predicted[-1].tolist()))
        content["frechet_distance"] = frechet_distance(driven[:, :2], predicted[:, :2])
        _write_trajectory(os.path.join(folder, "trajectory.csv"), seconds, driven, predicted, away)
        _draw(folder, replay.plan, seconds, driven, predicted, away)
    with open(os.path.join(folder, "report.json"), "w", encoding="ascii") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")


def _write_trajectory(
    path: str, seconds: np.ndarray, driven: np.ndarray, predicted: np.ndarray, away: np.ndarray
) -> None:
    """Write one line for each pose that the car reported."""
    columns = ["time", "x", "y", "theta", "predicted_x", "predicted_y", "predicted_theta"]
    with open(path, "w", encoding="ascii", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*columns, "distance_from_start"])
        for row in np.column_stack([seconds, driven, predicted, away]).tolist():
            writer.writerow([f"{row[0]:.9f}", *map(repr, row[1:])])


def _draw(
    folder: str,
    plan: Plan,
    seconds: np.ndarray,
    driven: np.ndarray,
    predicted: np.ndarray,
    away: np.ndarray,
) -> None:
    """Draw the two plots, without a display."""
    # Only who asks for plots has to wait for matplotlib, or to have it.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    def save(name: str, labels: Tuple[str, str], curves: Sequence[Tuple[Any, Any, str]]) -> None:
        figure = Figure(figsize=(7.0, 5.0), dpi=100.0)
        FigureCanvasAgg(figure)
        axes = figure.add_subplot(1, 1, 1)
        for (x, y, label), style in zip(curves, ("-", "--")):
            axes.plot(x, y, style, label=label)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        axes.set_title(os.path.basename(plan.path).replace("$", r"\$"))
        axes.grid(True)
        axes.legend()
        if name == "locations.png":
            axes.set_aspect("equal", "datalim")
        figure.savefig(os.path.join(folder, name))

    there = np.hypot(*(predicted[:, :2] - plan.start[:2]).T)
    save(
        "locations.png",
        ("x [m]", "y [m]"),
        [
            (driven[:, 0], driven[:, 1], "driven"),
            (predicted[:, 0], predicted[:, 1], "predicted"),
        ],
    )
    save(
        "distances.png",
        ("time [s]", "distance from the start [m]"),
        [(seconds, away, "driven"), (seconds, there, "predicted")],
    )
