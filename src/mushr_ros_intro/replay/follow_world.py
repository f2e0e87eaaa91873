"""The world of a replay in which a controller follows a path.

The clock advances in equal steps. A command applies at the instant at which it arrives.
"""

import struct
import threading
import time
from typing import Any, Dict, Iterator, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetMap

from mushr_ros_intro.car.model import at_rest
from mushr_ros_intro.isolation.node_process import NodeProcess
from mushr_ros_intro.replay.following import EXTRA_TIME
from mushr_ros_intro.replay.pace import STEP, Pace
from mushr_ros_intro.replay.received import CONTROL, Received
from mushr_ros_intro.replay.reference import Reference
from mushr_ros_intro.replay.world import (
    CHECK_PERIOD,
    MAX_SILENCE,
    START,
    ReplayWorld,
    describe_limits,
)
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.simulator.mux import Input
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.grid import Grid

PATH = "/car/reference_path"
"""The topic of the path (nav_msgs/Path, latched)."""

SERVICE = "/follow_path"
"""The world calls a service of the node whose name ends like this, and gives it the path."""

MAX_TIME = 3.0
"""Limit of the duration of a drive, as a multiple of that of the path; EXTRA_TIME is added."""

REST = 2 * NANOSECONDS
"""The drive has ended if the car stands for this time [ns]."""


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


class FollowWorld(ReplayWorld):
    """The world of one replay in which a controller follows a path."""

    def __init__(
        self,
        parameters: Dict[str, Any],
        mux: Dict[str, Any],
        grid: Optional[Grid],
        reference: Reference,
    ) -> None:
        """Start the nodes.

        Args:
            parameters: of the car.
            mux: the configuration of the mux.
            grid: the map, or None.
            reference: the path.
        """
        self._reference = reference
        self._has_path = False  # whether the node has received the path
        self._service, self._has_service = "", threading.Event()
        start = dict(zip(("x", "y", "theta"), reference.start))
        rate = {"pose_rate": NANOSECONDS / STEP}
        super().__init__({**parameters, **start, **rate}, mux, grid)
        self.received = Received(reference.start, START)

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

    def _give(self) -> Iterator[int]:
        """Give the node the path if it is ready; yield how many threads receive it.

        This happens at a whole second, so that rounded times are the same in all runs.
        """
        if self._has_path or self.now % NANOSECONDS:
            return
        services = [each for each in self._master.services.map if each.endswith(SERVICE)]
        if services:
            self._has_path, self._service = True, services[0]
            self._has_service.set()
            yield 1
        elif count := self._paths.get_num_connections():
            self._has_path = True
            self._paths.publish(self._path)
            yield count

    @property
    def stands(self) -> bool:
        """Whether the car has driven, and has stood for REST."""
        commands = self.received.commands
        first = next((each.arrived for each in commands if each.speed), self.now)
        recent = self.states[-REST // STEP :]
        return self.now > first + REST and all(each.pose == recent[0].pose for each in recent)

    def watch(self, process: NodeProcess, timeout: float) -> str:
        """Wait until the node has followed the path, or has failed.

        Args:
            process: the node.
            timeout: longest time without a command [s of wall-clock time].

        Returns:
            A description of the node's failure; empty if there is none.
        """
        pace = Pace(process.threads)
        count, heard, checked = 0, 0.0, time.monotonic()
        while not process.has_ended:
            self.observe(pace, 0)
            if self.count != count:
                count, heard = self.count, pace.seconds
            if self.stands:
                return ""
            if pace.seconds - heard > timeout or self.silence > MAX_SILENCE:
                return (
                    f"the node runs, but sent no command on {CONTROL} for "
                    f"{describe_limits(timeout)}; {self.topic_mistake}"
                )
            if fault := self._fault(pace):
                return fault
            if time.monotonic() > checked + CHECK_PERIOD:
                checked = time.monotonic()
                if excess := process.excess():
                    return excess
        return self.describe_end(process)

    def _fault(self, pace: Pace) -> str:
        """Return why a running node has failed; empty if it has not failed."""
        if fault := self.fault(pace):
            return fault
        limit = MAX_TIME * self._reference.duration / NANOSECONDS + EXTRA_TIME
        commands = self.received.commands
        if commands and (self.now - commands[0].arrived) / NANOSECONDS > limit:
            return f"the node still drives after {limit:g} s"
        return ""

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Apply a command now, if its stamp is not ahead: the past has been reported."""
        msg.header.stamp = max(msg.header.stamp, conversions.time_from(self.now))
        super()._on_command(msg, source)
