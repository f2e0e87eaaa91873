"""Write the files of a replay's report: report.json, trajectory.csv, and two plots."""

import json
import os
from typing import Any, Dict

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.preview.map_axes import draw_headings, finish, title_of
from mushr_ros_intro.replay.judge import Judgement

_STYLES = (("driven", "C0", "-"), ("predicted", "C1", "--"))


def write_report(folder: str, judgement: Judgement, arguments: Dict[str, Any]) -> None:
    """Write report.json, trajectory.csv, locations.png and distances.png into `folder`.

    report.json also contains `arguments`.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    path = judgement.drive
    content = {
        "arguments": arguments,
        "tolerances": judgement.tolerances._asdict(),
        "passed": judgement.passed,
        "verdict": judgement.verdict.splitlines(),
        "checks": [check._asdict() for check in judgement.checks],
        "commands": len(judgement.recorded.sent),
        "final_pose": Pose(*path.driven[-1].tolist())._asdict(),
        "predicted_final_pose": Pose(*path.predicted[-1].tolist())._asdict(),
        "frechet_distance": path.frechet_distance,
    }
    with open(os.path.join(folder, "report.json"), "w", encoding="ascii") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")

    names = "time,x,y,theta,predicted_x,predicted_y,predicted_theta,distance_from_start"
    away = np.hypot(*(path.driven[:, :2] - judgement.recorded.plan.start[:2]).T)
    table, formats = np.column_stack([*path[:3], away]), ["%.9f"] + 7 * ["%.17g"]
    csv = os.path.join(folder, "trajectory.csv")
    np.savetxt(csv, table, formats, ",", header=names, comments="")

    locations(judgement).savefig(os.path.join(folder, "locations.png"))
    distances(judgement).savefig(os.path.join(folder, "distances.png"))


def locations(judgement: Judgement) -> Figure:
    """Return a drawing of the driven and the predicted path in the map frame."""
    figure = Figure(figsize=(8, 8), constrained_layout=True)
    axes, key = figure.subplots(2, 1, gridspec_kw={"height_ratios": [12, 1]})
    for name, color, style in _STYLES:
        poses = getattr(judgement.drive, name)
        axes.plot(poses[:, 0], poses[:, 1], style, color=color, label=f"{name} path")
        draw_headings(axes, poses[[0, -1]], color)
        size = {"ms": 10, "mfc": "none"} if name == "predicted" else {}
        axes.plot(*poses[0, :2], "o", color=color, label=f"{name} start", **size)
        axes.plot(*poses[-1, :2], "s", color=color, label=f"{name} end", **size)
    tolerance = judgement.tolerances.position
    label = f"tolerance of the final position: {tolerance:.3g} m"
    end = Circle(judgement.drive.predicted[-1, :2], tolerance, fill=False, color="C3", label=label)
    axes.add_patch(end)
    finish(axes, key, judgement.recorded.grid)
    axes.set_title(_title(judgement))
    return figure


def distances(judgement: Judgement) -> Figure:
    """Return a drawing of distances over time: from the start, and between the paths."""
    path, tolerance = judgement.drive, judgement.tolerances.path
    figure = Figure(figsize=(8, 7), constrained_layout=True)
    above, below = figure.subplots(2, 1, sharex=True)
    for name, color, style in _STYLES:
        away = getattr(path, name)[:, :2] - judgement.recorded.plan.start[:2]
        above.plot(path.times, np.hypot(*away.T), style, color=color, label=name)
    apart = np.hypot(*(path.driven - path.predicted)[:, :2].T)
    below.plot(path.times, apart, color="C0", label="at the same time")
    label = f"tolerance of the path: {tolerance:.3g} m"
    below.axhline(tolerance, ls=":", color="C3", label=label)
    above.set(title=_title(judgement), ylabel="distance from the start [m]")
    apart_label = "distance between driven\nand predicted position [m]"
    below.set(xlabel="time since the first command [s]", ylabel=apart_label)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    return figure


def _title(judgement: Judgement) -> str:
    """Return the name of the plan, and the checks that failed, if any."""
    failed = ", ".join(check.name for check in judgement.checks if not check.passed)
    return f"{title_of(judgement.recorded.plan)}: {'failed: ' + failed if failed else 'passed'}"
