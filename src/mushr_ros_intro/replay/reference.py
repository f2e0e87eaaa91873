"""The path that a controller follows: a CSV file, or the predicted path of a plan.

Each line of a CSV file is a pose and a speed: x [m], y [m], heading [rad], speed [m/s]. A header,
also behind ``#``, names other columns. Commas or semicolons separate them, and comments begin with
``#``. The path is straight between the poses.
"""

import math
import os
import re
from contextlib import suppress
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import MAX_COORDINATE, Pose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.paths import find_file
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import legs_of, trajectory
from mushr_ros_intro.preview.walls import fault_at, map_fault, start_fault, with_fence
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.world.footprint import Footprint, free_distance
from mushr_ros_intro.world.grid import Grid

COLUMNS = {
    "x": ("x", "x_m"),
    "y": ("y", "y_m"),
    "heading": ("heading", "heading_rad", "theta", "theta_rad", "yaw", "yaw_rad", "psi_rad"),
    "speed": ("speed", "speed_mps", "v", "v_mps", "vx_mps"),
}
"""The columns of a CSV file [m, m, rad, m/s], and their names in a header."""

MAX_TURN = 0.5
"""If the heading differs more from the direction to the next point, at most points, it is wrong."""

MIN_SPEED = 0.1
"""A lower speed counts as this one when the duration of a path is computed [m/s]."""

STEP = 0.05
"""Distance between the points of a resampled path [m]."""


class Reference(NamedTuple):
    """A path that a controller follows; it has at least two poses, and is not a single point."""

    path: str
    """The file that it was read from."""
    poses: Tuple[Pose, ...]
    """In the map frame."""
    stamps: Tuple[int, ...]
    """When a car that drives the path reaches each pose, since its start [ns]; rising."""

    @property
    def name(self) -> str:
        """The name of the file without its ending."""
        return os.path.splitext(os.path.basename(self.path))[0]

    @property
    def start(self) -> Pose:
        """The pose at which the car starts."""
        return self.poses[0]

    @property
    def duration(self) -> int:
        """How long a car that drives the path takes [ns]."""
        return self.stamps[-1]

    @property
    def speed(self) -> float:
        """The highest speed [m/s]."""
        seconds = np.diff(self.stamps) / NANOSECONDS
        return float(np.max(np.diff(lengths(np.array(self.poses)[:, :2])) / seconds))


Exercise = Union[Plan, Reference]
"""What a node does: it drives a plan, or it is a controller and follows a path."""


def refuse_walls(
    exercises: Iterable[Exercise], parameters: Dict[str, Any], grid: Optional[Grid]
) -> None:
    """Refuse plans and paths on which a car hits a wall.

    Args:
        exercises: the plans and paths.
        parameters: of the simulated car; its noise does not count.
        grid: the map, or None.

    Raises:
        UserError: a plan or a path hits a wall, or leaves the map.
    """
    if grid is None:
        return
    car = car_from(Parameters({**parameters, "noise": False}))
    for each in exercises:
        if isinstance(each, Reference):
            if text := _map_fault(each, grid):
                raise UserError(f"{text}; expected another path, or another map")
        elif fault := map_fault(each, legs_of(each, car), car, grid)[0]:
            raise UserError(f"{fault}. No node can pass; expected another plan, or another map")


def _map_fault(reference: Reference, grid: Grid) -> str:
    """Return where a car on a path hits a wall or leaves the map; "" if it does not."""
    place = f"{reference.path}: "
    if fault := start_fault(grid, reference.start):
        x, y, theta = reference.start
        return f"{place}{fault}, at ({x:.2f} m, {y:.2f} m, {theta:.2f} rad)"
    poses = np.array(reference.poses)
    along = lengths(poses[:, :2])
    columns = (*poses.T[:2], np.unwrap(poses.T[2]))

    def pose_at(distance: float) -> Pose:
        return Pose(*(float(np.interp(distance, along, each)) for each in columns))

    free = free_distance(with_fence(grid), Footprint(), pose_at, float(along[-1]))
    if free == along[-1]:
        return ""
    pose = pose_at(free)
    what = fault_at(grid, pose)
    return (
        f"{place}a car on the path {what} after {free:.2f} m, at ({pose.x:.2f} m, {pose.y:.2f} m)"
    )


