"""The world of a replay in which a controller follows a path.

The clock advances by one step, as soon as the node waits. At each instant, the car first reports
its state, one topic after another, and then the node receives the time. Each message is sent when
the node has processed the one before. A command applies at the instant at which it arrives.
"""

import struct
import threading
import time
from typing import Any, Dict, Iterator, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetMap
from rosgraph_msgs.msg import Clock

from mushr_ros_intro.car.model import at_rest
from mushr_ros_intro.isolation.node_process import NodeProcess
from mushr_ros_intro.isolation.threads import Threads
from mushr_ros_intro.replay.following import EXTRA_TIME
from mushr_ros_intro.replay.pace import STEP, Pace
from mushr_ros_intro.replay.reference import Reference
from mushr_ros_intro.replay.world import (
    CAR,
    CHECK_PERIOD,
    CONTROL,
    LONG_NAP,
    MAX_SILENCE,
    SHORT_NAP,
    START,
    ReplayWorld,
)
from mushr_ros_intro.ros import conversions, rospy_fixes
from mushr_ros_intro.simulator.mux import Input
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

PATH = "/car/reference_path"
"""The topic of the path (nav_msgs/Path, latched)."""

SERVICE = "/follow_path"
"""The world calls a service of the node whose name ends like this, and gives it the path."""

SETTLING = 0.005
"""How long a node must have waited at each step before it receives the path: it is starting [s]."""

MAX_TIME = 3.0
"""A drive may take so many times the duration of the path, and EXTRA_TIME."""

MAX_COMPUTATION = 2.0
"""A node that runs for a longer time without waiting polls the clock [s of processor time]."""

MAX_TURNS = 50
"""So many threads of a node can be due at the same time."""

REST = 2 * NANOSECONDS
"""The drive has ended if the car stands for this time [ns]."""

HOLD = 0.25
"""How long the clock stands after the first command, to see whether the node waits for it [s]."""


class FollowPace(Pace):
    """Advances the clock whenever the node waits."""

    has_path = False
    """Whether the node has received the path."""
    quiet_since = 0.0
    """For how long the node had waited when it, or this process, last ran [s]."""

    def __init__(self, node: Threads) -> None:
        super().__init__(node)
        self._thinking = MAX_COMPUTATION

    def unsettle(self) -> None:
        """Note that the node, or a thread that serves it, runs."""
        self.quiet_since = self._waited

    def advance(self, left: Optional[int]) -> int:
        """Return by how much the clock advances now [ns]; 0 if it stands."""
        now = self._now
        if not self.has_received:
            return self._poll(now)
        self._thinking = MAX_COMPUTATION
        if not (self.has_path or self._has_sent):
            return STEP if now.waited - self.quiet_since > SETTLING else 0
        if self._has_sent and not self._is_tested:
            self._still = self._still or now
            self._is_tested = now.waited - self._still.waited > HOLD
            return 0
        return STEP

    @property
    def has_reacted(self) -> bool:
        """Whether more threads have run since the last message than those that received it."""
        usages = self._node.usages
        ran = sum(self._step.usages.get(name) != each for name, each in usages.items())
        return ran > self._written


class FollowPath:
    """The service type FollowPath of a course: a path and a speed [m/s].

    Each course has its own package for this type, so the MD5 sum is not compared.
    """

    _type, _md5sum = "control/FollowPath", "*"

    class _request_class(Path):  # noqa: N801 - rospy's name
        """A path and a speed."""

        speed = 0.0

        def serialize(self, buff: Any) -> None:
            """Write the message."""
            super().serialize(buff)
            buff.write(struct.pack("<d", self.speed))

    class _response_class(rospy.AnyMsg):  # noqa: N801 - rospy's name
        """Not read."""


def is_python(path: str) -> bool:
    """Return whether a node is a Python program, by its first line."""
    with open(path, "rb") as file:
        return b"python" in file.readline(200)


