"""Write the files of a replay's report: trajectory.csv and picture.png."""

import os
import sys

import numpy as np

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.judge import Judgement
from mushr_ros_intro.replay.recording import Drive


def write_report(folder: str, judgement: Judgement) -> None:
    """Write trajectory.csv and picture.png into `folder`.

    Without matplotlib, print that there is no picture.

    Raises:
        OSError: a file cannot be written.
    """
    os.makedirs(folder, exist_ok=True)
    path = judgement.drive
    write_trajectory(folder, path, judgement.recorded.plan.start)
    try:
        # matplotlib is slow to import
        from mushr_ros_intro.replay.pictures import picture
    except ImportError as error:
        text = f"{folder}: no picture ({error}); install python3-matplotlib"
        print(text, file=sys.stderr)
        return
    title, tolerances, grid = _title(judgement), judgement.tolerances, judgement.recorded.grid
    limit = getattr(tolerances, "cross_track", tolerances.path)
    figure = picture(path, title, tolerances.position, limit, grid)
    figure.savefig(os.path.join(folder, "picture.png"))


def write_trajectory(folder: str, drive: Drive, start: Pose) -> None:
    """Write trajectory.csv into `folder`; `start` is the start pose of the plan.

    Raises:
        OSError: the file cannot be written.
    """
    names = "time,x,y,theta,predicted_x,predicted_y,predicted_theta,distance_from_start"
    away = np.hypot(*(drive.driven[:, :2] - start[:2]).T)
    table, formats = np.column_stack([*drive[:3], away]), ["%.9f"] + 7 * ["%.17g"]
    csv = os.path.join(folder, "trajectory.csv")
    np.savetxt(csv, table, formats, ",", header=names, comments="")


def _title(judgement: Judgement) -> str:
    """Return the name of the plan, and the checks that failed, if any."""
    failed = ", ".join(
        check.name for check in judgement.checks if check.is_judged and not check.passed
    )
    name = os.path.basename(judgement.recorded.plan.path)
    return f"{name}: {'failed: ' + failed if failed else 'passed'}"
