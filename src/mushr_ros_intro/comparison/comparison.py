"""Compare the driven path with the predicted one.

Both begin at the same pose, at the first command that moves the car. Times count from there.
"""

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import DriveLog, start_pose
from mushr_ros_intro.preview.prediction import rest, states_at
from mushr_ros_intro.replay.recording import Drive
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

_SETTLED = 0.3
"""Time after the predicted rest at which the car counts as standing [s]."""


def compare(log: DriveLog, car: Car, delay: float) -> Drive:
    """Compare a drive with what a car would have done.

    The last pose is the mean of the poses after the car has come to rest.

    Args:
        log: the drive.
        car: of the prediction; its noise is not used.
        delay: from a command to its effect on the pose [s].
    """
    car = car._replace(speed_noise=0.0, steering_noise=0.0)
    stamps = log.stamps - from_seconds(delay)
    plan = log.plan._replace(start=start_pose(log, from_seconds(delay)))
    end, _ = rest(plan, car)
    driven = log.poses.copy()
    driven[:, 2] = np.unwrap(driven[:, 2])
    is_after = stamps >= max(end, min(end + from_seconds(_SETTLED), stamps[-1]))
    is_used = (stamps >= 0) & (stamps < end)
    final = driven[is_after].mean(axis=0, keepdims=True) if is_after.any() else driven[:0]
    stamps = np.append(stamps[is_used], [end] * len(final))
    driven = np.vstack([driven[is_used], final])
    states = states_at(plan, car, stamps.tolist())
    predicted = np.array([state.pose for state in states], float)
    turns = np.round((driven[0, 2] - predicted[0, 2]) / (2.0 * np.pi))
    driven[:, 2] -= 2.0 * np.pi * turns
    return Drive(stamps / NANOSECONDS, driven, predicted)
