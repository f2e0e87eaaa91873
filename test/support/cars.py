"""Histories of simulated cars, from short descriptions of their events."""

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Command, InitialPose

MS = 1_000_000
SECOND = 1000 * MS
"""[ns]"""

BEGIN = 1_700_000_000 * SECOND
"""The instant from which offsets count [ns]."""

ROUNDING = 1e-12
"""[m, rad, m/s] For some operations on doubles of the size of 10."""


def history_of(car, start, *events, world=None):
    """Return a history of events, each of which arrives at its stamp.

    An event is an offset [ms] with a pose, or with a speed [m/s], a steering angle [rad] and
    optional rates.
    """
    history = History(car, start, world)
    for offset, *values in events:
        stamp = BEGIN + offset * MS
        kind = InitialPose if isinstance(values[0], Pose) else Command
        history.add(kind(stamp, *values), stamp)
    return history


def at(history, offset):
    """Return the state at an offset [ms]."""
    return history.state_at(BEGIN + round(offset * MS))