class FollowWorld(ReplayWorld):
    """The world of one replay in which a controller follows a path."""

    def __init__(
        self,
        parameters: Dict[str, Any],
        mux: Dict[str, Any],
        grid: Optional[Grid],
        reference: Reference,
        has_turns: bool,
    ) -> None:
        """Start the nodes.

        Args:
            parameters: of the car.
            mux: the configuration of the mux.
            grid: the map, or None.
            reference: the path.
            has_turns: whether each message on /clock wakes one thread of the node at most.
        """
        self._reference, self._has_turns, self._grid = reference, has_turns, grid
        self._pending: Iterator[int] = iter(())
        self._pace: Optional[FollowPace] = None
        self._service, self._has_service = "", threading.Event()
        start = dict(zip(("x", "y", "theta"), reference.start))
        rate = {"pose_rate": NANOSECONDS / STEP}
        super().__init__({**parameters, **start, **rate}, mux, grid)
        self.start, self._begin = reference.start, START

    def _offer(self) -> None:
        reference = self._reference
        states = [at_rest(s, pose) for s, pose in zip(reference.stamps, reference.poses)]
        self._path = conversions.path_to_msg(states, START)
        self._paths = rospy.Publisher(PATH, Path, queue_size=1, latch=True, tcp_nodelay=True)
        self._car.add_frames("odom", "base_footprint")  # of courses without a prefix
        threading.Thread(target=self._call_service, daemon=True).start()
        if self._grid is not None:
            grid = conversions.grid_to_msg(self._grid, 0, conversions.MAP_FRAME)
            rospy.Service("/static_map", GetMap, lambda _: grid)

    def _call_service(self) -> None:
        """Give the path to the service of the node, in a thread, as soon as there is one."""
        self._has_service.wait()
        request = FollowPath._request_class(self._path.header, self._path.poses)
        request.speed = self._reference.speed
        rospy.ServiceProxy(self._service, FollowPath)(request)

    def _give_path(self, pace: FollowPace) -> Iterator[int]:
        """Give the node the path if it is ready; yield how many threads receive it.

        This happens at a whole second, so that rounded times are the same in all runs.
        """
        if pace.has_path or self.now % NANOSECONDS:
            return
        services = [each for each in self._master.services.map if each.endswith(SERVICE)]
        if services:
            pace.has_path, self._service = True, services[0]
            self._has_service.set()
            yield 1
        elif count := self._paths.get_num_connections():
            pace.has_path = True
            self._paths.publish(self._path)
            yield count

    @property
    def stands(self) -> bool:
        """Whether the car has driven, and has stood for REST."""
        first = next((each.arrived for each in self.sent if each.speed), self.now)
        recent = self.states[-REST // STEP :]
        return self.now > first + REST and all(each.pose == recent[0].pose for each in recent)

    def observe(self, pace: Pace, is_driving: bool) -> None:
        """Observe the node once; if it waits, process its messages or send the next one.

        The threads of this process must not run while the node is observed.
        """
        assert isinstance(pace, FollowPace)
        self._pace = pace
        is_received, usages = self._receiving.are_waiting(), self._receiving.usages
        is_node_waiting = pace.observe()
        is_received &= self._receiving.are_waiting() and self._receiving.usages is usages
        if not (is_received and is_node_waiting):
            pace.unsettle()
        elif self._master.notify() or self._process(pace):
            pace.unsettle()
            return
        # Without a connection, the node has not initialised ROS yet.
        if is_received and self._clock.get_num_connections() and (step := pace.advance(None)):
            written = next(self._pending, None)
            pace.stepped(self.step(step) if written is None else written)
            self._nap = SHORT_NAP
        else:
            self._nap = min(LONG_NAP, 1.5 * self._nap)
        time.sleep(self._nap)

    def watch(self, process: NodeProcess, timeout: float) -> str:
        """Wait until the node has followed the path, or has failed.

        Args:
            process: the node.
            timeout: longest time without a command [s of wall-clock time].

        Returns:
            A description of the node's failure; empty if there is none.
        """
        pace = FollowPace(process.threads)
        count, heard, checked = 0, 0.0, time.monotonic()
        while not process.has_ended:
            self.observe(pace, True)
            if self.count != count:
                count, heard = self.count, pace.seconds
            if self.stands:
                return ""
            if pace.seconds - heard > timeout or self.silence > MAX_SILENCE:
                return (
                    f"the node runs, but published no command on {CONTROL} for {timeout:g} s; "
                    f"{self.describe_topics()}"
                )
            if time.monotonic() > checked + CHECK_PERIOD:
                checked = time.monotonic()
                if fault := self._fault(process, pace):
                    return fault
        fault = process.describe_failure()
        if fault or self.sent:
            return fault
        return f"the node ended without a command on {CONTROL}; {self.describe_topics()}"

    def _fault(self, process: NodeProcess, pace: FollowPace) -> str:
        """Return why a running node has failed; empty if it has not failed."""
        if not self.is_alive:
            return f"the node has shut down {CAR}"
        if pace.uses_wall_clock:
            return (
                "the node sends commands while the simulated clock stands, so it waits in "
                "wall-clock time, and each drive would be different; wait with rospy.Rate, "
                "rospy.sleep, rospy.Timer, time.sleep, or for a message"
            )
        limit = MAX_TIME * self._reference.duration / NANOSECONDS + EXTRA_TIME
        if self.sent and (self.now - self.sent[0].arrived) / NANOSECONDS > limit:
            return f"the node still drives after {limit:g} s"
        return process.excess()

    def step(self, duration: int) -> int:
        """Advance the clock [ns]; return the number of connections to which was written."""
        self.now += duration
        rospy_fixes.set_time(self.now)
        self._mux.expire()
        self._pending = self._instant()
        return next(self._pending, 0)

    def _instant(self) -> Iterator[int]:
        """Report the states, and then the time; yield how many threads receive each message."""
        states = self._car.states_at([self.now])
        self.states += states
        yield from self._car.publish_each(states)
        if self._pace:
            yield from self._give_path(self._pace)
        for _ in range(MAX_TURNS):
            self._clock.publish(Clock(clock=conversions.time_from(self.now)))
            yield self._clock.get_num_connections()
            if not (self._has_turns and self._pace and self._pace.has_reacted):
                return

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Apply a command now, if its stamp is not ahead: the past has been reported."""
        msg.header.stamp = max(msg.header.stamp, conversions.time_from(self.now))
        super()._on_command(msg, source)
