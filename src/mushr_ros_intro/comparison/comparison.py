"""Compare the driven path with the predicted one.

Both begin at the same pose, at the first command that moves the car. Times count from there.
"""

from typing import List, NamedTuple, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog, start_pose
from mushr_ros_intro.geometry import drive_arc
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import rest, states_at
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

_SETTLED = 0.3
"""So long after the predicted rest, the car stands [s]."""


class RowResult(NamedTuple):
    """What one row did, predicted and driven."""

    line: int
    """Line in the plan's file; 0 if the row comes from the commands."""
    speed: float
    """The commanded speed [m/s]."""
    steering_angle: float
    """The commanded steering angle [rad]."""
    end: float
    """When the row ends [s]."""
    distance: Tuple[float, float]
    """Predicted and driven [m], negative in reverse."""
    turn: Tuple[float, float]
    """Predicted and driven [rad]."""
    predicted: Tuple[float, float, float]
    """The pose at the end: x [m], y [m], theta [rad]."""
    driven: Tuple[float, float, float]
    error: float
    """The distance of the two [m]."""


class Comparison(NamedTuple):
    """A driven and a predicted path."""

    log: DriveLog
    car: Car
    delay: float
    """From a command to its effect on the pose [s]."""
    pose_offset: float
    """Distance of the point whose pose is reported, in front of the rear axle [m]."""
    plan: Plan
    """The rows, from the pose at which the car stood at the begin."""
    standing: int
    """The number of poses that the start pose is the mean of; 0 if it is the first pose."""
    times: np.ndarray
    """[s], (N,)."""
    predicted: np.ndarray
    """x [m], y [m], theta [rad], (N, 3)."""
    driven: np.ndarray
    """Likewise."""
    rows: Tuple[RowResult, ...]

    @property
    def distances(self) -> np.ndarray:
        """The distance predicted to be driven until each time [m], forward and in reverse, (N,)."""
        return np.concatenate([[0.0], np.cumsum(np.abs(_along(self.predicted)))])

    @property
    def errors(self) -> np.ndarray:
        """The part of the error along and the part across the predicted path [m], (N, 2).

        Forward and left are positive.
        """
        x, y, _ = (self.driven - self.predicted).T
        cos, sin = np.cos(self.predicted[:, 2]), np.sin(self.predicted[:, 2])
        return np.column_stack([cos * x + sin * y, cos * y - sin * x])

    @property
    def sizes(self) -> np.ndarray:
        """The size of the error at each time [m], (N,)."""
        return np.hypot(*self.errors.T)

    @property
    def limited_rows(self) -> Tuple[int, ...]:
        """The indices of the rows that ask for more than the limits of the car."""
        rows = enumerate(self.log.plan.rows)
        return tuple(i for i, row in rows if self.car.within_limits(*row[:2]) != row[:2])

    @property
    def rms(self) -> float:
        """The root mean square of the error [m]."""
        return float(np.sqrt(np.mean(self.sizes**2)))

    @property
    def final_turn(self) -> float:
        """The error of the final heading [rad], positive to the left."""
        return float(np.angle(np.exp(1j * (self.driven[-1, 2] - self.predicted[-1, 2]))))


def compare(log: DriveLog, car: Car, delay: float, pose_offset: float = 0.0) -> Comparison:
    """Compare a drive with what a car would have done.

    The last pose is the mean of the poses after the car has come to rest.

    Args:
        log: the drive.
        car: of the prediction; its noise is not used.
        delay: from a command to its effect on the pose [s].
        pose_offset: distance of the point whose pose is reported, in front of the rear axle [m].
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    stamps = log.stamps - from_seconds(delay)
    start, standing = start_pose(log, from_seconds(delay))
    plan = log.plan._replace(start=drive_arc(start, -pose_offset, 0.0))
    end, _ = rest(plan, car)
    driven = log.poses.copy()
    driven[:, 2] = np.unwrap(driven[:, 2])
    is_after = stamps >= end + from_seconds(_SETTLED)
    is_used = (stamps >= 0) & (stamps < end)
    if is_after.any():
        stamps, driven = (
            np.append(stamps[is_used], end),
            np.vstack([driven[is_used], driven[is_after].mean(axis=0)]),
        )
    else:
        stamps, driven = stamps[is_used], driven[is_used]
    predicted = _predicted(plan, car, stamps, pose_offset)
    turns = np.round((driven[0, 2] - predicted[0, 2]) / (2.0 * np.pi))
    driven[:, 2] -= 2.0 * np.pi * turns
    times = stamps / NANOSECONDS
    rows = _rows(plan, car, times, driven, pose_offset)
    return Comparison(log, car, delay, pose_offset, plan, standing, times, predicted, driven, rows)


def _moved(poses: np.ndarray, distance: float) -> np.ndarray:
    """Return poses that are moved forward by a distance [m]."""
    x, y, theta = poses.T
    return np.column_stack([x + distance * np.cos(theta), y + distance * np.sin(theta), theta])


def _predicted(plan: Plan, car: Car, stamps: np.ndarray, pose_offset: float) -> np.ndarray:
    """Return the predicted poses of the reported point at some stamps [ns]."""
    poses = [state.pose for state in states_at(plan, car, stamps.tolist())]
    return _moved(np.array(poses, float), pose_offset)


def _along(poses: np.ndarray) -> np.ndarray:
    """Return the distance from each pose to the next one [m], negative in reverse.

    It is measured along the heading, so the noise of the poses does not add up.
    """
    x, y, theta = np.diff(poses, axis=0).T
    heading = poses[:-1, 2] + 0.5 * theta
    return x * np.cos(heading) + y * np.sin(heading)


def _rows(
    plan: Plan, car: Car, times: np.ndarray, driven: np.ndarray, pose_offset: float
) -> Tuple[RowResult, ...]:
    """Return the results of the rows that are inside the recording; the last one ends at rest."""
    ends = np.cumsum([row.duration for row in plan.rows]).astype(np.int64)
    ends[-1] = max(ends[-1], round(times[-1] * NANOSECONDS))
    seconds = ends / NANOSECONDS
    count = int(np.searchsorted(seconds, times[-1] + 1e-9, side="right"))
    instants = np.concatenate([[0], ends[:count]])
    expected = _predicted(plan, car, instants, pose_offset)
    found = np.column_stack(
        [np.interp(instants / NANOSECONDS, times, column) for column in driven.T]
    )
    fine = np.unique(np.concatenate([times, instants / NANOSECONDS]))
    both = (
        np.column_stack([np.interp(fine, times, column) for column in driven.T]),
        _predicted(plan, car, (fine * NANOSECONDS).round().astype(np.int64), pose_offset),
    )
    sums = [np.concatenate([[0.0], np.cumsum(_along(poses))]) for poses in both]
    driven_far, predicted_far = (
        np.diff(np.interp(instants / NANOSECONDS, fine, each)) for each in sums
    )
    results: List[RowResult] = []
    for index, row in enumerate(plan.rows[:count]):
        results.append(
            RowResult(
                row.line,
                row.speed,
                row.steering_angle,
                float(seconds[index]),
                (float(predicted_far[index]), float(driven_far[index])),
                (
                    float(expected[index + 1, 2] - expected[index, 2]),
                    float(found[index + 1, 2] - found[index, 2]),
                ),
                tuple(expected[index + 1].tolist()),
                tuple(found[index + 1].tolist()),
                float(np.hypot(*(found - expected)[index + 1, :2])),
            )
        )
    return tuple(results)
