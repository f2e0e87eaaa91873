"""Instants and durations: integer nanoseconds everywhere, so that adding them up loses nothing."""

NANOSECONDS = 1_000_000_000
"""In a second."""

STAMP_TOLERANCE = 1 * NANOSECONDS
"""How far a stamp may be from this machine's clock [ns] and still be taken as it is."""


COMMAND_PERIOD = NANOSECONDS // 10
"""Between the commands of a row of a plan [ns]."""

CLOCK_LAG = 60 * NANOSECONDS
"""How far a stamp may be from what a node takes for the simulated time [ns], and still be right: in
lock-step a minute takes about a second, and a node's clock may be a moment behind the car's."""


def effective_stamp(stamp: int, now: int, tolerance: int = STAMP_TOLERANCE) -> int:
    """Return the instant [ns] that a message's stamp means.

    A stamp of zero (never filled in), or one that is more than `tolerance` [ns] away from `now`
    (another machine's clock), means now.
    """
    return stamp if stamp and abs(stamp - now) <= tolerance else now


def from_seconds(seconds: float) -> int:
    """Return a duration given in seconds in nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)
