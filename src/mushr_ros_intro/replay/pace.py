"""Decide when the clock of a replay advances: when the node under test waits.

A node that waits for the clock runs after each step of the clock, so the next step follows at once.
Other nodes sleep or poll in wall-clock time, or poll without a pause. They get time to notice the
clock, and to send the next command. All times are those of the node itself: they count while it
waits, and while it runs, but not while it waits for a processor.
"""

import time
from typing import NamedTuple, Optional

from mushr_ros_intro.isolation.threads import Threads, Usages
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS

STEP = NANOSECONDS // 100
"""The clock advances in steps of this time, or at once if nothing waits for it [ns]."""

STEP_WAIT = 0.015
"""How long a step waits for a node that does not run after it [s]."""

HOLD = 0.15
"""How long the clock waits for a due command of a node that waits for the clock [s].

Longer than a period of the commands: another thread of the node may sleep in wall-clock time.
"""

LONG_HOLD = 0.6
"""How long the clock waits for a due command of another node [s]."""

MIN_SLEEP = 0.05
"""A node that sleeps for so long although the clock stands sleeps in wall-clock time [s]."""

BETWEEN_POLLS = 0.002
"""If a node runs between two observations, it waits at most for so long meanwhile [s]."""

MAX_THINKING = 0.1
"""A node that runs for a longer time without waiting polls the clock [s of processor time]."""

POLL = 0.01
"""From then on, the clock advances when the node has run for this time [s of processor time].

Longer than Python takes to switch between threads.
"""


class _Moment(NamedTuple):
    """What the node had done at a time."""

    waited: float
    """For how long it had waited [s]."""
    ran: float
    """For how long it had run [s of processor time]."""
    asleep: float
    """For how long it had neither run, nor waited for a processor, since some instant [s]."""
    usages: Usages


class Pace:
    """Decides when the clock advances."""

    def __init__(self, node: Threads) -> None:
        self._node = node
        self._wall = time.monotonic()
        self._waited = 0.0
        self._is_waiting = False
        self._step = self._now  # the last one
        self._written = 0  # number of threads of the node that received a message in the step
        self._still: Optional[_Moment] = None  # when the node first waited after the step
        self._due: Optional[_Moment] = None  # when the clock began to wait for a command
        self._hold_share = 1.0
        self._is_late = False  # the command did not come
        self._reacts = False  # a thread that waits for the clock has run since the last command
        self._stride = STEP  # the first step after a command, to save time; see `heard`
        self._has_sent = self._is_first_step = False
        self._is_tested = False  # the clock has stood for long enough after a command
        self._answers = False  # the last command was an answer to a step
        self.uses_wall_clock = False
        """Whether the node sleeps or polls in wall-clock time: an earlier command was no answer."""
        self._thinking = MAX_THINKING

    @property
    def _now(self) -> _Moment:
        node = self._node
        asleep = self._wall - node.ran - node.delayed
        return _Moment(self._waited, node.ran, asleep, node.usages)

    @property
    def seconds(self) -> float:
        """For how long the node has waited or run since it was started [s]."""
        return self._waited + self._node.ran

    def observe(self) -> bool:
        """Observe the node; return whether all its threads wait."""
        usages, wall, was_waiting = self._node.usages, time.monotonic(), self._is_waiting
        self._is_waiting = self._node.are_waiting()
        if self._is_waiting and was_waiting:
            seconds = wall - self._wall
            # If it has run meanwhile, it has probably waited for a processor most of the time.
            has_run = self._node.usages is not usages
            self._waited += min(seconds, BETWEEN_POLLS) if has_run else seconds
        self._wall = wall
        return self._is_waiting

    def stepped(self, written: int) -> None:
        """Note a step, in which `written` threads of the node receive a message."""
        self._step, self._written, self._still = self._now, written, None
        self._is_first_step = False

    def heard(self, left: Optional[int]) -> None:
        """Note that a command has arrived, `left` [ns] before it was due; None if that is unknown.

        If each command is the answer to the step to its due time, the steps before it are without
        effect. The first step after a command then becomes longer each time, until it ends at the
        due time. If the node has slept until an instant between, its next command comes one step
        late, and from then on all steps have the same length again.
        """
        now = self._now
        # Otherwise, the node has waited since the step, or without a step.
        is_answer = self._still is None and (
            self._is_tested or now.asleep - self._step.asleep < MIN_SLEEP
        )
        is_in_time = self._due is not None and not self._is_late
        if self._has_sent:
            # On a busy machine, a command that is no answer may look like one, but not vice versa.
            if not is_answer and (is_in_time or not self._is_tested):
                self.uses_wall_clock = self._is_tested = True
            self._answers = is_answer and not self.uses_wall_clock
            is_regular = self._stride and is_answer and left == 0
            self._stride = min(self._stride + STEP, COMMAND_PERIOD) if is_regular else 0
        self._has_sent = True
        if is_in_time:
            self._hold_share = 1.0
        self._due = self._still = None
        self._step, self._written = now, 0
        self._is_late = self._reacts = False
        self._is_first_step = True

    @property
    def has_received(self) -> bool:
        """Whether the node waits, and has received the messages of the last step."""
        usages = self._node.usages
        return self._is_waiting and (not self._written or usages is not self._step.usages)

    @property
    def knows_time(self) -> bool:
        """Whether the node has received the time of the last step, also if it polls."""
        return self.has_received or self._node.ran - self._step.ran > POLL

    def advance(self, left: Optional[int]) -> int:
        """Return by how much the clock advances now [ns]; 0 if it stands.

        Args:
            left: the time until the next command is due [ns]; None if none is expected.
        """
        if left is not None and left <= 0 and not self._is_late:
            return self._hold()
        now = self._now
        if self.uses_wall_clock and left is not None and left > 0:
            return left
        if not self.has_received:
            return self._poll(now)
        self._thinking = MAX_THINKING
        if left is not None and not self._is_tested:
            self._still = self._still or now
            self._is_tested = now.waited - self._still.waited > HOLD
            return 0
        if self._is_first_step:
            return self._stride or STEP
        ran = sum(self._step.usages.get(name) != each for name, each in now.usages.items())
        others = ran - self._written  # the number of threads that ran, but received nothing
        self._reacts = self._reacts or others > 0
        if others > 1 and self._has_sent:
            self._stride = 0  # another thread may sleep until an instant between
        if others > 0 or self._answers:
            return STEP
        if self._still is None:
            self._still = now
        if now.usages is not self._still.usages:
            return STEP  # it polls
        if now.waited - self._still.waited > STEP_WAIT:
            return COMMAND_PERIOD if left is None else max(left, STEP)
        return 0

    def _hold(self) -> int:
        """Wait for a command that is due; afterwards, return a step."""
        now = self._now
        self._due = self._due or now
        if self.has_received:
            self._still = self._still or now
        limit = HOLD if self._reacts and not self.uses_wall_clock else LONG_HOLD
        if (
            now.waited - self._due.waited <= limit * self._hold_share
            and now.ran - self._due.ran <= MAX_THINKING
        ):
            return 0
        self._is_late = True
        self._answers = self.uses_wall_clock = False
        self._hold_share /= 2.0
        return STEP

    def _poll(self, now: _Moment) -> int:
        """Return a step if a node that does not wait has had the time to notice the clock."""
        if self._is_waiting:  # but it has not received the time, perhaps because it never will
            return STEP if now.waited - self._step.waited > STEP_WAIT else 0
        if now.ran - self._step.ran < self._thinking:
            return 0
        self._thinking = POLL
        return STEP
