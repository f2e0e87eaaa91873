"""Check a plan before it is driven: against a car's limits and against the walls of a map.

Everything here comes from the kinematics that the simulated car obeys. Poses are those of
base_footprint, the middle of the rear axle on the ground, in the map frame.
"""

import math
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.bicycle import Pose, curvature
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.car.motion import apply
from mushr_ros_intro.plan.model import (
    MAX_DURATION,
    MAX_SPEED,
    Fault,
    Plan,
    as_float32,
    shortest_decimal,
)
from mushr_ros_intro.preview.ensemble import (
    PERIOD,
    Errors,
    Spread,
    Track,
    commands,
    count_ticks,
    ellipse,
    follow,
    instants,
    moments,
    spread,
)
from mushr_ros_intro.sim.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import Footprint, is_free, on_map
from mushr_ros_intro.world.grid import Grid

MAX_FINE_TICKS = 200_000
"""A plan with more ticks is followed row by row, and not tick by tick."""

RAMP_PARTS = 16
"""Into so many a tick is cut in which the steering ramps, because its way is no arc."""

SHOWN_ROWS = 40
"""Of a longer plan the table shows the first and the last rows only."""

SHOWN_FAULTS = 20
"""So many faults of a plan are shown, and how many more there are."""

RUN_ERRORS = Errors(speed_scale=0.02, steering_offset=0.01, start_position=0.02, start_heading=0.02)
"""What a real car is off by for a whole run. No figures were found; these are our choice.

Tyres and battery are worth a few per cent of the speed, a servo's trim about half a degree, and
who puts the car down by eye is off by a thumb's width and a degree.
"""

_FLOAT32 = 1e-6
"""By this part a ramp may be too long for its row: commands are float32, which is less exact."""

_MARKS = 10  # rows of the table that shows how the spread grows


class Report(NamedTuple):
    """What there is to know about a plan before it is driven."""

    plan: Plan
    car_name: str
    car: Car
    map_name: str
    """The map that it was checked against, or nothing."""
    rows: Track
    """The car row by row, and the stop at the end as one more."""
    path: Track
    """The same in finer steps, tick by tick unless the plan is very long."""
    box: Tuple[float, float, float, float]
    """The least and the largest x, and the least and the largest y, of the whole path [m]."""
    radius: float
    """Of the tightest bend that it drives [m], infinite if it only drives straight."""
    faults: Tuple[Fault, ...]
    hit: Optional[Pose]
    """Where it hits a wall, if it does."""

    @property
    def length(self) -> float:
        """How far the car drives, forward and in reverse, to a standstill [m]."""
        return float(self.rows.distances.sum())

    @property
    def final_pose(self) -> Pose:
        """Where the car comes to rest."""
        return Pose(*self.rows.poses[-1].tolist())

    @property
    def closing_gap(self) -> Tuple[float, float]:
        """How far the end is from the start [m], and by how much it is turned [rad]."""
        start, end = self.plan.start, self.final_pose
        gap = math.hypot(end.x - start[0], end.y - start[1])
        return gap, math.remainder(end.theta - start[2], math.tau)


class Scatter(NamedTuple):
    """How a plan's runs spread, all along the plan and at its end."""

    errors: Errors
    seed: int
    seconds: np.ndarray
    """When [s], (instants,)."""
    distances: np.ndarray
    """How far a car without errors has driven by then [m]."""
    planned: np.ndarray
    """Where it is, (instants, 3)."""
    sampled: Spread
    closed: Spread
    """The closed form, for a car that has the same errors and no ramps."""

    @property
    def rms_errors(self) -> np.ndarray:
        """How far the runs are from where they should be [m], root mean square, (instants,)."""
        apart = self.sampled.mean[:, :2] - self.planned[:, :2]
        variance = np.trace(self.sampled.covariance[:, :2, :2], axis1=1, axis2=2)
        return np.sqrt((apart**2).sum(axis=1) + variance)


