"""Draw a drive: the driven and the predicted path, and below them distances over time."""

from typing import Optional, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from mushr_ros_intro.preview import drawing
from mushr_ros_intro.preview.drawing import DRIVEN, ERROR, PREDICTED
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.world.grid import Grid

_STYLES = (("driven", DRIVEN, "-"), ("predicted", PREDICTED, "--"))


def picture(
    drive: Drive,
    title: str = "",
    end_tolerance: Optional[float] = None,
    path_tolerance: Optional[float] = None,
    grid: Optional[Grid] = None,
    error_indices: Sequence[int] = (),
) -> Figure:
    """Return a drawing of a drive, which has at least one pose.

    Args:
        drive: the drive.
        title: of the drawing.
        end_tolerance: of the final position [m]; None to show none.
        path_tolerance: of the distance between the paths [m]; None to show none.
        grid: the map, or None.
        error_indices: where a line connects the predicted and the driven position.
    """
    figure, (axes, key, away, apart) = drawing.new_figure(8.0, 6.4, 0.3, 1.6, 1.6)
    for name, color, style in _STYLES:
        poses = getattr(drive, name)
        drawing.draw_path(axes, poses, color, name, style)
        drawing.draw_headings(axes, poses[[0, -1]], color)
        distances = np.hypot(*(poses[:, :2] - drive.predicted[0, :2]).T)
        away.plot(drive.times, distances, style, color=color)
    if end_tolerance is not None:
        label = f"tolerance of the final position: {end_tolerance:.3g} m"
        end = drive.predicted[-1, :2]
        axes.add_patch(Circle(end, end_tolerance, fill=False, color=ERROR, label=label))
    if len(error_indices):
        pairs = np.array([drive.predicted[error_indices], drive.driven[error_indices]])
        first, *_ = axes.plot(*pairs.transpose(2, 0, 1)[:2], color=ERROR, lw=1.0, zorder=2)
        first.set_label("error, once per second and at the end")
    drawing.finish_map(axes, key, grid)
    drawing.set_title(axes, title)
    away.set_ylabel("distance from\nthe start [m]")
    apart.plot(drive.times, drive.distances, color=ERROR)
    if path_tolerance is not None:
        label = f"tolerance of the path: {path_tolerance:.3g} m"
        apart.axhline(path_tolerance, ls=":", color=ERROR, label=label)
        apart.legend(fontsize="small")
    label = "distance between\nthe paths [m]"
    apart.set(xlabel="time since the first command [s]", ylabel=label)
    for panel in (away, apart):
        panel.grid(alpha=0.3)
    return figure
