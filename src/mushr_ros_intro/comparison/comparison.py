"""Compare the driven path with the predicted one.

Both begin at the same pose, at the first command that moves the car. Times count from there.
"""

from typing import NamedTuple, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog, start_pose
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.preview.prediction import rest, states_at
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

_SETTLED = 0.3
"""Time after the predicted rest at which the car counts as standing [s]."""


class RowResult(NamedTuple):
    """The motion during one row, predicted and driven."""

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
    plan: Plan
    """The rows, from the pose at which the car stood before the first command."""
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


def compare(log: DriveLog, car: Car, delay: float) -> Comparison:
    """Compare a drive with what a car would have done.

    The last pose is the mean of the poses after the car has come to rest. Rows that end after the
    last pose have no result.

    Args:
        log: the drive.
        car: of the prediction; its noise is not used.
        delay: from a command to its effect on the pose [s].
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    stamps = log.stamps - from_seconds(delay)
    start, standing = start_pose(log, from_seconds(delay))
    plan = log.plan._replace(start=start)
    end, _ = rest(plan, car)
    driven = log.poses.copy()
    driven[:, 2] = np.unwrap(driven[:, 2])
    is_after = stamps >= max(end, min(end + from_seconds(_SETTLED), stamps[-1]))
    is_used = (stamps >= 0) & (stamps < end)
    final = driven[is_after].mean(axis=0, keepdims=True) if is_after.any() else driven[:0]
    stamps = np.append(stamps[is_used], [end] * len(final))
    driven = np.vstack([driven[is_used], final])
    predicted = _predicted(plan, car, stamps)
    turns = np.round((driven[0, 2] - predicted[0, 2]) / (2.0 * np.pi))
    driven[:, 2] -= 2.0 * np.pi * turns
    rows = _rows(plan, car, stamps, driven)
    return Comparison(
        log, car, delay, plan, standing, stamps / NANOSECONDS, predicted, driven, rows
    )


def _predicted(plan: Plan, car: Car, stamps: np.ndarray) -> np.ndarray:
    """Return the predicted poses at some stamps [ns]."""
    return np.array([state.pose for state in states_at(plan, car, stamps.tolist())], float)


def _along(poses: np.ndarray) -> np.ndarray:
    """Return the distance from each pose to the next one [m], negative in reverse.

    It is measured along the heading, so the noise of the poses does not add up.
    """
    x, y, theta = np.diff(poses, axis=0).T
    heading = poses[:-1, 2] + 0.5 * theta
    return x * np.cos(heading) + y * np.sin(heading)


def _rows(plan: Plan, car: Car, stamps: np.ndarray, driven: np.ndarray) -> Tuple[RowResult, ...]:
    """Return the results of the rows that are inside the recording; the last one ends at rest."""
    ends = np.cumsum([row.duration for row in plan.rows])
    ends[-1] = max(ends[-1], stamps[-1])
    instants = np.append(0, ends[ends <= stamps[-1]])
    fine = np.union1d(stamps, instants)
    # Before the first pose of the drive, the car was at the start pose.
    columns = zip(driven.T, plan.start)
    path = np.column_stack([np.interp(fine, stamps, column, start) for column, start in columns])
    places = np.searchsorted(fine, instants)
    table = np.array(  # x, y, theta and distance, predicted and driven, at the ends of the rows
        [
            np.column_stack([poses, np.append(0.0, np.cumsum(_along(poses)))])[places]
            for poses in (_predicted(plan, car, fine), path)
        ]
    )
    changes = np.diff(table, axis=1)
    errors = np.hypot(*(table[1] - table[0]).T[:2])
    return tuple(
        RowResult(
            line=row.line,
            speed=row.speed,
            steering_angle=row.steering_angle,
            end=float(instants[number] / NANOSECONDS),
            distance=tuple(changes[:, number - 1, 3].tolist()),
            turn=tuple(changes[:, number - 1, 2].tolist()),
            predicted=tuple(table[0, number, :3].tolist()),
            driven=tuple(table[1, number, :3].tolist()),
            error=float(errors[number]),
        )
        for number, row in enumerate(plan.rows[: len(instants) - 1], 1)
    )