def check(
    plan: Plan,
    car_name: str,
    car: Car,
    map_name: str = "",
    grid: Optional[Grid] = None,
    footprint: Footprint = Footprint(),  # noqa: B008, it is immutable
) -> Report:
    """Check a plan.

    Args:
        plan: to be checked.
        car_name: of the profile.
        car: the profile's.
        map_name: of the map, if there is one.
        grid: the map.
        footprint: of the car.
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    durations, speeds, angles = commands(plan, car)
    stopping = 0
    if not math.isinf(car.acceleration):
        stopping = math.ceil(float(np.abs(speeds).max()) / car.acceleration * NANOSECONDS)
    durations, speeds, angles = (
        np.append(each, end) for each, end in ((durations, stopping), (speeds, 0.0), (angles, 0.0))
    )
    rows = follow(plan.start, durations, speeds, angles, car)
    is_fine = count_ticks(plan) <= MAX_FINE_TICKS
    counts = -(-durations // PERIOD) if is_fine else np.ones(len(durations), np.int64)
    row_of = np.repeat(np.arange(len(durations)), counts)
    fine = np.full(len(row_of), PERIOD)
    has_ticks = counts > 0
    lasts = (np.cumsum(counts) - 1)[has_ticks]
    fine[lasts] = (durations - (counts - 1) * PERIOD)[has_ticks]
    path = rows
    if is_fine:
        path = follow(plan.start, fine, speeds[row_of], angles[row_of], car)
    if is_fine and not math.isinf(car.steering_rate):
        parts = np.where(path.angles[:-1] != path.angles[1:], RAMP_PARTS, 1)
        rest = fine - fine // parts * (parts - 1)
        ends = np.cumsum(parts) - 1
        fine, row_of = np.repeat(fine // parts, parts), np.repeat(row_of, parts)
        fine[ends] = rest
        path = follow(plan.start, fine, speeds[row_of], angles[row_of], car)
    # Where the car turns round it is further out than where the ticks begin and end.
    turning = np.flatnonzero(path.speeds[:-1] * path.speeds[1:] < 0.0)
    if len(turning) and not math.isinf(car.acceleration):
        before = np.abs(path.speeds[turning]) / car.acceleration * NANOSECONDS
        before = np.minimum(before.astype(np.int64), fine[turning])
        fine[turning] -= before
        fine = np.insert(fine, turning, before)
        row_of = np.insert(row_of, turning, row_of[turning])
        path = follow(plan.start, fine, speeds[row_of], angles[row_of], car)

    faults = [*_limit_faults(plan, car_name, car), *_ramp_faults(rows, plan, car_name, car)]
    hit = None
    if grid is not None:
        targets = speeds[row_of], angles[row_of]
        fault, hit = _map_fault(plan, path, row_of, targets, car, World(grid, footprint))
        faults += [fault] if fault else []
    faults.sort(key=lambda fault: (fault.line, fault.column))
    bends = np.abs(np.tan(path.angles[1:]))[path.distances > 0.0] / car.wheelbase
    tightest = float(bends.max()) if len(bends) else 0.0
    return Report(
        plan,
        car_name,
        car,
        map_name,
        rows,
        path,
        _box(path),
        1.0 / tightest if tightest else math.inf,
        tuple(faults),
        hit,
    )


def slowed(plan: Plan, max_speed: float) -> Tuple[Plan, List[Fault]]:
    """Return a plan with no speed above a limit, forward and in reverse.

    Args:
        plan: to be slowed down.
        max_speed: the highest speed [m/s].

    Returns:
        The plan that is left of it, and what each run of rows that are too fast gets instead.
    """
    limit = as_float32(min(max_speed, MAX_SPEED))
    speeds = np.array([row.speed for row in plan.rows])
    is_fast = np.abs(speeds) > limit
    said = [
        plan.fault(
            first,
            0,
            f"{_asks(first, last, speeds, 'm/s')}; the largest speed allowed is {max_speed:g} m/s, "
            "and that is sent",
        )
        for first, last in _runs(is_fast)
    ]
    rows = list(plan.rows)
    for index in np.flatnonzero(is_fast).tolist():
        rows[index] = rows[index]._replace(speed=math.copysign(limit, rows[index].speed))
    return plan._replace(rows=tuple(rows)), said


# What is wrong ----------------------------------------------------------------------------------


def _runs(is_bad: np.ndarray) -> Iterator[Tuple[int, int]]:
    """Yield the first and the last index of every run of true values."""
    edges = np.flatnonzero(np.diff(is_bad.astype(np.int8), prepend=0, append=0)).tolist()
    for first, end in zip(edges[::2], edges[1::2]):
        yield first, end - 1


def _rows_named(first: int, last: int) -> str:
    """Name rows that are counted from 0."""
    return f"row {first + 1}" if first == last else f"rows {first + 1} to {last + 1}"


def _asks(first: int, last: int, values: np.ndarray, unit: str) -> str:
    """Say what rows, counted from 0, ask for."""
    part = values[first : last + 1]
    span = sorted({float(part.min()), float(part.max())}, key=abs)
    shown = " to ".join(f"{each:.6g}" for each in span)
    return f"{_rows_named(first, last)} {'asks' if first == last else 'ask'} for {shown} {unit}"


def _limit_faults(plan: Plan, car_name: str, car: Car) -> Iterator[Fault]:
    """Yield a fault for each run of rows that ask for more than the car does."""
    speeds = np.array([row.speed for row in plan.rows])
    angles = np.array([row.steering_angle for row in plan.rows])
    for cell, values, limit, does in (
        (0, speeds, car.speed_limit, "does {:.4g} m/s"),
        (0, -speeds, car.speed_limit, "does {:.4g} m/s in reverse"),
        (1, angles, car.steering_limit_left, "steers {:.4g} rad to the left"),
        (1, -angles, car.steering_limit_right, "steers {:.4g} rad to the right"),
    ):
        asked = (speeds, angles)[cell]
        # A row is rounded to float32, so the limit itself would be above the limit.
        for first, last in _runs(values > as_float32(min(limit, MAX_SPEED))):
            text = f"{_asks(first, last, asked, ('m/s', 'rad')[cell])}; "
            text += f"the {car_name} {does.format(limit)} at most"
            yield plan.fault(first, cell, text)


def _ramp_faults(rows: Track, plan: Plan, car_name: str, car: Car) -> Iterator[Fault]:
    """Yield a fault for each run of rows that end before the car has done what they ask for."""
    durations, speeds, angles = commands(plan, car)
    for cell, targets, values, rate, unit, rate_unit in (
        (0, speeds, rows.speeds, car.acceleration, "m/s", "m/s^2"),
        (1, angles, rows.angles, car.steering_rate, "rad", "rad/s"),
    ):
        if math.isinf(rate):
            continue
        begins = values[: len(targets)]
        needed = np.abs(targets - begins) / rate
        seconds = durations / NANOSECONDS
        for first, last in _runs(needed > seconds * (1.0 + _FLOAT32)):
            verb = "is" if first == last else "are"
            text = (
                f"{_rows_named(first, last)} {verb} too short: the {car_name} needs "
                f"{needed[first]:.3g} s from {begins[first]:.3g} to {targets[first]:.3g} {unit} "
                f"at {rate:g} {rate_unit}, and row {first + 1} lasts {seconds[first]:.3g} s"
            )
            yield plan.fault(first, cell, text)


def _map_fault(
    plan: Plan,
    path: Track,
    row_of: np.ndarray,
    targets: Tuple[np.ndarray, np.ndarray],
    car: Car,
    world: World,
) -> Tuple[Optional[Fault], Optional[Pose]]:
    """Return the first thing that is wrong between the path and the map, and where it hits."""
    grid, footprint = world
    start = Pose(*path.poses[0].tolist())
    if not on_map(grid, footprint, start):
        return plan.fault(-1, 0, "the start pose is off the map, at least in part"), None
    if not is_free(grid, footprint, start):
        return plan.fault(-1, 0, "the start pose is in a wall, at least in part"), None
    left = _first_off_map(path, grid, footprint)
    for index in _near_walls(path, grid, footprint):
        if left is not None and index >= left:
            break
        stamp, duration = int(path.instants[index]), int(np.diff(path.instants[index:][:2])[0])
        speed, angle = float(targets[0][index]), float(targets[1][index])
        duration = min(duration, _enough(path, index, speed, angle, car, grid))
        state = at_rest(stamp, Pose(*path.poses[index].tolist()))._replace(
            speed=float(path.speeds[index]), steering_angle=float(path.angles[index])
        )
        command = Command(stamp, speed, angle)
        moved = apply(state, command, car._replace(command_timeout=duration), world)
        contacts = [piece.collision for piece in moved.motion if piece.collision is not None]
        if contacts and contacts[0].stamp <= stamp + duration:
            where = contacts[0].pose
            text = _happens(plan, int(row_of[index]), "hits a wall", contacts[0].stamp, where)
            return plan.fault(int(row_of[index]), 0, f"{text}; it stops there"), where
    if left is None:
        return None, None
    where = Pose(*path.poses[left].tolist())
    row = int(row_of[left - 1])
    text = _happens(plan, row, "leaves the map", int(path.instants[left]), where)
    return plan.fault(row, 0, text), None


def _enough(path: Track, index: int, speed: float, angle: float, car: Car, grid: Grid) -> int:
    """Return how long [ns] a step has to be followed to find what it hits on the map.

    When its ramps have ended it is an arc, which repeats itself after a turn, or has left the map
    when it is longer than the map's edges.
    """
    if speed == 0.0:
        return MAX_DURATION
    seconds = abs(speed - path.speeds[index]) / car.acceleration
    seconds += abs(angle - path.angles[index]) / car.steering_rate
    edges = 2.0 * (grid.width + grid.height) * grid.resolution
    bend = abs(curvature(angle, car.wheelbase))
    seconds += min(edges, 2.0 * math.pi / bend if bend else edges) / abs(speed)
    return math.ceil(min(seconds * NANOSECONDS, MAX_DURATION))


def _happens(plan: Plan, row: int, what: str, stamp: int, pose: Pose) -> str:
    """Say what happens in a row, when [ns] and where."""
    is_stop = row >= len(plan.rows)
    who = "the car, rolling on after the last row," if is_stop else f"row {row + 1}"
    return f"{who} {what} at t = {stamp / NANOSECONDS:.1f} s, ({pose.x:.1f}, {pose.y:.1f})"


def _in_grid(path: Track, grid: Grid) -> np.ndarray:
    """Return the path's x and y in the grid's own frame [m], (2, instants)."""
    zero, one = grid.to_grid(Pose(0.0, 0.0, 0.0)), grid.to_grid(Pose(1.0, 0.0, 0.0))
    cos, sin = one.x - zero.x, one.y - zero.y
    x, y = path.poses[:, 0], path.poses[:, 1]
    return np.stack((zero.x + cos * x - sin * y, zero.y + sin * x + cos * y))


def _reach(footprint: Footprint) -> float:
    """Return how far from base_footprint the body reaches [m]."""
    return math.hypot(max(footprint.front, footprint.back), footprint.half_width)


def _first_off_map(path: Track, grid: Grid, footprint: Footprint) -> Optional[int]:
    """Return the first index of the path at which the body is no longer wholly on the map."""
    x, y = _in_grid(path, grid)
    reach = _reach(footprint)
    width, height = grid.width * grid.resolution, grid.height * grid.resolution
    edge = (x < reach) | (y < reach) | (x > width - reach) | (y > height - reach)
    for index in np.flatnonzero(edge).tolist():
        if not on_map(grid, footprint, Pose(*path.poses[index].tolist())):
            return index
    return None


def _near_walls(path: Track, grid: Grid, footprint: Footprint) -> List[int]:
    """Return the steps of the path, in order, that have a wall in their neighbourhood.

    Every point of a step is within half its length of one of its ends. So is the body, with its
    reach, in a box round both; whether there is a wall in that, a table of sums tells at once.
    """
    side = max(1, -(-max(grid.width, grid.height) // 1000))  # cells of the map in one of the table
    padding = [(0, -grid.height % side), (0, -grid.width % side)]
    blocks = np.pad(grid.occupied, padding)
    blocks = blocks.reshape(blocks.shape[0] // side, side, -1, side).any(axis=(1, 3))
    sums = np.zeros((blocks.shape[0] + 1, blocks.shape[1] + 1), np.int32)
    blocks.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, out=sums[1:, 1:])

    around = 0.5 * path.distances + _reach(footprint) + grid.resolution
    bounds = []
    for values, count in zip(_in_grid(path, grid), (blocks.shape[1], blocks.shape[0])):
        low = np.minimum(values[:-1], values[1:]) - around
        high = np.maximum(values[:-1], values[1:]) + around
        scale = 1.0 / (grid.resolution * side)
        bounds.append(np.clip(np.floor(low * scale), 0, count).astype(np.int64))
        bounds.append(np.clip(np.ceil(high * scale), 0, count).astype(np.int64))
    left, right, bottom, top = bounds
    walls = sums[top, right] - sums[bottom, right] - sums[top, left] + sums[bottom, left]
    return np.flatnonzero((walls > 0) & (path.distances > 0.0)).tolist()


def _box(path: Track) -> Tuple[float, float, float, float]:
    """Return the least and the largest x and y of the path, with what bulges between its points.

    An arc is at its extremes where its heading is along an axis. While a ramp lasts, the way is
    taken for an arc, which is short: see RAMP_PARTS.
    """
    turns = np.diff(path.poses[:, 2])
    signs = np.sign(np.where(path.speeds[1:] != 0.0, path.speeds[1:], path.speeds[:-1]))
    lows, highs = path.poses[:, :2].min(axis=0), path.poses[:, :2].max(axis=0)
    bent = np.flatnonzero(np.abs(turns) > 1e-9)
    begin = path.poses[:-1][bent]
    end = begin[:, 2] + turns[bent]
    radius = signs[bent] * path.distances[bent] / turns[bent]
    low, high = np.minimum(begin[:, 2], end), np.maximum(begin[:, 2], end)
    for first in (1, 2, 3, 4):  # the four headings along an axis; more turns repeat them
        heading = np.ceil(low / (0.5 * math.pi)) + first - 1
        heading *= 0.5 * math.pi
        there = heading < high
        x = begin[:, 0] + radius * (np.sin(heading) - np.sin(begin[:, 2]))
        y = begin[:, 1] - radius * (np.cos(heading) - np.cos(begin[:, 2]))
        for axis, values in enumerate((x[there], y[there])):
            if len(values):
                lows[axis] = min(lows[axis], values.min())
                highs[axis] = max(highs[axis], values.max())
    return float(lows[0]), float(highs[0]), float(lows[1]), float(highs[1])


# The spread -------------------------------------------------------------------------------------


def scatter(report: Report, car: Car, runs: int, seed: int) -> Scatter:
    """Drive a plan many times, each time with errors of its own.

    Args:
        report: on the plan.
        car: its noise is that of every tick; where there is any, RUN_ERRORS come on top.
        runs: how many, 2 at least.
        seed: of the random numbers.
    """
    errors = Errors()
    if car.speed_noise or car.steering_noise:
        errors = RUN_ERRORS._replace(speed=car.speed_noise, steering_angle=car.steering_noise)
    plan = report.plan
    every = max(1, -(-count_ticks(plan) // _MARKS))
    when = np.array(instants(plan, every), np.float64)
    path = report.path
    distances = np.append(0.0, path.distances.cumsum())
    sampled = spread(plan, car, errors, runs, seed, every)
    planned = np.stack([np.interp(when, path.instants, each) for each in path.poses.T], axis=1)
    along = np.interp(when, path.instants, distances)
    planned[-1], along[-1] = path.poses[-1], distances[-1]  # where it has come to rest
    closed = moments(plan, car, errors, every)
    return Scatter(errors, seed, when / NANOSECONDS, along, planned, sampled, closed)


# In words ---------------------------------------------------------------------------------------


def as_text(report: Report, result: Optional[Scatter] = None) -> Iterator[str]:
    """Yield the lines of a report that a student can read."""
    plan = report.plan
    count = len(plan.rows)
    yield f"{plan.path}: {_counted(count, 'row')}, on the {report.car_name} car" + (
        f", on the map {report.map_name}" if report.map_name else ""
    )
    yield ""
    yield "    row   speed  steering  duration  distance     turn         x         y    theta"
    yield "            m/s       rad         s         m      rad         m         m      rad"
    x, y, theta = plan.start
    yield f"  start {'':43} {x:9.3f} {y:9.3f} {theta:8.3f}"
    half = SHOWN_ROWS // 2
    for index, row in enumerate(plan.rows):
        if count > SHOWN_ROWS and half <= index < count - half:
            if index == half:
                yield f"    ... {count - 2 * half} more rows ..."
            continue
        yield _table_line(report, index, f"{index + 1:7}", row.speed, row.steering_angle)
    if report.rows.distances[-1] > 0.0:
        yield _table_line(report, count, "   stop", 0.0, 0.0)
    yield ""
    yield from _summary(report)
    if result is not None:
        yield ""
        yield from _spread_text(report, result)
    yield ""
    yield from verdict(report.faults)


def _table_line(report: Report, index: int, name: str, speed: float, angle: float) -> str:
    """Return the line of a row, counted from 0, or of the stop after the last one."""
    track = report.rows
    seconds = (track.instants[index + 1] - track.instants[index]) / NANOSECONDS
    turn = track.poses[index + 1, 2] - track.poses[index, 2]
    cells = f"{name} {speed:7.2f} {angle:9.4f} {seconds:9.2f} {track.distances[index]:9.3f}"
    x, y, theta = track.poses[index + 1]
    return f"{cells} {_near(turn):>8} {_near(x):>9} {_near(y):>9} {_near(theta):>8}"


def _summary(report: Report) -> Iterator[str]:
    """Yield the lines below the table."""
    plan, end = report.plan, report.final_pose
    gap, turned = report.closing_gap
    left, right, bottom, top = report.box
    yield f"length          {report.length:.2f} m"
    yield f"duration        {plan.duration / NANOSECONDS:g} s"
    theta = math.remainder(end.theta, math.tau)
    yield f"final pose      x {_near(end.x)} m, y {_near(end.y)} m, theta {_near(theta)} rad"
    yield f"closing gap     {_near(gap)} m and {_near(turned)} rad between start and end"
    yield (
        f"bounding box    x {_near(left)} to {_near(right)} m, y {_near(bottom)} to {_near(top)} m"
        " (of the rear axle)"
    )
    radius = "none, it drives straight" if math.isinf(report.radius) else f"{report.radius:.3f} m"
    yield f"turning radius  {radius if math.isinf(report.radius) else 'at least ' + radius}"
    last, rolls = plan.rows[-1].speed, report.rows.distances[-1]
    if last == 0.0:
        rest = "yes"
    else:
        rest = f"no, the last row asks for {last:g} m/s; path_publisher then sends a stop"
    if rolls > 0.0:
        rest += f", and the car rolls on for {rolls:.3f} m"
    yield f"ends at rest    {rest}"


def _near(value: float) -> str:
    """Return a number with three digits, and no minus before a zero."""
    return f"{value if abs(value) >= 5e-4 else 0.0:.3f}"


def _counted(count: int, thing: str) -> str:
    """Return a number of things."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def verdict(faults: Sequence[Fault]) -> Iterator[str]:
    """Yield the faults, and how many they are."""
    for fault in faults[:SHOWN_FAULTS]:
        yield str(fault)
    if len(faults) > SHOWN_FAULTS:
        yield f"... and {len(faults) - SHOWN_FAULTS} more faults"
    yield _counted(len(faults), "fault") if faults else "no faults"


