"""Draw what a plan does: the path on the map, and below it speed and steering over time."""

from typing import Any, Optional

import matplotlib
import numpy as np

from mushr_ros_intro.preview.check import Report, Scatter
from mushr_ros_intro.preview.ensemble import ellipse
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

matplotlib.use("Agg")  # no display is needed; and before pyplot is imported
from matplotlib import pyplot  # noqa: E402
from matplotlib.patches import Ellipse  # noqa: E402

_MARGIN = 1.0  # [m] round the path
_MOST_ARROWS = 100


def draw(path: str, report: Report, result: Optional[Scatter], grid: Optional[Grid]) -> None:
    """Draw a report into a picture file.

    Args:
        path: of the file; its ending says of which kind it is.
        report: on the plan.
        result: its spread, if there is one.
        grid: the map, if there is one.

    Raises:
        OSError: the file cannot be written.
        ValueError: matplotlib knows no picture of that kind.
    """
    figure, (above, below) = pyplot.subplots(
        2, 1, figsize=(8, 9), gridspec_kw={"height_ratios": [3, 1]}, constrained_layout=True
    )
    try:
        _draw_path(above, report, result, grid)
        _draw_commands(below, report)
        figure.savefig(path, dpi=120)
    finally:
        pyplot.close(figure)


def _draw_path(axes: Any, report: Report, result: Optional[Scatter], grid: Optional[Grid]) -> None:
    """Draw the path to scale."""
    left, right, bottom, top = report.box
    if result is not None:
        points = result.sampled.cloud[:, :2]
        left, bottom = np.minimum((left, bottom), points.min(axis=0))
        right, top = np.maximum((right, top), points.max(axis=0))
    if grid is not None:
        _draw_map(axes, grid)
    x, y, theta = report.path.poses.T
    if result is not None:
        axes.plot(*result.sampled.cloud[:, :2].T, ".", ms=1.5, color="C1", alpha=0.3, zorder=2)
        for index, covariance in enumerate(result.sampled.covariance):
            major, minor, direction = ellipse(covariance)
            shape = Ellipse(
                result.sampled.mean[index, :2],
                2.0 * major,
                2.0 * minor,
                angle=np.degrees(direction),
                fill=False,
                color="C3",
                lw=0.8,
                label="95 % ellipse on the way" if index == 0 else None,
            )
            axes.add_patch(shape)
    axes.plot(x, y, color="C0", lw=1.5, label="path of the rear axle", zorder=3)
    ends = report.rows.poses[:: -(-len(report.rows.poses) // _MOST_ARROWS)]
    axes.quiver(
        *(ends[:, 0], ends[:, 1], np.cos(ends[:, 2]), np.sin(ends[:, 2])),
        angles="xy",
        scale=30,
        width=0.005,
        color="C0",
        label="heading where a row begins",
        zorder=4,
    )
    axes.plot(x[0], y[0], "o", color="C2", label="start", zorder=5)
    axes.plot(x[-1], y[-1], "s", color="C4", label="end", zorder=5)
    if report.hit is not None:
        axes.plot(
            report.hit.x, report.hit.y, "X", ms=12, color="red", label="hits a wall", zorder=6
        )
    axes.set_aspect("equal")
    axes.set_xlim(left - _MARGIN, right + _MARGIN)
    axes.set_ylim(bottom - _MARGIN, top + _MARGIN)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    name = report.plan.path.replace("\\", "/").rsplit("/", 1)[-1]
    axes.set_title(f"{name} on the {report.car_name} car: {report.length:.2f} m")
    axes.grid(alpha=0.3)
    axes.legend(loc="best", fontsize="small")


def _draw_map(axes: Any, grid: Grid) -> None:
    """Draw free space white, what is unknown grey and walls black."""
    shades = np.where(grid.occupied, 0.0, np.where(grid.cells < 0, 0.8, 1.0)).astype(np.float32)
    image = axes.imshow(
        shades,
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        interpolation="nearest",
        extent=(0.0, grid.width * grid.resolution, 0.0, grid.height * grid.resolution),
        zorder=1,
    )
    pose = matplotlib.transforms.Affine2D().rotate(grid.origin.theta)
    pose = pose.translate(grid.origin.x, grid.origin.y)
    image.set_transform(pose + axes.transData)


def _draw_commands(axes: Any, report: Report) -> None:
    """Draw speed and steering over time."""
    rows = report.rows
    count = len(report.plan.rows)
    times = rows.instants[: count + 1] / NANOSECONDS
    other = axes.twinx()
    has_ramps = report.rows.instants[-1] > report.plan.duration
    for side, name, asked, done, color in (
        (axes, "speed [m/s]", [row.speed for row in report.plan.rows], report.path.speeds, "C0"),
        (
            other,
            "steering angle [rad]",
            [row.steering_angle for row in report.plan.rows],
            report.path.angles,
            "C1",
        ),
    ):
        style = {"color": color, "lw": 1.0 if has_ramps else 1.8}
        side.step(times, [*asked, asked[-1]], where="post", ls="--" if has_ramps else "-", **style)
        if has_ramps:
            side.plot(report.path.instants / NANOSECONDS, done, color=color, lw=1.8)
        side.set_ylabel(name, color=color)
        side.tick_params(axis="y", colors=color)
        side.margins(y=0.15)
    if count <= _MOST_ARROWS:
        for time in times:
            axes.axvline(time, color="grey", lw=0.4)
    axes.set_xlabel("time [s]" + ("   (dashed: asked for; solid: done)" if has_ramps else ""))
