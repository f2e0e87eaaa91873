"""Draw a plan: the path on the map, and below it speed and steering angle over time."""

import os
from typing import Any, Optional

import numpy as np
from matplotlib.figure import Figure

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.preview import drawing
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.spread import Spread
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted
from mushr_ros_intro.world.grid import Grid

_MAX_ARROWS = 100


def write_picture(
    path: str, report: Report, spread: Optional[Spread], grid: Optional[Grid]
) -> None:
    """Draw into a file; its ending is the format, and PNG without an ending.

    Raises:
        UserError: the file cannot be written, or matplotlib does not know the format.
    """
    kind = os.path.splitext(path)[1][1:] or "png"  # without it, savefig adds an ending
    try:
        draw_report(report, spread, grid).savefig(path, format=kind, dpi=120)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        text = f"{path} cannot be written: {reason}; expected a name such as figure_8.png"
        raise UserError(text) from None


def draw_report(report: Report, spread: Optional[Spread], grid: Optional[Grid]) -> Figure:
    """Return a drawing of a report, the spread and the map, if any."""
    figure, (above, key, *below) = drawing.new_figure(8.0, 5.4, 0.3, 1.2, 1.2)
    if spread is not None and any(spread.start_errors):
        _draw_spread(above, spread)
    _draw_path(above, report)
    drawing.finish_map(above, key, grid)
    _draw_commands(below, report)
    return figure


def _draw_path(axes: Any, report: Report) -> None:
    """Draw the path with its start, its end and the headings between the rows."""
    poses = np.array([state.pose for state in report.states])
    drawing.draw_path(axes, poses, drawing.PREDICTED, "predicted")
    begins = np.array([report.plan.start, *(step.pose for step in report.steps)])
    begins = begins[:: -(-len(begins) // _MAX_ARROWS)]
    drawing.draw_headings(axes, begins, drawing.PREDICTED, "heading between two rows")
    if report.collision:
        style = {"ms": 10, "color": drawing.ERROR, "zorder": 6}
        axes.plot(*poses[-1, :2], "X", label="the car hits a wall", **style)
    faults = counted(len(report.faults), "fault") if report.faults else "no faults"
    name, length = os.path.basename(report.plan.path), f"{report.length:.2f} m"
    drawing.set_title(axes, f"{name} on the {report.car_name} car: {length}, {faults}")


def _draw_spread(axes: Any, spread: Spread) -> None:
    """Draw the final poses of the runs: the positions, and the headings of some."""
    style = {"color": drawing.SPREAD, "zorder": 2}
    axes.plot(*spread.poses[:, :2].T, ".", ms=1.5, alpha=0.3, **style)
    label = "final pose of a run, without walls"
    drawing.draw_headings(axes, spread.poses[:_MAX_ARROWS], drawing.SPREAD, label)


def _draw_commands(panels: Any, report: Report) -> None:
    """Draw speed and steering angle over time, each in a panel of its own."""
    rows = report.plan.rows[: len(report.steps)]
    ends = [step.end / NANOSECONDS for step in report.steps[: len(rows)]]
    times = [state.stamp / NANOSECONDS for state in report.states]
    for axes, field, label in zip(
        panels, ("speed", "steering_angle"), ("speed [m/s]", "steering\nangle [rad]")
    ):
        asked = [getattr(row, field) for row in rows]
        commanded, values = [asked[0], *asked], [getattr(state, field) for state in report.states]
        style = {"color": drawing.COMMANDED, "ls": "--", "zorder": 3}
        axes.plot(times, values, color=drawing.PREDICTED, label="predicted")
        axes.step([0.0, *ends], commanded, label="commanded", **style)
        axes.set_ylabel(label)
        axes.margins(y=0.15)
        if len(rows) <= _MAX_ARROWS:
            for end in ends:
                axes.axvline(end, color="grey", lw=0.4)
    panels[0].tick_params(labelbottom=False)
    panels[0].legend(fontsize="small")
    panels[1].set_xlabel("time since the first command [s]")