def _spread_text(report: Report, result: Scatter) -> Iterator[str]:
    """Yield the lines on the spread."""
    sampled, errors = result.sampled, result.errors
    yield f"spread of {sampled.runs} runs, seed {result.seed}, as standard deviations:"
    yield (
        f"  once a run      speed {100 * errors.speed_scale:g} %, steering "
        f"{errors.steering_offset:g} rad, start {errors.start_position:g} m and "
        f"{errors.start_heading:g} rad"
    )
    yield f"  every command   speed {errors.speed:g} m/s, steering {errors.steering_angle:g} rad"
    if errors == Errors():
        yield f"  the {report.car_name} car has no errors, so all runs end in the same place"
        return
    yield ""
    yield "  time  distance   mean x   mean y    theta    95 % ellipse      off the plan"
    yield "     s         m        m        m      rad    m long  m wide        m   of way"
    for time, distance, mean, covariance, off in zip(
        result.seconds, result.distances, sampled.mean, sampled.covariance, result.rms_errors
    ):
        major, minor, _ = ellipse(covariance)
        share = f"{100 * off / distance:7.1f} %" if distance > 0.0 else ""
        yield (
            f"{time:6.1f}{distance:10.2f}{mean[0]:9.3f}{mean[1]:9.3f}{mean[2]:9.3f}"
            f"{2 * major:10.3f}{2 * minor:8.3f}{off:9.3f}{share}"
        )
    yield ""
    exponent = growth(result)
    if exponent is not None:
        yield f"the error grows with the distance to the power of {exponent:.1f}"
    is_limited = not math.isinf(report.car.acceleration) or not math.isinf(report.car.steering_rate)
    titles = (
        "final pose, from the runs:",
        "final pose, in closed form" + (" (for a car without ramps):" if is_limited else ":"),
    )
    for title, each in zip(titles, (sampled, result.closed)):
        yield title
        yield from _final_text(each)


