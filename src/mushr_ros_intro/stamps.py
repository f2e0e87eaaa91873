"""The meaning of stamps, and all time constants that several modules share.

Instants and durations are integer nanoseconds [ns], so that sums are exact. Timeouts are seconds of
wall-clock time [s].
"""

NANOSECONDS = 1_000_000_000
"""Nanoseconds per second."""

COMMAND_PERIOD = NANOSECONDS // 10
"""Period of the commands of a plan [ns]."""

STAMP_TOLERANCE = 1 * NANOSECONDS
"""Largest difference between a valid stamp and this machine's clock [ns]."""

SIMULATED_STAMP_TOLERANCE = 60 * NANOSECONDS
"""The same, in simulated time, for a node that does not publish the clock [ns].

In lock-step, a minute of simulated time takes about a second of wall-clock time, and the clock of a
busy node may be this late.
"""

MAX_LEAD = STAMP_TOLERANCE - COMMAND_PERIOD
"""Time by which the stamp of the initial pose is ahead of the simulated clock [ns].

If the car is already at the start pose, only the stamp of its report shows that it has received the
initial pose. So the initial pose needs a later stamp than all earlier reports. The first command is
due one period after it, and its stamp must not be ahead by more than STAMP_TOLERANCE.
"""

SETTLING = 2 * COMMAND_PERIOD
"""Time between the predicted rest and the comparison of the final pose [ns]."""

CALL_TIMEOUT = 5.0
"""Timeout of a call to the master or to another node [s]."""

CONNECTION_TIMEOUT = 5.0
"""Timeout for the connections of a node's topics when it starts [s]."""


def effective_stamp(stamp: int, now: int, tolerance: int = STAMP_TOLERANCE) -> int:
    """Return the instant at which a message applies [ns].

    This is its stamp, or `now` if the stamp is zero (never filled in) or differs from `now` by more
    than `tolerance` [ns] (from another clock).
    """
    return stamp if stamp and abs(stamp - now) <= tolerance else now


def from_seconds(seconds: float) -> int:
    """Return a duration [ns], rounded to the nearest nanosecond."""
    return round(seconds * NANOSECONDS)


class CurrentTime:
    """The current time of a node; it decreases only if the clock was set back."""

    def __init__(self, now: int = 0) -> None:
        self.now = now
        """The current time [ns]."""

    def update(self, now: int) -> bool:
        """Set the current time to `now` [ns]. Return whether the clock was set back.

        The clock was set back if it decreases by more than STAMP_TOLERANCE. Smaller decreases come
        from threads that run in another order; then the later time is kept.
        """
        was_set_back = now < self.now - STAMP_TOLERANCE
        self.now = now if was_set_back else max(self.now, now)
        return was_set_back
