"""Draw a plan: the path on the map, and below it speed and steering angle over time."""

import os
from typing import Any, List, Optional

import matplotlib
import numpy as np

from mushr_ros_intro.car.model import State
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.preview.prediction import sampled
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.spread import Spread
from mushr_ros_intro.preview.walls import drive_to
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

matplotlib.use("Agg")  # no display is needed; and before pyplot is imported
from matplotlib import pyplot  # noqa: E402
from matplotlib.patches import Ellipse  # noqa: E402

_PERIOD = NANOSECONDS // 50  # between two points of the path
_MAX_POINTS = 20_000  # along a long path
_MARGIN = 1.0  # [m] around the path
_MAX_ARROWS = 100


def draw(path: str, report: Report, spread: Optional[Spread], grid: Optional[Grid]) -> None:
    """Draw a report, the spread and the map, if any, into a file; its ending is the format.

    Raises:
        UserError: the file cannot be written, or matplotlib does not know the format.
    """
    period = max(_PERIOD, report.rest // _MAX_POINTS)
    states = list(sampled(drive_to(report.hit, report.plan, report.car), report.car, period))
    figure, (above, below) = pyplot.subplots(
        2, 1, figsize=(8, 9), gridspec_kw={"height_ratios": [3, 1]}, constrained_layout=True
    )
    try:
        if grid is not None:
            _draw_map(above, grid)
        if spread is not None:
            _draw_spread(above, spread)
        _draw_path(above, report, states)
        _set_limits(above, report, spread)
        _draw_commands(below, report, states)
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{path} cannot be written: {reason}; expected such as figure_8.png"
        raise UserError(text) from None
    finally:
        pyplot.close(figure)


def _draw_path(axes: Any, report: Report, states: List[State]) -> None:
    """Draw the path with its start, its end and the headings between the rows."""
    poses = np.array([state.pose for state in states])
    axes.plot(poses[:, 0], poses[:, 1], color="C0", lw=1.5, label="path of the rear axle", zorder=3)
    begins = np.array([report.plan.start, *(step.pose for step in report.steps)])
    begins = begins[:: -(-len(begins) // _MAX_ARROWS)]
    axes.quiver(
        *(begins[:, 0], begins[:, 1], np.cos(begins[:, 2]), np.sin(begins[:, 2])),
        angles="xy",
        scale=30,
        width=0.005,
        color="C0",
        label="heading where a row begins",
        zorder=4,
    )
    axes.plot(*poses[0, :2], "o", color="C2", label="start", zorder=5)
    axes.plot(*poses[-1, :2], "s", color="C4", label="end", zorder=5)
    if report.hit is not None:
        axes.plot(*report.hit.pose[:2], "X", ms=12, color="red", label="hits a wall", zorder=6)
    name = os.path.basename(report.plan.path)
    title = f"{name} on the {report.car_name} car: {report.length:.2f} m"
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title)
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")


def _set_limits(axes: Any, report: Report, spread: Optional[Spread]) -> None:
    """Show the path and the final positions of the runs, to scale."""
    corners = np.array(report.box).reshape(2, 2).T
    if spread is not None:
        corners = np.concatenate((corners, spread.cloud[:, :2]))
    (left, bottom), (right, top) = corners.min(axis=0), corners.max(axis=0)
    xlim, ylim = (left - _MARGIN, right + _MARGIN), (bottom - _MARGIN, top + _MARGIN)
    axes.set(aspect="equal", xlim=xlim, ylim=ylim)


def _draw_spread(axes: Any, spread: Spread) -> None:
    """Draw the final positions of the runs, and the ellipses along the path."""
    axes.plot(*spread.cloud[:, :2].T, ".", ms=1.5, color="C1", alpha=0.3, zorder=2)
    for mean, (major, minor, direction) in zip(spread.mean, spread.ellipses):
        angle = np.degrees(direction)
        shape = Ellipse(mean[:2], 2.0 * major, 2.0 * minor, angle=angle, fill=False, color="C3")
        axes.add_patch(shape)
    shape.set_label("95 % ellipse on the way")


def _draw_map(axes: Any, grid: Grid) -> None:
    """Draw free cells white, unknown cells grey and walls black."""
    shades = np.where(grid.occupied, 0.0, np.where(grid.cells < 0, 0.8, 1.0)).astype(np.float32)
    image = axes.imshow(shades, cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest", zorder=1)
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    image.set_extent((0.0, width, height, 0.0))  # row 0 is at the bottom
    pose = matplotlib.transforms.Affine2D().rotate(grid.origin.theta)
    image.set_transform(pose.translate(*grid.origin[:2]) + axes.transData)


def _draw_commands(axes: Any, report: Report, states: List[State]) -> None:
    """Draw speed and steering angle over time."""
    rows = report.plan.rows
    begins = [step.begin / NANOSECONDS for step in report.steps]
    times = [state.stamp / NANOSECONDS for state in states]
    for side, field, unit, color in (
        (axes, "speed", "m/s", "C0"),
        (axes.twinx(), "steering_angle", "rad", "C1"),
    ):
        asked = [getattr(row, field) for row in rows]
        side.step(begins, [*asked, asked[-1]], where="post", ls="--", color=color, lw=1.0)
        side.plot(times, [getattr(state, field) for state in states], color=color, lw=1.8)
        side.set_ylabel(f"{field.replace('_', ' ')} [{unit}]", color=color)
        side.tick_params(axis="y", colors=color)
        side.margins(y=0.15)
    if len(rows) <= _MAX_ARROWS:
        for begin in begins:
            axes.axvline(begin, color="grey", lw=0.4)
    axes.set_xlabel("time [s]   (dashed: asked for; solid: done)")
