"""Draw a replay: the driven and the predicted path."""

from typing import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from mushr_ros_intro.grading.judge import Check, Tolerances
from mushr_ros_intro.grading.replay import Drive, Replay
from mushr_ros_intro.preview.map_axes import draw_headings, finish, title_of

_STYLES = (("driven", "C0", "-"), ("predicted", "C1", "--"))


def locations(replay: Replay, path: Drive, checks: Sequence[Check], limits: Tolerances) -> Figure:
    """Return a drawing of both paths in the map frame."""
    figure = Figure(figsize=(8, 8), constrained_layout=True)
    axes, key = figure.subplots(2, 1, gridspec_kw={"height_ratios": [12, 1]})
    for name, color, style in _STYLES:
        poses = getattr(path, name)
        axes.plot(poses[:, 0], poses[:, 1], style, color=color, label=f"{name} path")
        draw_headings(axes, poses[[0, -1]], color)
        size = {"ms": 10, "mfc": "none"} if name == "predicted" else {}
        axes.plot(*poses[0, :2], "o", color=color, label=f"{name} start", **size)
        axes.plot(*poses[-1, :2], "s", color=color, label=f"{name} end", **size)
    label = f"tolerance of the final position: {limits.position:.3g} m"
    end = Circle(path.predicted[-1, :2], limits.position, fill=False, color="C3", label=label)
    axes.add_patch(end)
    finish(axes, key, replay.grid)
    axes.set_title(_title(replay, checks))
    return figure


def distances(replay: Replay, path: Drive, checks: Sequence[Check], limits: Tolerances) -> Figure:
    """Return a drawing of distances over time: from the start, and between the paths."""
    figure = Figure(figsize=(8, 7), constrained_layout=True)
    above, below = figure.subplots(2, 1, sharex=True)
    for name, color, style in _STYLES:
        away = getattr(path, name)[:, :2] - replay.plan.start[:2]
        above.plot(path.times, np.hypot(*away.T), style, color=color, label=name)
    apart = np.hypot(*(path.driven - path.predicted)[:, :2].T)
    below.plot(path.times, apart, color="C0", label="at the same time")
    label = f"tolerance of the path: {limits.path:.3g} m"
    below.axhline(limits.path, ls=":", color="C3", label=label)
    above.set(title=_title(replay, checks), ylabel="distance from the start [m]")
    apart_label = "distance between driven\nand predicted position [m]"
    below.set(xlabel="time since the first command [s]", ylabel=apart_label)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    return figure


def _title(replay: Replay, checks: Sequence[Check]) -> str:
    """Return the name of the plan, and the checks that failed, if any."""
    failed = ", ".join(check.name for check in checks if not check.passed)
    return f"{title_of(replay.plan)}: {'failed: ' + failed if failed else 'passed'}"
