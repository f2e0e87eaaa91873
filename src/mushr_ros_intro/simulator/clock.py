"""Compute the limit of the simulated clock, so that no command arrives too late.

1. The clock never passes the newest stamp that was ahead of it. Such a stamp is a promise: no later
   message of the sender has an older stamp.
2. In lock-step (real-time factor 0), after a command whose stamp is not ahead, the limit is one
   period after the stamp. The period is learned from the stamps.
3. After an initial pose, the limit is the time at which the car reports that pose, because the
   sender may wait for the report.
4. If no event arrives within the patience [s of wall-clock time], the clock runs freely until the
   next event.

Stamps are integer nanoseconds of simulated time; `wall` is monotonic wall-clock time in seconds.
"""

import math
from typing import NamedTuple, Optional

from mushr_ros_intro.car.model import Event, InitialPose
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

CLOCK_PATIENCE = 5.0
"""Longest wait of the simulated clock for the next command [s].

On a machine with ten processes per core, a node can be delayed by more than a second.
"""

CLOCK_PATIENCE_AT_REST = 1.0
"""Longest wait of the simulated clock after a stop, which is the end of most plans [s]."""

MIN_CLOCK_PATIENCE = 0.2
"""Lower limit of the patience, which is halved after each wait without an event [s]."""

STEP_TOLERANCE = 0.1
"""Relative difference up to which two steps between commands count as equal."""

MAX_PERIOD = 2 * NANOSECONDS
"""A longer step between two commands begins a new stream [ns]."""

LONG_STEP = NANOSECONDS // 2
"""A longer step between two commands resets the patience [ns]."""


class Stream(NamedTuple):
    """A summary of the events (commands and initial poses) that have reached the car."""

    limit: int = 0
    """The limit of the clock [ns]; never decreases."""
    newest: Optional[int] = None
    """Stamp of the newest command since the initial pose [ns]."""
    step: int = 0
    """Step between the stamps of the newest two commands [ns]; 0 if unknown."""
    period: int = COMMAND_PERIOD
    """Learned period of the commands [ns]."""
    drives: bool = False
    """Whether the newest command is not a stop."""
    patience: float = CLOCK_PATIENCE
    """Longest wait for the next event after a command to drive [s of wall-clock time]."""
    deadline: float = -math.inf
    """End of the wait [s of monotonic wall-clock time]."""

    @property
    def wait(self) -> float:
        """Longest wait for the next event [s of wall-clock time]; shorter after a stop."""
        is_at_rest = self.newest is not None and not self.drives
        return min(self.patience, CLOCK_PATIENCE_AT_REST) if is_at_rest else self.patience

    def holds(self, wall: float) -> bool:
        """Return whether the clock must not pass the limit at `wall` [s]."""
        return wall <= self.deadline

    @property
    def is_expired(self) -> bool:
        """Whether the clock runs freely until the next event."""
        return self.deadline == -math.inf

    def expire(self) -> "Stream":
        """Return the stream after a wait without an event: the next wait is half as long."""
        patience = max(MIN_CLOCK_PATIENCE, self.patience / 2.0)
        return self._replace(patience=patience, deadline=-math.inf)

    def renew(self, wall: float) -> "Stream":
        """Return the stream with its wait counted from `wall` [s], unless it has expired."""
        return self if self.is_expired else self._replace(deadline=wall + self.wait)

    def on_event(
        self, event: Event, clock: int, wall: float, next_report: int, lock_step: bool
    ) -> "Stream":
        """Return the stream that includes `event`.

        Args:
            event: a command or an initial pose; its stamp is the instant at which it applies.
            clock: the simulated time of its arrival [ns].
            wall: the wall-clock time of its arrival [s].
            next_report: for an initial pose, when the car first reports it [ns].
            lock_step: whether the clock also waits for events that are not ahead of it.
        """
        is_ahead = event.stamp > clock
        if isinstance(event, InitialPose):
            stream = Stream(limit=max(self.limit, next_report), deadline=wall + CLOCK_PATIENCE)
            return stream if is_ahead or lock_step else Stream(self.limit)
        if self.newest is not None and event.stamp < self.newest:
            return self.renew(wall)  # late or out of order; the newest command stays the same
        if not (is_ahead or lock_step):
            return self._replace(newest=event.stamp, deadline=-math.inf)

        step = 0 if self.newest is None else event.stamp - self.newest
        known = self if step <= MAX_PERIOD else Stream(self.limit)
        drives = event.speed != 0.0 or event.steering_angle != 0.0
        continues = known.newest is not None and step <= (1.0 + STEP_TOLERANCE) * known.period
        if not (is_ahead or drives or continues):
            return self  # a stop by the mux, which is not part of the stream

        period = known.period
        # On a busy machine, the first steps may be irregular, so only a repeated step counts.
        if (
            known.newest is not None
            and step > 0
            and abs(step - known.step) <= STEP_TOLERANCE * step
        ):
            period = step
        stream = Stream(
            limit=max(self.limit, event.stamp if is_ahead else event.stamp + period),
            newest=event.stamp,
            step=(step or known.step) if known.newest is not None else 0,
            period=period,
            drives=drives,
            patience=CLOCK_PATIENCE if is_ahead or step > LONG_STEP else known.patience,
        )
        return stream._replace(deadline=wall + stream.wait)


def first_report(stamp: int, clock: int, next_pose: int, pose_period: int) -> int:
    """Return when the car first reports an initial pose [ns].

    Args:
        stamp: of the initial pose [ns]; it may be late.
        clock: the simulated time [ns]; the pose that is due now has been reported already.
        next_pose: when the car reports its pose next [ns], later than `clock`.
        pose_period: between two reports [ns].
    """
    earliest = max(stamp, clock + 1)
    return next_pose - (next_pose - earliest) // pose_period * pose_period
