"""Decide how far a simulated clock may run: in lock-step, no further than the commands reach.

A stream of commands is a promise. A command that is stamped ahead of the clock promises that
nothing older will come, so the clock may run up to its stamp. One that is stamped with the present
promises nothing, but streams are regular: the clock may run one period further, as learned from the
stamps, where two in a row are as far apart as the two before. After a placement it runs on until
the car has reported where it is now, and no further: whoever placed it may well be waiting for that
before sending a command. Where nothing comes for a while of wall-clock time, the stream is over.

Stamps are integer nanoseconds of simulated time; `wall` is in seconds of the computer's own time.
"""

from enum import IntEnum
from typing import NamedTuple, Optional

from mushr_ros_intro.car.model import Event, InitialPose
from mushr_ros_intro.sim.stamps import NANOSECONDS

DEFAULT_PERIOD = NANOSECONDS // 10
"""Between the commands of a stream of which only one is known [ns]."""

STEP_TOLERANCE = 0.1
"""How much two steps between commands may differ to count as the same, relative."""

LONGEST_PERIOD = 2 * NANOSECONDS
"""Commands further apart than this [ns] are two streams."""

PATIENCE = 5.0
"""How long the clock waits for the next command of a stream that drives the car [s].

On a machine with ten processes to a core, a publisher may well be kept from it for a second.
"""

PATIENCE_AT_REST = 1.0
"""How long it waits after a command to stand [s], with which most streams end.

But a plan may have a row to stand, and a publisher may be kept from its commands there, too.
"""


class Kind(IntEnum):
    """What an event is; of several with one stamp the greatest says what is to come.

    A plan that begins again ends in a stop and a placement of the same stamp, and either may be
    the first to arrive.
    """

    STOP = 0
    PLACEMENT = 1
    DRIVE = 2

    @classmethod
    def of(cls, event: Event) -> "Kind":
        """Return what an event is."""
        if isinstance(event, InitialPose):
            return cls.PLACEMENT
        return cls.DRIVE if event.speed or event.steering_angle else cls.STOP


class Stream(NamedTuple):
    """What is known of the events (commands and placements) that reach the car."""

    newest: int
    """The youngest stamp [ns]."""
    period: int
    """Between the stamps of commands, as far as is known [ns]."""
    step: int
    """Between the newest two stamps that differ [ns]."""
    kind: Kind
    """What the newest is."""
    ahead: bool
    """Whether the newest was stamped ahead of the clock when it came."""
    patience: float
    """How long to wait for the next one [s]."""
    heard: float
    """When the last one came [s]."""

    def over(self, wall: float) -> bool:
        """Say whether at `wall` [s] the stream counts as ended."""
        return wall > self.heard + self.patience

    def resume(self, wall: float) -> "Stream":
        """Return the stream whose next event is waited for from `wall` [s] on."""
        return self._replace(heard=wall)


def hear(stream: Optional[Stream], event: Event, clock: int, wall: float) -> Stream:
    """Return the stream that an event adds to or begins.

    Args:
        stream: what was known before, None at the beginning.
        event: a command, or a placement, after which commands are to be expected.
        clock: the simulated time when it came [ns].
        wall: the computer's own time when it came [s].
    """
    if stream is not None and stream.over(wall):
        stream = None
    kind = Kind.of(event)
    if stream is not None and (event.stamp, kind) < (stream.newest, stream.kind):
        return stream.resume(wall)  # late or out of order; the newest still counts
    if kind == Kind.STOP and stream is not None and stream.kind == Kind.PLACEMENT:
        return stream  # the mux's, for whoever drove before; a command may be on its heels
    if kind == Kind.PLACEMENT:
        newest = max(event.stamp, clock)  # it may be late, and the report is still to come
        ahead = event.stamp > clock
        return Stream(newest, DEFAULT_PERIOD, DEFAULT_PERIOD, kind, ahead, PATIENCE, wall)
    period = step = DEFAULT_PERIOD
    if stream is not None and event.stamp - stream.newest <= LONGEST_PERIOD:
        step = event.stamp - stream.newest or stream.step
        period = stream.period
        # A busy machine delivers the first messages at odd times; what repeats itself is a period,
        # but for the mux's stop, and the first of another stream.
        repeats = event.stamp != stream.newest and abs(step - stream.step) <= STEP_TOLERANCE * step
        if repeats and stream.kind != Kind.STOP:
            period = step
    patience = PATIENCE_AT_REST if kind == Kind.STOP else PATIENCE
    return Stream(event.stamp, period, step, kind, event.stamp > clock, patience, wall)


def carry_over(stream: Optional[Stream], wall: float, was_held: bool) -> Optional[Stream]:
    """Return the stream as it goes on when the clock is held or let go at `wall` [s].

    While the clock `was_held`, nobody was late; what was over before that stays so.
    """
    if stream is None or (not was_held and stream.over(wall)):
        return None
    return stream.resume(wall)


def horizon(
    stream: Optional[Stream], wall: float, lock_step: bool, next_pose: int, pose_period: int
) -> Optional[int]:
    """Return the instant [ns] up to which the clock may run at `wall` [s]; None: freely.

    In lock-step it waits for every stream, otherwise only for one that promises. The car reports
    its pose at `next_pose` [ns], which is ahead of the clock, and every `pose_period` [ns] from
    then on.
    """
    if stream is None or stream.over(wall):
        return None
    if stream.kind == Kind.PLACEMENT:
        if not lock_step:
            return None
        # The first report that has it in it; the one of the present is out already.
        least = stream.newest if stream.ahead else stream.newest + 1
        return next_pose - (next_pose - least) // pose_period * pose_period
    if stream.ahead:
        return stream.newest
    return stream.newest + stream.period if lock_step else None
