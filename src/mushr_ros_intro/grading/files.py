"""Write the files of a replay's report: report.json, trajectory.csv, and two plots."""

import json
import os
from typing import Any, Dict, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.grading.judge import Check, verdict
from mushr_ros_intro.grading.replay import Drive, Replay, drive
from mushr_ros_intro.plan.model import Plan


def write(folder: str, replay: Replay, checks: Sequence[Check], facts: Dict[str, Any]) -> None:
    """Write report.json, trajectory.csv, locations.png and distances.png into `folder`.

    Without a command or a pose only report.json is written. It also contains `facts`.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    content = {
        **facts,
        "passed": all(check.passed for check in checks),
        "verdict": verdict(checks, replay).splitlines(),
        "checks": [check._asdict() for check in checks],
        "commands": len(replay.sent),
    }
    if replay.sent and len(replay.stamps):
        path = drive(replay)
        content["final_pose"] = Pose(*path.driven[-1].tolist())._asdict()
        content["predicted_final_pose"] = Pose(*path.predicted[-1].tolist())._asdict()
        content["frechet_distance"] = path.frechet_distance
        _write_trajectory(os.path.join(folder, "trajectory.csv"), path, replay.plan)
        _draw(folder, path, replay.plan)
    with open(os.path.join(folder, "report.json"), "w", encoding="ascii") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")


def _from_start(poses: np.ndarray, plan: Plan) -> np.ndarray:
    """Return the distance of each pose from the plan's start pose [m]."""
    return np.hypot(*(poses[:, :2] - plan.start[:2]).T)


def _write_trajectory(path: str, trajectory: Drive, plan: Plan) -> None:
    """Write one line for each sample."""
    names = "time,x,y,theta,predicted_x,predicted_y,predicted_theta,distance_from_start"
    values = np.column_stack([*trajectory, _from_start(trajectory.driven, plan)])
    np.savetxt(path, values, ["%.9f"] + 7 * ["%.17g"], ",", header=names, comments="")


def _draw(folder: str, path: Drive, plan: Plan) -> None:
    """Draw the two plots, without a display."""
    # Imported here because only a report needs matplotlib.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    def save(name: str, labels: Tuple[str, str], curves: Sequence[Tuple[Any, Any]]) -> None:
        figure = Figure(figsize=(7.0, 5.0), dpi=100.0)
        FigureCanvasAgg(figure)
        axes = figure.add_subplot(1, 1, 1)
        for (x, y), style, label in zip(curves, ("-", "--"), ("driven", "predicted")):
            axes.plot(x, y, style, label=label)
        title = os.path.basename(plan.path).replace("$", r"\$")
        axes.set(xlabel=labels[0], ylabel=labels[1], title=title)
        axes.grid(True)
        axes.legend()
        if name == "locations.png":
            axes.set_aspect("equal", "datalim")
        figure.savefig(os.path.join(folder, name))

    both = (path.driven, path.predicted)
    save("locations.png", ("x [m]", "y [m]"), [(each[:, 0], each[:, 1]) for each in both])
    away = [(path.times, _from_start(each, plan)) for each in both]
    save("distances.png", ("time [s]", "distance from the start [m]"), away)
