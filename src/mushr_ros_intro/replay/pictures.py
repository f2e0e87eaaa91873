"""Draw a drive: the driven and the predicted path, and distances over time.

A drive has at least one pose. Tolerances, titles and the map are shown if they are given.
"""

from typing import Dict, Optional, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from mushr_ros_intro.preview import drawing
from mushr_ros_intro.preview.drawing import DRIVEN, ERROR, PREDICTED
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.world.grid import Grid

_STYLES = (("driven", DRIVEN, "-"), ("predicted", PREDICTED, "--"))


def locations(
    drive: Drive,
    title: str = "",
    tolerance: Optional[float] = None,
    grid: Optional[Grid] = None,
    error_indices: Sequence[int] = (),
) -> Figure:
    """Return a drawing of both paths in the map frame.

    The tolerance is of the final position [m]. A line connects the predicted and the driven
    position at the indices `error_indices`.
    """
    figure, (axes, key) = drawing.new_figure(8.0, 6.4, 0.2)
    for name, color, style in _STYLES:
        poses = getattr(drive, name)
        drawing.draw_path(axes, poses, color, name, style)
        drawing.draw_headings(axes, poses[[0, -1]], color)
    if tolerance is not None:
        label = f"tolerance of the final position: {tolerance:.3g} m"
        end = drive.predicted[-1, :2]
        axes.add_patch(Circle(end, tolerance, fill=False, color=ERROR, label=label))
    if len(error_indices):
        x, y, _ = np.array([drive.predicted[error_indices], drive.driven[error_indices]]).transpose(
            2, 0, 1
        )
        first, *_ = axes.plot(x, y, color=ERROR, lw=1.0, zorder=2)
        first.set_label("error, once per second and at the end")
    drawing.finish_map(axes, key, grid)
    drawing.set_title(axes, title)
    return figure


def distances(drive: Drive, title: str = "", tolerance: Optional[float] = None) -> Figure:
    """Return a drawing of the distances from the predicted start, and between the paths [m].

    The tolerance is of the path [m].
    """
    figure, (above, below) = drawing.new_figure(8.0, 2.4, 2.4)
    for name, color, style in _STYLES:
        away = getattr(drive, name)[:, :2] - drive.predicted[0, :2]
        above.plot(drive.times, np.hypot(*away.T), style, color=color, label=name)
    below.plot(drive.times, drive.distances, color=ERROR)
    if tolerance is not None:
        label = f"tolerance of the path: {tolerance:.3g} m"
        below.axhline(tolerance, ls=":", color=ERROR, label=label)
        below.legend(fontsize="small")
    above.legend(fontsize="small")
    drawing.set_title(above, title)
    above.set_ylabel("distance from the start [m]")
    apart = "distance between driven\nand predicted position [m]"
    below.set(xlabel="time since the first command [s]", ylabel=apart)
    for axes in (above, below):
        axes.grid(alpha=0.3)
    return figure


def as_texts(drive: Drive) -> Dict[str, str]:
    """Return the pictures of a drive as SVG, by the names of the functions that draw them."""
    functions = (locations, distances)
    return {each.__name__: drawing.as_svg(each(drive)).decode() for each in functions}
