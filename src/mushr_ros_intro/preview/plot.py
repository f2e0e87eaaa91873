"""Draw a plan: the path on the map, and below it speed and steering angle over time."""

from typing import Any, Optional

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.preview.map_axes import draw_headings, finish, title_of
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.spread import Spread
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted
from mushr_ros_intro.world.grid import Grid

_MAX_ARROWS = 100


def write(path: str, report: Report, spread: Optional[Spread], grid: Optional[Grid]) -> None:
    """Draw into a file; its ending is the format.

    Raises:
        UserError: the file cannot be written, or matplotlib does not know the format.
    """
    try:
        draw(report, spread, grid).savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{path} cannot be written: {reason}; expected such as figure_8.png"
        raise UserError(text) from None


def draw(report: Report, spread: Optional[Spread], grid: Optional[Grid]) -> Figure:
    """Return a drawing of a report, the spread and the map, if any."""
    figure = Figure(figsize=(8, 9), constrained_layout=True)
    above, key, below = figure.subplots(3, 1, gridspec_kw={"height_ratios": [12, 1, 4]})
    if spread is not None:
        _draw_spread(above, spread)
    _draw_path(above, report)
    finish(above, key, grid)
    _draw_commands(below, report)
    return figure


def _draw_path(axes: Any, report: Report) -> None:
    """Draw the path with its start, its end and the headings between the rows."""
    poses = np.array([state.pose for state in report.states])
    axes.plot(poses[:, 0], poses[:, 1], color="C0", lw=1.5, label="path of the rear axle", zorder=3)
    begins = np.array([report.plan.start, *(step.pose for step in report.steps)])
    begins = begins[:: -(-len(begins) // _MAX_ARROWS)]
    draw_headings(axes, begins, "C0", label="heading between two rows")
    axes.plot(*poses[0, :2], "o", color="C2", label="start", zorder=5)
    marker, color, label = ("X", "red", "end: hits a wall") if report.hit else ("s", "C4", "end")
    axes.plot(*poses[-1, :2], marker, ms=8, color=color, label=label, zorder=5)
    faults = counted(len(report.faults), "fault") if report.faults else "no faults"
    name, length = title_of(report.plan), f"{report.length:.2f} m"
    axes.set_title(f"{name} on the {report.car_name} car: {length}, {faults}")


def _draw_spread(axes: Any, spread: Spread) -> None:
    """Draw the final positions of the runs, and the ellipses along the path."""
    axes.plot(*spread.cloud[:, :2].T, ".", ms=1.5, color="C1", alpha=0.3, zorder=2)
    axes.plot([], [], ".", color="C1", label="final positions, without walls")
    for mean, (major, minor, direction) in zip(spread.mean, spread.ellipses):
        angle = np.degrees(direction)
        shape = Ellipse(mean[:2], 2.0 * major, 2.0 * minor, angle=angle, fill=False, color="C3")
        axes.add_patch(shape)
    shape.set_label("95 % ellipse, without walls")


def _draw_commands(axes: Any, report: Report) -> None:
    """Draw speed and steering angle over time."""
    rows = report.plan.rows[: len(report.steps)]
    ends = [step.end / NANOSECONDS for step in report.steps[: len(rows)]]
    times = [state.stamp / NANOSECONDS for state in report.states]
    for side, field, unit, color in (
        (axes, "speed", "m/s", "C0"),
        (axes.twinx(), "steering_angle", "rad", "C1"),
    ):
        asked = [getattr(row, field) for row in rows]
        side.step([0.0, *ends], [asked[0], *asked], ls="--", color=color, lw=1.0)
        side.plot(times, [getattr(state, field) for state in report.states], color=color, lw=1.8)
        side.set_ylabel(f"{field.replace('_', ' ')} [{unit}]", color=color)
        side.tick_params(axis="y", colors=color)
        side.margins(y=0.15)
    if len(rows) <= _MAX_ARROWS:
        for end in ends:
            axes.axvline(end, color="grey", lw=0.4)
    axes.set_xlabel("time [s]   (dashed: asked for; solid: done)")
