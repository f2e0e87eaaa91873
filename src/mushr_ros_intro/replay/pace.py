"""Decide when the clock of a replay advances: when the node under test waits.

A node that waits for the clock runs after each step of the clock, so the next step follows at once.
A node that runs without a pause gets time to notice the clock. Only the times of the node itself
count: while it waits, and while it runs, but not while it, or the replay, waits for a processor.
"""

import time
from typing import NamedTuple, Optional, Tuple

from mushr_ros_intro.isolation.threads import Threads, Usages
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

STEP = NANOSECONDS // 100
"""The clock advances to multiples of this time, or to when a thread of the node is due [ns]."""

MAX_SHORT_SLEEPS = 3
"""A node that sleeps more often in a row for less than STEP polls something, such as every 1 ms.

The clock then advances by STEP, because each advance costs about 1 ms of processor time.
"""

SETTLING = 0.005
"""How long a node must have waited at each step before its first command: it is starting [s]."""

HOLD = 0.25
"""How long the clock stands after the first command, to see whether the node waits for it [s]."""

STEP_WAIT = 0.015
"""How long the clock stands if the node waits, but has not run after the last message [s]."""

BETWEEN_POLLS = 0.002
"""If a node runs between two observations, it waits at most for so long meanwhile [s]."""

MAX_WAIT = 0.01
"""The same if it does not run: after a longer time, the replay has waited for a processor [s]."""

MAX_COMPUTATION = 2.0
"""A node that runs for a longer time without waiting polls something [s of processor time]."""

POLL = 0.01
"""From then on, the clock advances when the node has run for this time [s of processor time].

Longer than Python takes to switch between threads.
"""

PAUSE = NANOSECONDS
"""If no command comes for this time after it was due, longer steps save time [ns]."""

WALL_CLOCK = (
    "the node sends commands while the simulated clock stands, so it waits in wall-clock time, and "
    "each drive would be different; wait with rospy.Rate, rospy.sleep, rospy.Timer, time.sleep, or "
    "for a message, in the process that calls rospy.init_node"
)
"""The failure of a node for which `uses_wall_clock` is true."""


class _Moment(NamedTuple):
    """What the node had done at a time."""

    waited: float
    """For how long it had waited [s]."""
    ran: float
    """For how long it had run [s of processor time]."""
    usages: Usages


class Pace:
    """Decides when the clock advances."""

    def __init__(self, node: Threads) -> None:
        self._node = node
        self._wall = time.monotonic()
        self._waited = 0.0
        self._is_waiting = False
        self._are_all_waiting = False  # the others, too
        self._before = self._now  # when the last message was written
        self._written = 0  # number of threads of the node that received the last message
        self._quiet_since = 0.0  # for how long the node had waited when it last ran
        self._still: Optional[float] = None  # the same when it first waited after the command
        self._has_sent = False
        self._is_tested = False  # the clock has stood for long enough after a command
        self._thinking = MAX_COMPUTATION
        self._short_sleeps = 0  # in a row
        self.uses_wall_clock = False
        """Whether the node has sent a command after a wait, although the clock stood."""

    @property
    def _now(self) -> _Moment:
        return _Moment(self._waited, self._node.ran, self._node.usages)

    @property
    def has_children(self) -> bool:
        """Whether the node has child processes."""
        return self._node.has_children

    @property
    def seconds(self) -> float:
        """For how long the node has waited or run since it was started [s]."""
        return self._waited + self._node.ran

    def observe(self, others: Threads) -> Tuple[bool, bool]:
        """Observe the node, and the other threads, which receive its messages.

        Return whether all threads of the node wait, and whether all others do; if both, at the
        same time.
        """
        usages, wall, were_waiting = self._node.usages, time.monotonic(), self._are_all_waiting
        # A thread is found waiting a moment before Linux counts its run. If it has sent a message
        # in this run, its receiver is observed after it. If another one has woken a thread of the
        # node, this thread runs, or waits for a processor, when the node is observed again.
        self._node.observe()
        before, node_waits = self._node.usages, self._node.is_each_waiting()
        others_wait = others.are_waiting()
        node_waits = node_waits and self._node.is_each_waiting()
        self._node.observe()
        self._is_waiting = node_waits and self._node.usages is before
        self._are_all_waiting = self._is_waiting and others_wait
        if self._are_all_waiting and were_waiting:
            # If it has run meanwhile, it has probably waited for a processor most of the time.
            most = BETWEEN_POLLS if self._node.usages is not usages else MAX_WAIT
            self._waited += min(wall - self._wall, most)
        self._wall = wall
        return self._is_waiting, others_wait

    def unsettle(self) -> None:
        """Note that the node, or a thread that serves it, runs."""
        self._quiet_since = self._waited

    def wrote(self, written: int) -> None:
        """Note that `written` threads of the node receive a message."""
        self._before, self._written = self._now, written

    def heard(self) -> None:
        """Note that a command has arrived."""
        if self._has_sent and not self._is_tested:
            self.uses_wall_clock |= self._still is not None
        self._has_sent, self._still = True, None

    def advance(
        self, now: int, left: Optional[int], due: Optional[int], in_real_time: bool = False
    ) -> Optional[int]:
        """Return the time to which the clock advances [ns]; `now` to repeat it, None if it stands.

        It is the time at which the node is due, or a multiple of STEP. It does not pass a whole
        second: times that a node rounds are then the same in all runs.

        Args:
            now: the time [ns].
            left: the time until the next command is due [ns]; None if none is expected.
            due: the time until the next thread of the node is due [ns]; None if that is unknown.
            in_real_time: whether the clock may not advance faster than the node waits.
        """
        step = self._step(left, due)
        if step is None:
            return None
        short_sleeps = self._short_sleeps + 1 if 0 < step < STEP else 0
        if short_sleeps > MAX_SHORT_SLEEPS:
            step = STEP
        end = now + step if step == due else (now + step) // STEP * STEP
        end = max(now, min(end, now - now % NANOSECONDS + NANOSECONDS))
        waited = self._waited - self._before.waited
        if in_real_time and waited * NANOSECONDS < end - now:
            return None
        self._short_sleeps = short_sleeps
        return end

    def _step(self, left: Optional[int], due: Optional[int]) -> Optional[int]:
        """Return by how much the clock advances [ns]; arguments as for `advance`."""
        now = self._now
        has_received = not self._written or now.usages is not self._before.usages
        if not (self._is_waiting and has_received):
            return self._poll(now)
        self._thinking = MAX_COMPUTATION
        if not self._has_sent and now.waited - self._quiet_since <= SETTLING:
            return None
        if self._has_sent and not self._is_tested:
            self._still = now.waited if self._still is None else self._still
            self._is_tested = now.waited - self._still > HOLD
            return None
        if due is None:
            return COMMAND_PERIOD if left is None or left < -PAUSE else STEP
        return min(due, COMMAND_PERIOD)

    def _poll(self, now: _Moment) -> Optional[int]:
        """Return a step if a node that does not wait has had the time to notice the clock."""
        if self._is_waiting:  # but it has not received the message, perhaps because it never will
            return STEP if now.waited - self._before.waited > STEP_WAIT else None
        if now.ran - self._before.ran < self._thinking:
            return None
        self._thinking = POLL
        return STEP
