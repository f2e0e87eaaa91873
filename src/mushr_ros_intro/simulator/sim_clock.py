"""The clocks of the simulated car: its own simulated clock, or ROS time."""

import threading
import time
from typing import Callable, Optional, Sequence, Tuple

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger, TriggerResponse

from mushr_ros_intro.car.model import Event
from mushr_ros_intro.ros import node, ros_time
from mushr_ros_intro.ros.connections import is_alive
from mushr_ros_intro.ros.xmlrpc_client import CallError, ask
from mushr_ros_intro.simulator.clock import CLOCK_PATIENCE, Stream, first_report
from mushr_ros_intro.stamps import CALL_TIMEOUT, NANOSECONDS, CurrentTime

Report = Callable[[Sequence[int]], None]
"""Publishes the car's states at increasing instants [ns]; called with the lock of the state."""

HOLD_POLL_PERIOD = 0.05
"""Period of the checks while the clock is held [s of wall-clock time]."""

MAX_CATCH_UP = 0.1
"""A clock that is later than this does not catch up [s of wall-clock time]."""


def shown(instant: int) -> str:
    """Return an instant [ns] in seconds, with all its digits."""
    return "{}.{:09d} s".format(*divmod(instant, NANOSECONDS))


def has_to_publish_clock() -> bool:
    """Return whether time is simulated and no node that runs publishes /clock.

    This function can be called before rospy.init_node.
    """
    master = rosgraph.get_master_uri()
    try:
        if not ask(master, CALL_TIMEOUT, "car_sim", "getParam", "/use_sim_time"):
            return False
        publishers, _, _ = ask(master, CALL_TIMEOUT, "car_sim", "getSystemState")
        names = {name for topic, nodes in publishers if topic == "/clock" for name in nodes}
        names.discard(node.full_name("car_sim"))  # which ends when this node is registered
        return not any(map(is_alive, names))
    except (CallError, OSError):
        return False  # the parameter is not set, or there is no master, which init_node reports


class FollowedClock:
    """ROS time: the clock of the machine, or /clock from another node.

    Args:
        pose_period: between two reports of the pose [ns].
        changed: the lock of the car's state, notified of events.
    """

    def __init__(self, pose_period: int, changed: threading.Condition) -> None:
        self._pose_period = pose_period
        self._changed = changed
        self._time = CurrentTime(ros_time.now())
        self.description = "from /clock" if ros_time.is_simulated() else "wall-clock"

    def read(self) -> int:
        """Return the time [ns]; it decreases only if the clock is set back. Needs the lock."""
        self._time.update(ros_time.now())
        return self._time.now

    def on_event(self, event: Event) -> None:
        """Do nothing, because this clock does not wait for events."""

    def reset(self) -> None:
        """Forget all events."""

    def run(self, report: Report) -> None:
        """Report the state at the pose rate until the node is shut down."""
        rate = rospy.Rate(NANOSECONDS / self._pose_period, reset=True)
        while not rospy.is_shutdown():
            with self._changed:
                report([self.read()])
            rate.sleep()


class OwnClock:
    """The simulated clock of this node; publishes /clock, and offers ~pause, ~resume and ~step.

    `simulator/clock.py` computes the limit of the clock.

    Args:
        pose_period, changed: as for FollowedClock.
        real_time_factor: speed relative to wall-clock time; 0 is lock-step with the commands.
    """

    def __init__(
        self, pose_period: int, changed: threading.Condition, real_time_factor: float
    ) -> None:
        self._pose_period = pose_period
        self._changed = changed
        self._factor = real_time_factor
        self._now = int(time.time()) * NANOSECONDS
        self._next_pose = self._now + pose_period
        # The real-time factor applies from this wall-clock time [s] and this simulated time [ns].
        self._anchor: Optional[Tuple[float, int]] = None
        self._stream = Stream()
        self._report: Optional[Report] = None
        self._is_paused = False
        self.description = f"simulated, {real_time_factor:g} times real time"
        if real_time_factor == 0.0:
            self.description = "simulated, in lock-step with the commands"
        # Simulated time may run fast, and no message may be lost.
        self.publisher = rospy.Publisher("/clock", Clock, queue_size=10_000, tcp_nodelay=True)

    def read(self) -> int:
        """Return the time [ns]; needs the lock."""
        return self._now

    def on_event(self, event: Event) -> None:
        """Add an event, which applies at its stamp; needs the lock."""
        self._stream = self._stream.on_event(
            event,
            self._now,
            time.monotonic(),
            first_report(event.stamp, self._now, self._next_pose, self._pose_period),
            lock_step=self._factor == 0.0,
        )
        if self._factor == 0.0 and self._report:
            self._advance()  # in this thread, because a switch of threads costs more
        else:
            self._changed.notify_all()

    def reset(self) -> None:
        """Forget all events; needs the lock."""
        self._stream = Stream()
        self._changed.notify_all()

    def run(self, report: Report) -> None:
        """Advance the clock until the node is shut down.

        The states are reported just before the clock advances past them.
        """
        self._report = report
        rospy.Service("~pause", Trigger, lambda _: self.control(True))
        rospy.Service("~resume", Trigger, lambda _: self.control(False))
        rospy.Service("~step", Trigger, lambda _: self.control(True, step=True))
        while not rospy.is_shutdown():
            with self._changed:
                wait = self._advance()
                if wait > 0.0:
                    self._changed.wait(wait)

    def _advance(self) -> float:
        """Advance the clock if it is due; return how long to wait [s]. Needs the lock."""
        wall = time.monotonic()
        limit = self._limit(wall)
        if limit is not None and (limit <= self._now or self._factor == 0.0):
            self._anchor = None
            if limit <= self._now:
                return HOLD_POLL_PERIOD
            self._advance_to(limit)
            return 0.0
        target = self._next_pose if limit is None else min(limit, self._next_pose)
        began, since = self._anchor = self._anchor or (wall, self._now)
        due = began + (target - since) / NANOSECONDS / (self._factor or 1.0)
        if wall < due:
            return due - wall
        if wall > due + MAX_CATCH_UP:
            self._anchor = (wall, target)
        self._advance_to(target)
        return 0.0

    def _advance_to(self, target: int) -> None:
        """Report the states until `target` [ns], and set the clock; needs the lock."""
        instants = range(self._next_pose, target + 1, self._pose_period)
        self._next_pose += len(instants) * self._pose_period
        self._now = target
        assert self._report
        self._report(instants)
        self.publisher.publish(Clock(clock=ros_time.time_from(target)))

    def _limit(self, wall: float) -> Optional[int]:
        """Return the limit of the clock [ns], None if it runs freely; needs the lock."""
        if self._is_paused:
            return self._now
        stream = self._stream
        if stream.holds(wall):
            return stream.limit
        if not stream.is_expired:
            self._stream = stream.expire()
            if self._factor == 0.0 and stream.drives and stream.patience == CLOCK_PATIENCE:
                rospy.logwarn(
                    f"no command arrived within {stream.patience:g} s of wall-clock time after a "
                    "command to drive; the clock continues"
                )
        return None

    def control(self, is_paused: bool, step: bool = False) -> TriggerResponse:
        """Hold the clock or release it; return the time."""
        with self._changed:
            if not (self._is_paused and is_paused):
                self._stream = self._stream.renew(time.monotonic())  # the wait begins again
            self._is_paused = is_paused
            if step:
                self._advance_to(self._next_pose)
            self._changed.notify_all()
            return TriggerResponse(True, f"{shown(self._now)}")
