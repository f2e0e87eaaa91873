"""What stamps mean, and every constant of time that several modules share.

Instants and durations are integer nanoseconds [ns], so that adding them up loses nothing. Timeouts
are seconds of wall-clock time [s].
"""

NANOSECONDS = 1_000_000_000
"""In a second."""

COMMAND_PERIOD = NANOSECONDS // 10
"""Between the commands of a plan's row [ns]."""

STAMP_TOLERANCE = 1 * NANOSECONDS
"""How far a stamp may differ from this machine's clock [ns].

Also the length of the car's history.
"""

SIMULATED_STAMP_TOLERANCE = 60 * NANOSECONDS
"""The same in simulated time for a node that does not keep the clock [ns].

Simulated time is one clock for all nodes, but in lock-step a minute of it takes about a second, and
the node's clock may be that much behind the stamp of a message.
"""

MAX_LEAD = STAMP_TOLERANCE - COMMAND_PERIOD
"""How far ahead of the simulated clock a plan begins [ns]: the most at which stamps are still
obeyed.

If the car stands at the start pose already, only the stamp of its report shows that it has received
the initial pose. So the initial pose needs a stamp that the car has not reported before.
"""

SETTLING = 2 * COMMAND_PERIOD
"""How long after the predicted rest the final pose is compared [ns]."""

CALL_TIMEOUT = 5.0
"""For a call to the master or to another node [s]."""

CONNECTION_TIMEOUT = 5.0
"""For the connections of a node's topics when it starts [s]."""

REANNOUNCE_PERIOD = 1.0
"""Between two announcements of a publisher to subscribers that are not connected [s]."""

CLOCK_PATIENCE = 5.0
"""How long the simulated clock waits for the next command [s].

On a machine with ten processes per core, a node can be delayed by more than a second.
"""

CLOCK_PATIENCE_AT_REST = 1.0
"""How long the simulated clock waits after a stop, which ends most plans [s]."""

MIN_CLOCK_PATIENCE = 0.2
"""The lower limit of the patience, which is halved after each wait in vain [s]."""


def effective_stamp(stamp: int, now: int, tolerance: int = STAMP_TOLERANCE) -> int:
    """Return the instant that a message's stamp stands for [ns].

    A stamp of zero was never filled in. A stamp that differs from `now` by more than `tolerance`
    [ns] comes from another clock. Both mean `now`.
    """
    return stamp if stamp and abs(stamp - now) <= tolerance else now


def from_seconds(seconds: float) -> int:
    """Return a duration given in seconds in nanoseconds, rounded to the nearest."""
    return round(seconds * NANOSECONDS)


class PresentTime:
    """The present as a node sees it: it never runs back, unless the clock was set back."""

    def __init__(self, now: int = 0) -> None:
        self.now = now
        """The present [ns]."""

    def update(self, now: int) -> bool:
        """Set the present to `now` [ns]. Return whether the clock was set back.

        The clock was set back if it differs by more than STAMP_TOLERANCE. Smaller differences come
        from threads that overtake each other; the later time is kept.
        """
        was_set_back = now < self.now - STAMP_TOLERANCE
        self.now = now if was_set_back else max(self.now, now)
        return was_set_back
