"""Write a report as text."""

import math
from typing import Iterator, Optional, Sequence

import numpy as np

from mushr_ros_intro.plan.plan import Fault, Row, fault_lines, shortest_decimal
from mushr_ros_intro.preview.report import Report
from mushr_ros_intro.preview.spread import Spread
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.wording import counted

SHOWN_ROWS = 40
"""Of a longer plan only the first and the last rows are shown."""


def as_text(report: Report, spread: Optional[Spread] = None) -> Iterator[str]:
    """Yield the lines of a report as text."""
    plan = report.plan
    on_map = f", on the map {report.map_name}" if report.map_name else ""
    yield f"{plan.path}: {counted(len(plan.rows), 'row')}, on the {report.car_name} car{on_map}"
    yield from verdict(report.faults)
    yield ""
    yield "   line   speed  steering  duration  distance     turn         x         y    theta"
    yield "            m/s       rad         s         m      rad         m         m      rad"
    x, y, theta = plan.start
    yield f"  start {'':43} {x:9.3f} {y:9.3f} {theta:8.3f}"
    half = SHOWN_ROWS // 2
    count = min(len(plan.rows), len(report.steps))
    for index in range(count):
        if not half <= index < count - half:
            yield _table_line(report, index)
        elif index == half:
            yield f"    ... {count - 2 * half} more rows ..."
    if count < len(plan.rows):
        yield f"    ... {counted(len(plan.rows) - count, 'more row')}, not driven ..."
    elif len(report.steps) > count and report.steps[-1].distance > 0.0:
        yield _table_line(report, count)
    yield ""
    yield from _summary(report)
    if spread is not None:
        yield ""
        yield from _spread_text(report, spread)


def _table_line(report: Report, index: int) -> str:
    """Return the line of a row, counted from 0, or of the stop after the last row."""
    rows, step = [*report.plan.rows[index : index + 1], Row(0.0, 0.0, 0)], report.steps[index]
    before = report.steps[index - 1].pose if index else report.plan.start
    speed, angle = (shortest_decimal(each) for each in rows[0][:2])
    seconds, turn = (step.end - step.begin) / NANOSECONDS, step.pose.theta - before.theta
    x, y, theta = map(_near, step.pose)
    name = rows[0].line or "stop"
    columns = f"{speed:7.2f} {angle:9.4f} {seconds:9.2f} {step.distance:9.3f}"
    return f"{name:>7} {columns} {_near(turn):>8} {x:>9} {y:>9} {theta:>8}"


def _summary(report: Report) -> Iterator[str]:
    """Yield the lines below the table of rows."""
    plan, end = report.plan, report.final_pose
    left, right, bottom, top = report.box
    driven, seconds = report.rest / NANOSECONDS, plan.duration / NANOSECONDS
    until = f"{driven:.2f} of " if driven < seconds else ""
    yield f"length          {report.length:.2f} m"
    yield f"duration        {until}{seconds:g} s"
    theta = math.remainder(end.theta, math.tau)
    yield f"final pose      x {_near(end.x)} m, y {_near(end.y)} m, theta {_near(theta)} rad"
    box = f"x {_near(left)} to {_near(right)} m, y {_near(bottom)} to {_near(top)} m"
    yield f"bounding box    {box} (of the rear axle)"
    last, rolls = plan.rows[-1].speed, report.steps[-1].distance
    rest = f"no, the last row asks for {last:g} m/s; path_publisher then sends a stop"
    rolling = f", and the car rolls on for {rolls:.3f} m" if rolls else ""
    rest = f"{rest if last else 'yes'}{rolling}"
    yield f"ends at rest    {'no, a wall ends the drive' if report.collision else rest}"


def _near(value: float, digits: int = 3) -> str:
    """Return a number with some decimals, and zero without a minus sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def verdict(faults: Sequence[Fault]) -> Iterator[str]:
    """Yield the faults, and their number."""
    yield from fault_lines(faults)
    yield counted(len(faults), "fault") if faults else "no faults"


def _spread_text(report: Report, spread: Spread) -> Iterator[str]:
    car, (position, heading) = spread.car, spread.start_errors
    runs = len(spread.poses)
    yield f"final poses of {runs} runs, seed {spread.seed}; errors as standard deviations:"
    yield (
        f"  once a run      speed {100 * car.speed_gain_spread / car.speed_gain:g} %, steering "
        f"{car.steering_offset_spread:g} rad, start {position:g} m and {heading:g} rad"
    )
    yield f"  every command   speed {car.speed_noise:g} m/s, steering {car.steering_noise:g} rad"
    if report.map_name:
        yield "  walls           ignored"
    if not position:
        yield f"  the {report.car_name} car has no errors, so all runs end in the same place"
        return
    yield ""
    mean = spread.poses.mean(0)
    mean[2] = math.remainder(mean[2], math.tau)
    for title, values in (("mean", mean), ("deviation", spread.poses.std(0))):
        x, y, theta = map(_near, values.tolist())
        yield f"  {title:15} x {x} m, y {y} m, theta {theta} rad"
    most, rms = np.percentile(spread.distances, 95), math.sqrt(np.mean(spread.distances**2))
    share = f", {100 * rms / spread.distance:.1f} % of the distance" if spread.distance else ""
    yield f"  from prediction {rms:.3f} m (rms){share}; 95 % of the runs are within {most:.3f} m"
