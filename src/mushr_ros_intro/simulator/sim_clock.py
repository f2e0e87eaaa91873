"""The clocks of the simulated car: its own simulated clock, or ROS time."""

import threading
import time
from typing import Callable, List, Optional, Sequence

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger, TriggerResponse

from mushr_ros_intro.car.model import Event, State
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.ros.connections import is_alive
from mushr_ros_intro.ros.xmlrpc_client import CallError, ask
from mushr_ros_intro.simulator.clock import Stream, first_report
from mushr_ros_intro.stamps import CALL_TIMEOUT, CLOCK_PATIENCE, NANOSECONDS, CurrentTime

Evaluate = Callable[[Sequence[int]], List[State]]
Publish = Callable[[List[State]], None]

HOLD_POLL_PERIOD = 0.05
"""Period of the checks while the clock is held [s of wall-clock time]."""

MAX_CATCH_UP = 0.1
"""A clock that is later than this does not catch up [s of wall-clock time]."""


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

    def run(self, evaluate: Evaluate, publish: Publish) -> None:
        """Publish the state at the pose rate until the node is shut down; see OwnClock.run."""
        rate = rospy.Rate(NANOSECONDS / self._pose_period, reset=True)
        while not rospy.is_shutdown():
            with self._changed:
                states = evaluate([self.read()])
            publish(states)
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
        self._anchor = (time.monotonic(), self._now)
        self._stream = Stream()
        self._is_paused = False
        self._has_to_step = False
        self.description = f"simulated, {real_time_factor:g} times real time"
        if real_time_factor == 0.0:
            self.description = "simulated, in lock-step with the commands"
        # Simulated time may run fast, and no message may be lost.
        self.publisher = rospy.Publisher("/clock", Clock, queue_size=10_000, tcp_nodelay=True)
        rospy.Service("~pause", Trigger, lambda _: self.control(True))
        rospy.Service("~resume", Trigger, lambda _: self.control(False))
        rospy.Service("~step", Trigger, lambda _: self.control(True, step=True))

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
        self._changed.notify_all()

    def reset(self) -> None:
        """Forget all events; needs the lock."""
        self._stream = Stream()
        self._changed.notify_all()

    def run(self, evaluate: Evaluate, publish: Publish) -> None:
        """Advance the clock until the node is shut down.

        The states are published just before the clock advances past them.

        Args:
            evaluate: returns the states at increasing instants [ns]; called with the lock.
            publish: publishes states; called without the lock.
        """
        while not rospy.is_shutdown():
            with self._changed:
                target = self._next_target()
                if target is None:
                    continue
                due = range(self._next_pose, target + 1, self._pose_period)
                states = evaluate(due)
                self._next_pose += len(due) * self._pose_period
                self._now = target
                self._has_to_step = False
                self._changed.notify_all()
            publish(states)
            self.publisher.publish(Clock(clock=ros_time.time_from(target)))

    def _next_target(self) -> Optional[int]:
        """Return the instant to which the clock advances now [ns]; None after a wait.

        Needs the lock.
        """
        wall = time.monotonic()
        limit = self._next_pose if self._has_to_step else self._limit(wall)
        if limit is not None and limit <= self._now:
            self._changed.wait(HOLD_POLL_PERIOD)
            self._anchor = (time.monotonic(), self._now)
            return None
        if limit is not None and (self._has_to_step or self._factor == 0.0):
            self._anchor = (wall, limit)
            return limit
        target = self._next_pose if limit is None else min(limit, self._next_pose)
        due = self._anchor[0] + (target - self._anchor[1]) / NANOSECONDS / (self._factor or 1.0)
        if wall < due:
            self._changed.wait(due - wall)
            return None
        if wall > due + MAX_CATCH_UP:
            self._anchor = (wall, target)
        return target

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
            self._is_paused, self._has_to_step = is_paused, step
            self._changed.notify_all()
            while self._has_to_step and not rospy.is_shutdown():
                self._changed.wait(0.1)
            return TriggerResponse(True, f"{self._now / NANOSECONDS:.9f} s")
