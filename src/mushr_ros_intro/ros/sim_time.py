"""Sleep until an instant of ROS's time, which may be simulated."""

import time

import rospy

from mushr_ros_intro.sim.stamps import NANOSECONDS

_LOOK_EVERY = 0.5  # [s of wall-clock time] whether the node is shut down


def sleep_until(due: int, now: int) -> None:
    """Sleep until an instant, or until simulated time is before what was the present.

    rospy.sleep takes a duration, and counts it from the present that it looks up by itself. Where
    the clock has moved since the caller looked, it sleeps too long; and where the clock then waits
    for this very node, as in lock-step, for ever.

    Args:
        due: the instant [ns].
        now: the present that the caller has seen [ns].

    Raises:
        rospy.ROSInterruptException: the node is shut down.
    """
    if rospy.rostime.is_wallclock():
        time.sleep(max(0, due - now) / NANOSECONDS)
    else:
        moved = rospy.rostime.get_rostime_cond()
        with moved:  # the clock is set before its condition is notified
            while now <= rospy.get_rostime().to_nsec() < due and not rospy.is_shutdown():
                moved.wait(_LOOK_EVERY)
    if rospy.is_shutdown():
        raise rospy.ROSInterruptException("shut down while sleeping")