def _final_text(result: Spread) -> Iterator[str]:
    """Yield mean, covariance and ellipse at the end."""
    x, y, theta = result.mean[-1].tolist()
    yield f"  mean          x {_near(x)} m, y {_near(y)} m, theta {_near(theta)} rad"
    names = ("m", "m", "rad")
    for number, row in enumerate(result.covariance[-1].tolist()):
        title = "covariance" if number == 0 else ""
        units = ", ".join(f"{names[number]} {each}" for each in names)
        cells = "".join(f"{each if abs(each) >= 5e-6 else 0.0:12.5f}" for each in row)
        yield f"  {title:12}{cells}   [{units}]"
    major, minor, direction = ellipse(result.covariance[-1])
    yield (
        f"  95 % ellipse  {2 * major:.3f} m long at {_near(direction)} rad, {2 * minor:.3f} m wide"
    )


def growth(result: Scatter) -> Optional[float]:
    """Return the power of the distance with which the error grows, by least squares.

    None where there is no error, or no way.
    """
    errors = result.rms_errors
    is_some = (result.distances > 0.0) & (errors > 1e-9)
    if np.count_nonzero(is_some) < 3 or np.ptp(result.distances[is_some]) == 0.0:
        return None
    logs = np.log(result.distances[is_some]), np.log(errors[is_some])
    return float(np.polyfit(*logs, 1)[0])


