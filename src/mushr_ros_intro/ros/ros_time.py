"""Read ROS time, which may be simulated, and wait for it."""

import time
from typing import Callable, Optional, TypeVar

import genpy
import rospy

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.stamps import (
    NANOSECONDS,
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    effective_stamp,
)

T = TypeVar("T")

POLL_PERIOD = 0.01
"""Period at which a condition is checked [s of wall-clock time]."""

SHUTDOWN_POLL_PERIOD = 0.5
"""Period at which a longer wait checks whether the node is shut down [s of wall-clock time]."""


def now() -> int:
    """Return the current ROS time [ns]."""
    return rospy.get_rostime().to_nsec()


def time_from(stamp: int) -> genpy.Time:
    """Return the ROS time of a stamp [ns]."""
    return genpy.Time(*divmod(stamp, NANOSECONDS))


def is_simulated() -> bool:
    """Return whether this node uses the time on /clock."""
    return not rospy.rostime.is_wallclock()


def stamp_tolerance() -> int:
    """Return how far the stamp of a received message may differ from this node's clock [ns]."""
    return SIMULATED_STAMP_TOLERANCE if is_simulated() else STAMP_TOLERANCE


def received_stamp(stamp: int, arrival: Optional[int] = None) -> int:
    """Return the instant that the stamp of a message stands for, which arrived now or before.

    All instants are in [ns].
    """
    return effective_stamp(stamp, now() if arrival is None else arrival, stamp_tolerance())


def sleep_until(due: int, since: int) -> None:
    """Sleep until `due` [ns], or until simulated time is set back to before `since`.

    rospy.sleep reads the clock itself and adds the duration. If the clock has advanced since the
    caller read it, rospy.sleep sleeps too long. In lock-step, the clock waits for this node, so
    rospy.sleep would never return.

    Args:
        due: the instant [ns].
        since: the time that the caller has read [ns].

    Raises:
        rospy.ROSInterruptException: the node is shut down.
    """
    if is_simulated():
        moved = rospy.rostime.get_rostime_cond()
        with moved:  # rospy sets the clock before it notifies the condition
            while since <= now() < due and not rospy.is_shutdown():
                moved.wait(SHUTDOWN_POLL_PERIOD)
    else:
        end = time.monotonic() + (due - since) / NANOSECONDS
        while (left := end - time.monotonic()) > 0.0 and not rospy.is_shutdown():
            time.sleep(min(left, SHUTDOWN_POLL_PERIOD))
    if rospy.is_shutdown():
        raise rospy.ROSInterruptException("the node is shut down")


def wait_for(condition: Callable[[], T], seconds: float) -> T:
    """Call `condition` repeatedly, and return its first true value.

    After `seconds` of wall-clock time, return the last value of `condition`.

    Raises:
        rospy.ROSInterruptException: the node is shut down.
    """
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value or time.monotonic() > deadline:
            return value
        if rospy.is_shutdown():
            raise rospy.ROSInterruptException("the node is shut down")
        time.sleep(POLL_PERIOD)


def wait_for_clock(seconds: float) -> None:
    """Wait for the first message on /clock if time is simulated.

    Args:
        seconds: timeout [s of wall-clock time].

    Raises:
        UserError: /clock is not published, or use_sim_time was set after this node had started.
        rospy.ROSInterruptException: the node is shut down.
    """
    if not is_simulated() and rospy.get_param("/use_sim_time", False):
        raise UserError("use_sim_time was set after this node had started; start the node again")
    if not wait_for(now, seconds):
        raise UserError(
            f"use_sim_time is set, but no time came on /clock within {seconds:g} s. If a node "
            "holds the clock, release it: rosservice call /car/car_sim/resume"
        )
