"""Give a controller the path that it follows: on a topic, or by a service of the node."""

import struct
import threading
from typing import Any, Collection, Iterator

import rospy
from nav_msgs.msg import Path

from mushr_ros_intro.car.model import at_rest
from mushr_ros_intro.replay.reference import Reference
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.stamps import NANOSECONDS

PATH = "/car/reference_path"
"""The topic of the path (nav_msgs/Path, latched)."""

SERVICE = "/follow_path"
"""If the node offers a service whose name ends like this, it gets the path there."""


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


class PathDelivery:
    """Gives the path to the node once."""

    def __init__(self, reference: Reference, begin: int, services: Collection[str]) -> None:
        """Advertise the topic.

        Args:
            reference: the path.
            begin: when the car starts [ns].
            services: the names of all services; the node under test adds its own.
        """
        states = [at_rest(s, pose) for s, pose in zip(reference.stamps, reference.poses)]
        self._path, self._speed = conversions.path_to_msg(states, begin), reference.speed
        self._services = services
        self._is_given = False
        self._service, self._has_service = "", threading.Event()
        # Before the node is started, because the clock waits for the threads that run by then.
        threading.Thread(target=self._call, daemon=True).start()
        self._publisher = rospy.Publisher(PATH, Path, queue_size=1, latch=True, tcp_nodelay=True)

    def give(self, now: int) -> Iterator[int]:
        """Give the node the path if it is ready; yield how many threads receive it.

        This happens at a whole second, so that rounded times are the same in all runs.
        """
        if self._is_given or now % NANOSECONDS:
            return
        services = [each for each in self._services if each.endswith(SERVICE)]
        if services:
            self._is_given, self._service = True, services[0]
            self._has_service.set()
            yield 1
        elif count := self._publisher.get_num_connections():
            self._is_given = True
            self._publisher.publish(self._path)
            yield count

    def _call(self) -> None:
        self._has_service.wait()
        request = FollowPath._request_class(self._path.header, self._path.poses)
        request.speed = self._speed
        rospy.ServiceProxy(self._service, FollowPath)(request)