# For programs -----------------------------------------------------------------------------------


def as_json(report: Report, result: Optional[Scatter] = None) -> Dict[str, Any]:
    """Return a report as values for JSON; lengths in m, angles in rad, times in s.

    The rows are lists, one for each column, with the stop at the end as the last item.
    """
    track, plan = report.rows, report.plan
    end = report.final_pose
    gap, turned = report.closing_gap
    left, right, bottom, top = report.box
    values: Dict[str, Any] = {
        "plan": plan.path,
        "car": report.car_name,
        "map": report.map_name or None,
        "start": dict(zip(("x", "y", "theta"), plan.start)),
        "rows": {
            "line": [row.line for row in plan.rows] + [None],
            "speed": [shortest_decimal(row.speed) for row in plan.rows] + [0.0],
            "steering_angle": [shortest_decimal(row.steering_angle) for row in plan.rows] + [0.0],
            "duration": (np.diff(track.instants) / NANOSECONDS).tolist(),
            "distance": track.distances.tolist(),
            "turn": np.diff(track.poses[:, 2]).tolist(),
            "x": track.poses[1:, 0].tolist(),
            "y": track.poses[1:, 1].tolist(),
            "theta": track.poses[1:, 2].tolist(),
        },
        "length": report.length,
        "duration": plan.duration / NANOSECONDS,
        "final_pose": end._asdict(),
        "closing_gap": {"distance": gap, "turn": turned},
        "bounding_box": {"x": [left, right], "y": [bottom, top]},
        "turning_radius": None if math.isinf(report.radius) else report.radius,
        "ends_at_rest": plan.rows[-1].speed == 0.0,
        "faults": [fault._asdict() for fault in report.faults],
    }
    if result is not None:
        values["spread"] = {
            "runs": result.sampled.runs,
            "seed": result.seed,
            "errors": result.errors._asdict(),
            "time": result.seconds.tolist(),
            "distance": result.distances.tolist(),
            "error": result.rms_errors.tolist(),
            "sampled": _spread_json(result.sampled),
            "closed_form": _spread_json(result.closed),
        }
    return values


def _spread_json(result: Spread) -> Dict[str, Any]:
    """Return mean, covariance and ellipse at each instant."""
    return {
        "mean": result.mean.tolist(),
        "covariance": result.covariance.tolist(),
        "ellipse_95": [ellipse(each) for each in result.covariance],
    }
