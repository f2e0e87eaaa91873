"""Draw poses on a map with matplotlib. A colour means the same in all pictures.

A picture is made in this order: `new_figure`, the `draw_` functions, `finish_map`.
"""

import io
from typing import Any, Optional, Tuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D

from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.world.grid import Grid

DRIVEN, PREDICTED, COMMANDED, SPREAD, ERROR = "C0", "C1", "C7", "C4", "C3"
"""The colours of the driven and the predicted path, of what the commands ask for, of many random
drives, and of errors, their tolerances and faults. A wall is black, an unknown cell grey."""

_MARGIN = 0.5  # [m] around everything, and a tenth of its size

_LEFT, _RIGHT, _BELOW, _ABOVE, _BETWEEN = 0.9, 0.2, 0.55, 0.4, 0.5  # [in] around the axes


def new_figure(width: float, *heights: float) -> Tuple[Figure, np.ndarray]:
    """Return a figure, and its axes one below the other.

    The margins are fixed: a drawing takes three times as long if matplotlib computes them.

    Args:
        width: of the figure [in].
        heights: of the axes, without their labels [in].
    """
    total = _ABOVE + sum(heights) + _BETWEEN * (len(heights) - 1) + _BELOW
    figure = Figure(figsize=(width, total))
    grid = {
        "height_ratios": heights,
        "left": _LEFT / width,
        "right": 1.0 - _RIGHT / width,
        "bottom": _BELOW / total,
        "top": 1.0 - _ABOVE / total,
        "hspace": _BETWEEN * len(heights) / sum(heights),
    }
    return figure, figure.subplots(len(heights), 1, squeeze=False, gridspec_kw=grid)[:, 0]


def as_svg(figure: Figure) -> bytes:
    """Return a figure as an SVG file; equal figures give equal files."""
    file = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "mushr_ros_intro"}):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def set_title(axes: Any, title: str) -> None:
    """Set the title; matplotlib would begin a formula at a $."""
    axes.set_title(title.replace("$", r"\$"))


def draw_path(axes: Any, poses: np.ndarray, color: str, name: str, style: str = "-") -> None:
    """Draw a line through poses, with a circle at its start and a square at its end.

    Args:
        axes: x and y in the map frame [m].
        poses: x [m], y [m] and more columns.
        color: one of the colours above.
        name: in the legend, such as "driven".
        style: of the line; "--" leaves circle and square hollow.
    """
    axes.plot(*poses[:, :2].T, style, color=color, label=f"{name} path", zorder=3)
    mark = {"color": color, "ms": 8, "mfc": "none" if style == "--" else color, "zorder": 5}
    axes.plot(*poses[0, :2], "o", label=f"{name} start", **mark)
    axes.plot(*poses[-1, :2], "s", label=f"{name} end", **mark)


def draw_headings(axes: Any, poses: np.ndarray, color: str, label: str = "") -> None:
    """Draw an arrow at each pose; poses are x [m], y [m], theta [rad], N x 3."""
    x, y, theta = poses.T
    style = {"scale": 30, "width": 0.005, "color": color, "zorder": 4}
    axes.quiver(x, y, np.cos(theta), np.sin(theta), **style)
    if label:
        axes.plot([], [], marker=r"$\rightarrow$", ms=14, ls="", color=color, label=label)


def finish_map(axes: Any, key: Any, grid: Optional[Grid]) -> None:
    """Show all that has been drawn, to scale, with the walls of the map, if any.

    Args:
        axes: x and y in the map frame [m].
        key: empty axes for the legend.
        grid: the map.
    """
    low, high = axes.dataLim.get_points()
    half = 0.55 * (high - low) + _MARGIN
    half = np.maximum(half, 0.6 * half.max())
    xlim, ylim = zip(0.5 * (low + high) - half, 0.5 * (low + high) + half)
    axes.set(aspect="equal", xlim=xlim, ylim=ylim, xlabel="x [m]", ylabel="y [m]", axisbelow=True)
    axes.grid(alpha=0.3)
    if grid is not None:
        _draw_walls(axes, grid)
    key.axis("off")
    place = {"loc": "upper center", "borderaxespad": 0.0}
    key.legend(*axes.get_legend_handles_labels(), ncol=3, fontsize="small", **place)


def _draw_walls(axes: Any, grid: Grid) -> None:
    """Draw the walls and the unknown cells of the visible part of the map."""
    corners = [grid.to_grid(Pose(x, y, 0.0)) for x in axes.get_xlim() for y in axes.get_ylim()]
    cells = np.array(corners)[:, :2] / grid.resolution
    # Not a cell of which less than half is visible: the legend would name a wall that nobody sees.
    left, bottom = np.rint(cells.min(axis=0)).astype(int).clip(0)
    right, top = np.rint(cells.max(axis=0)).astype(int).clip(0)
    occupied, cells = (each[bottom:top, left:right] for each in (grid.occupied, grid.cells))
    if not cells.size:
        return
    shades = np.where(occupied, 0.0, 0.8).astype(np.float32)
    shown = np.ma.masked_where(~occupied & (cells >= 0), shades)
    sides = np.array([left, left + cells.shape[1], bottom, bottom + cells.shape[0]])
    pose = Affine2D().rotate(grid.origin.theta).translate(*grid.origin[:2]) + axes.transData
    style = {"cmap": "gray", "vmin": 0.0, "vmax": 1.0, "interpolation": "nearest", "zorder": 1}
    axes.imshow(shown, extent=sides * grid.resolution, origin="lower", transform=pose, **style)
    if occupied.any():
        axes.plot([], [], "s", color="black", label="wall")
