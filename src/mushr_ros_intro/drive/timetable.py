"""Compute the due time of each command of a plan, and wait for it."""

from typing import Iterator

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.stamps import (
    COMMAND_PERIOD,
    MAX_LEAD,
    NANOSECONDS,
    STAMP_TOLERANCE,
)

LEAD = 2 * COMMAND_PERIOD
"""Time by which a command is sent before it is due, in simulated time [ns].

With one period, each step of the clock in lock-step would wait for the next command. With more than
the timeout of the mux, commands would pass after another input has taken over the car.
"""


class Timetable:
    """The due times of one drive of a plan [ns].

    In simulated time, each command is sent two periods before it is due, and the drive begins up to
    0.9 s ahead of the clock. The simulated clock does not pass the newest stamp that is ahead of
    it, so it never passes a command that has not been sent yet. In wall-clock time, commands are
    not sent early.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        is_simulated = ros_time.is_simulated()
        self._lead = LEAD if is_simulated else 0
        self._begin_lead = MAX_LEAD if is_simulated else 0
        self.due = 0
        """When the next row begins [ns]."""
        self.end = 0
        """When the plan ends [ns]; the stamp of the stop."""

    def begin(self) -> int:
        """Return the stamp for the initial pose [ns]; it is later than the end of the last drive.

        Raises:
            rospy.ROSInterruptException: the node is shut down.
        """
        # Then the car has received the stop of the last drive.
        ros_time.sleep_until(self.end, ros_time.now())
        return max(ros_time.now() + self._begin_lead, self.end + 1)

    def start_after(self, stamp: int) -> None:
        """Make the first command due one period after `stamp` [ns], or now if that is later.

        Raises:
            rospy.ROSInterruptException: the node is shut down.
        """
        # In simulated time, the car's report arrives before the clock reaches the report's stamp.
        ros_time.sleep_until(stamp, ros_time.now())
        self.due = max(stamp + COMMAND_PERIOD, ros_time.now())
        self.end = self.due + self._plan.duration

    def instants(self, row: Row) -> Iterator[int]:
        """Yield the due time of each command of the next row [ns] when it has to be sent.

        Raises:
            UserError: see `wait_until`.
            rospy.ROSInterruptException: the node is shut down.
        """
        begin, self.due = self.due, self.due + row.duration
        for due in range(begin, self.due, COMMAND_PERIOD):
            self.wait_until(due)
            yield due

    def wait_until(self, due: int) -> None:
        """Sleep until a command that is due at `due` [ns] has to be sent.

        Raises:
            UserError: the clock differs from that instant by more than 1 s, so the rest of the
                plan would be wrong.
            rospy.ROSInterruptException: the node is shut down.
        """
        wake = due - self._lead
        while True:
            now = ros_time.now()
            early = wake - now
            if abs(early) > STAMP_TOLERANCE:
                seconds = abs(early) / NANOSECONDS
                when = f"is due in {seconds:.1f} s" if early > 0 else f"was due {seconds:.1f} s ago"
                raise UserError(
                    f"the next command {when}; expected at most 1 s. Either the clock was set, or "
                    "this machine or node was suspended. The drive ends"
                )
            if early <= 0:
                return
            ros_time.sleep_until(wake, now)  # returns early if the clock is set back