def lengths(points: np.ndarray) -> np.ndarray:
    """Return the length of a polyline from its start to each of its points [m]; N x 2 -> N."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))


def resampled(poses: np.ndarray, step: float = STEP) -> np.ndarray:
    """Return poses on a polyline, `step` [m] apart, and its last pose; N x 3 -> M x 3."""
    along = lengths(poses[:, :2])
    places = np.append(np.arange(0.0, along[-1], step), along[-1])
    x, y, theta = (np.interp(places, along, each) for each in (*poses.T[:2], np.unwrap(poses.T[2])))
    return np.column_stack([x, y, theta])


def read_references(names: Sequence[str], folder: str) -> Dict[str, Reference]:
    """Return paths by name, given the names of files in `folder`, or paths of files.

    Raises:
        UserError: a file is missing, or has a fault; or two files have the same name.
    """
    found: Dict[str, Reference] = {}
    for name in names:
        path = _find(name, folder)
        reference = _from_csv(path) if path.endswith(".csv") else _from_plan(path)
        if reference.name in found:
            raise UserError(f"there are two paths with the name '{reference.name}'")
        found[reference.name] = reference
    return found


def _find(name: str, folder: str) -> str:
    """Return the path of a CSV file, or of a plan if there is none; raise UserError."""
    try:
        return find_file(name, folder, ".csv")
    except UserError:
        with suppress(UserError):
            return find_file(name, folder, ".txt")
        raise


def _from_plan(path: str) -> Reference:
    """Return the path that the ideal car drives with a plan."""
    states = list(trajectory(read_plan(path), Car()))
    return _checked(path, [s.pose for s in states], [s.stamp for s in states])


def _from_csv(path: str) -> Reference:
    """Return the path in a CSV file."""
    rows: List[List[float]] = []
    places: Sequence[int] = range(len(COLUMNS))
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(map(str.strip, file), 1):
            cells = [each.strip() for each in re.split("[,;]", line.lstrip("# "))]
            names = [each.lower() for each in cells]
            if not rows and {"x", "x_m"} & set(names) and {"y", "y_m"} & set(names):
                places = _places(names, f"{path}:{number}")
                continue
            if not line or line.startswith("#"):
                continue
            try:
                values = [float(cell) for cell in cells]
                values = [values[place] for place in places]
            except (ValueError, IndexError):
                values = []
            is_row = len(cells) == len(COLUMNS) or places != range(len(COLUMNS))
            if not values or not is_row or not all(abs(v) <= MAX_COORDINATE for v in values):
                raise UserError(
                    f"{path}:{number}: found {line[:80]!r}; expected four numbers: "
                    "x [m], y [m], heading [rad], speed [m/s]"
                )
            rows.append(values)
    _check_headings(path, rows)
    poses, seconds = [Pose(*row[:3]) for row in rows], 0.0
    stamps = [0] if rows else []
    for (before, pose), row in zip(zip(poses, poses[1:]), rows[1:]):
        seconds += before.distance_to(pose) / max(MIN_SPEED, abs(row[3]))
        stamps.append(from_seconds(seconds))
    return _checked(path, poses, stamps)


def _places(names: Sequence[str], place: str) -> List[int]:
    """Return the places of COLUMNS in a header; raise UserError if it does not have one of them."""
    places = []
    for column, known in COLUMNS.items():
        found = [index for index, name in enumerate(names) if name in known]
        if len(found) != 1:
            raise UserError(
                f"{place}: the columns are {', '.join(names)[:80]}; expected one column {column} "
                f"({', '.join(known)})"
            )
        places += found
    return places


def _check_headings(path: str, rows: Sequence[Sequence[float]]) -> None:
    """Raise UserError if the headings of a path are not those of a car that drives along it."""
    if any(abs(row[2]) > math.tau for row in rows):
        raise UserError(f"{path}: a heading is larger than 2 pi; expected radians, not degrees")
    moves = np.diff(np.array(rows).reshape(-1, len(COLUMNS)), axis=0)
    backward = math.pi * (np.array([row[3] for row in rows[1:]]) < 0.0)
    away = np.arctan2(moves[:, 1], moves[:, 0]) + backward
    turns = [
        np.abs(np.remainder(away - [row[2] for row in ends] + math.pi, math.tau) - math.pi)
        for ends in (rows[:-1], rows[1:])
    ]
    is_move = np.hypot(moves[:, 0], moves[:, 1]) > 0.0
    turn = np.median(np.minimum(*turns)[is_move]) if is_move.any() else 0.0
    if turn > MAX_TURN:
        raise UserError(
            f"{path}: the headings differ by {turn:.2g} rad from the direction to the next point; "
            "expected the columns x [m], y [m], heading [rad], speed [m/s], or a header with them"
        )


def _checked(path: str, poses: Sequence[Pose], stamps: Sequence[int]) -> Reference:
    """Return a path without poses that repeat the one before; raise UserError if it is a point."""
    kept = [
        index
        for index, pose in enumerate(poses)
        if index == 0 or (pose != poses[index - 1] and stamps[index] > stamps[index - 1])
    ]
    if len(kept) < 2 or not math.isfinite(sum(map(sum, poses))):
        raise UserError(f"{path}: expected a path of at least two different poses")
    return Reference(path, tuple(poses[i] for i in kept), tuple(stamps[i] for i in kept))
