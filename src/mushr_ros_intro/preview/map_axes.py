"""Draw in the map frame: headings, the walls, and a legend below the axes."""

import os
from typing import Any, Optional

import numpy as np
from matplotlib.transforms import Affine2D

from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.world.grid import Grid

_MARGIN = 0.5  # [m] around everything, and a tenth of its size


def title_of(plan: Plan) -> str:
    """Return the name of a plan's file as text for matplotlib, to which $ begins a formula."""
    return os.path.basename(plan.path).replace("$", r"\$")


def draw_headings(axes: Any, poses: np.ndarray, color: str, **options: Any) -> None:
    """Draw an arrow at each pose; poses are x [m], y [m], theta [rad], N x 3."""
    x, y, theta = poses.T
    style = {"angles": "xy", "scale": 30, "width": 0.005, "color": color, "zorder": 4}
    axes.quiver(x, y, np.cos(theta), np.sin(theta), **style, **options)


def finish(axes: Any, key: Any, grid: Optional[Grid]) -> None:
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
    if grid is not None:
        _draw_map(axes, grid)
    axes.set(aspect="equal", xlim=xlim, ylim=ylim, xlabel="x [m]", ylabel="y [m]")
    axes.grid(alpha=0.3)
    key.axis("off")
    key.legend(*axes.get_legend_handles_labels(), loc="center", ncol=3, fontsize="small")


def _draw_map(axes: Any, grid: Grid) -> None:
    """Draw free cells white, unknown cells grey and walls black."""
    shades = np.where(grid.occupied, 0.0, np.where(grid.cells < 0, 0.8, 1.0)).astype(np.float32)
    pose = Affine2D().rotate(grid.origin.theta).translate(*grid.origin[:2]) + axes.transData
    extent = (0.0, grid.width * grid.resolution, 0.0, grid.height * grid.resolution)
    style = {"cmap": "gray", "vmin": 0.0, "vmax": 1.0, "interpolation": "nearest", "zorder": 0}
    axes.imshow(shades, extent=extent, origin="lower", transform=pose, **style)
    axes.plot([], [], "s", color="black", label="wall")
