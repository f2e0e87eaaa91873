"""Listen to topics of any type, for the doctor."""

import time
from contextlib import suppress
from typing import Any, Dict, List, Sequence, Set, Tuple

import rospy

from mushr_ros_intro.doctor.network import run_with_timeout
from mushr_ros_intro.ros.xmlrpc_client import CallError

_START_TIMEOUT = 5.0
"""For becoming a node and for subscribing [s]."""

_END_TIMEOUT = 2.0
"""For unsubscribing and for signing off [s]."""


class Listener:
    """Subscribes to topics of any type, and keeps what each publisher sends.

    rospy calls the master without a timeout, so its calls run in daemon threads here.

    It makes this process an anonymous node, unless it is a node already. It also receives what the
    regular subscribers reject because of its type.

    Raises:
        CallError: the master does not respond; stop() raises it, too.
    """

    def __init__(self, topics: Sequence[str]) -> None:
        self.headers: Dict[Tuple[str, str], Dict[str, str]] = {}
        """The connection header of each topic and node, with the key type."""
        self._messages: List[Tuple[str, rospy.AnyMsg, int]] = []
        self._subscribers: List[rospy.Subscriber] = []
        run_with_timeout(lambda: self._start(topics), _START_TIMEOUT)

    def _start(self, topics: Sequence[str]) -> None:
        if not rospy.core.is_initialized():
            options = ("anonymous", "disable_signals", "disable_rosout", "disable_rostime")
            rospy.init_node("doctor", **dict.fromkeys(options, True))

        def keep(msg: rospy.AnyMsg, topic: str) -> None:
            self._messages.append((topic, msg, time.time_ns()))

        self._subscribers = [rospy.Subscriber(each, rospy.AnyMsg, keep, each) for each in topics]

    def connected(self) -> Set[Tuple[str, str]]:
        """Return the topic and the node of each publisher that has ever been connected."""
        for subscriber in self._subscribers:
            # The header is there before the first message, and for silent publishers too.
            for connection in subscriber.impl.connections:
                header = connection.header or {}
                self.headers[subscriber.resolved_name, header.get("callerid", "")] = header
        return set(self.headers)

    def messages(self, topic: str, kind: Any) -> List[Tuple[str, Any, int]]:
        """Return the node, the message and the arrival of what came on a topic with this type."""
        return [
            (msg._connection_header["callerid"], kind().deserialize(msg._buff), arrival)
            for each, msg, arrival in self._messages
            if each == topic and msg._connection_header["md5sum"] == kind._md5sum
        ]

    def stop(self) -> None:
        """Unsubscribe."""
        self.connected()  # keep the latest headers
        run_with_timeout(lambda: [each.unregister() for each in self._subscribers], _END_TIMEOUT)


def sign_off() -> None:
    """Remove this node's registrations from the master, if the master responds."""
    with suppress(CallError):
        run_with_timeout(lambda: rospy.signal_shutdown("done"), _END_TIMEOUT)
