"""Write the files of a replay's report: report.json, trajectory.csv, and two plots."""

import json
import os
from typing import Any, Dict, Sequence

import numpy as np

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.grading.judge import Check, Tolerances, verdict
from mushr_ros_intro.grading.replay import Drive, Replay, drive
from mushr_ros_intro.plan.model import Plan


def write(
    folder: str,
    replay: Replay,
    checks: Sequence[Check],
    tolerances: Tolerances,
    facts: Dict[str, Any],
) -> None:
    """Write report.json, trajectory.csv, locations.png and distances.png into `folder`.

    Without a command or a pose only report.json is written. It also contains `facts`.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    content = {
        **facts,
        "tolerances": tolerances._asdict(),
        "passed": all(check.passed for check in checks),
        "verdict": verdict(checks, replay).splitlines(),
        "checks": [check._asdict() for check in checks],
        "commands": len(replay.sent),
    }
    if replay.sent and len(replay.stamps):
        from mushr_ros_intro.grading import pictures  # matplotlib is slow to import

        path = drive(replay)
        content["final_pose"] = Pose(*path.driven[-1].tolist())._asdict()
        content["predicted_final_pose"] = Pose(*path.predicted[-1].tolist())._asdict()
        content["frechet_distance"] = path.frechet_distance
        _write_trajectory(os.path.join(folder, "trajectory.csv"), path, replay.plan)
        for draw in (pictures.locations, pictures.distances):
            figure = draw(replay, path, checks, tolerances)
            figure.savefig(os.path.join(folder, f"{draw.__name__}.png"))
    with open(os.path.join(folder, "report.json"), "w", encoding="ascii") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")


def _write_trajectory(path: str, trajectory: Drive, plan: Plan) -> None:
    """Write one line for each sample."""
    names = "time,x,y,theta,predicted_x,predicted_y,predicted_theta,distance_from_start"
    away = np.hypot(*(trajectory.driven[:, :2] - plan.start[:2]).T)
    values = np.column_stack([*trajectory, away])
    np.savetxt(path, values, ["%.9f"] + 7 * ["%.17g"], ",", header=names, comments="")
