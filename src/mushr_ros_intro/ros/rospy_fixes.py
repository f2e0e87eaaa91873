"""All workarounds for rospy and its libraries.

Each docstring describes the symptom, and the cause in rospy 1.16. No other module patches rospy.
"""

import os
import socket
import tempfile
import threading
import time
import xmlrpc.client
from contextlib import suppress
from typing import Any, Callable, Dict, List, Optional, Sequence

import rosgraph
import rosgraph.roslogging
import rosgraph.xmlrpc
import rospkg
import rospy
import rospy.impl.paramserver
import rospy.impl.registration
from rospy.impl.tcpros_pubsub import QueuedConnection, TCPROSHandler

from mushr_ros_intro.ros.xmlrpc_client import LimitedTransport
from mushr_ros_intro.stamps import NANOSECONDS


def apply_before_init_node() -> None:
    """Apply the fixes that are needed before rospy.init_node is called, except `limit_calls`."""
    write_logs_somewhere()
    keep_latest_link()
    forget_log_parameter()
    write_at_once()
    connect_once()


def limit_calls() -> None:
    """Limit the duration of calls to the master and to other nodes.

    Symptom: if the network to the master is cut, a node hangs for minutes, also during shutdown,
    because even a log line calls the master.
    Cause: rospy's XML-RPC clients have no timeout (xmlrpcapi in rospy/core.py).
    """
    xmlrpc.client.Transport = LimitedTransport  # type: ignore


def write_logs_somewhere() -> None:
    """Let rospy write its log to the temporary folder if the log folder is not writable.

    Symptom: if the home directory is read-only or full, a node prints nothing, not even errors.
    Cause: rospy.core.configure_logging then sets up no log handler, not even for the terminal.
    """
    folder = rospkg.get_log_dir()
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        other = os.path.join(tempfile.gettempdir(), f"ros_log_{os.getuid()}")
        os.environ[rospkg.environment.ROS_LOG_DIR] = other


def keep_latest_link() -> None:
    """Leave the link `latest` in the log folder to roslaunch, which has created it.

    Symptom: "cannot create a symlink to latest log directory", when roslaunch starts nodes.
    Cause: each node replaces the link, in two steps (rosgraph/roslogging.py), at the same time.
    """
    rosgraph.roslogging.renew_latest_logdir = lambda folder: True


def forget_log_parameter() -> None:
    """Prevent the subscription to a parameter by the first log line of a node.

    Symptom: a node that has ended is still registered at the master. When a node with the same name
    starts, the master shuts down the node that now has the old address, which is another node.
    Cause: rospy does not unsubscribe from the parameter at shutdown (rospy/impl/rosout.py).
    """
    cache = rospy.impl.paramserver.get_param_server_cache()
    cache.set("/rosout_disable_topics_generation", False)


def connect_once() -> None:
    """Let a subscriber open one connection only to each publisher.

    Symptom: on a busy machine, a drive ends because the mux is no longer connected, but it runs.
    Cause: each time the master reports a publisher, a thread of the subscriber looks whether there
    is a connection, calls the publisher, and then connects (rospy/impl/masterslave.py). If two
    threads do this at the same time, the second connection replaces the first one.
    """
    create, lock = TCPROSHandler.create_transport, threading.Lock()

    def create_once(self: Any, topic: str, uri: str, parameters: Any) -> Any:
        subscriber = rospy.impl.registration.get_topic_manager().get_subscriber_impl(topic)
        with lock:
            if subscriber.has_connection(uri):
                return 1, f"{topic} is connected to {uri}", 0
            return create(self, topic, uri, parameters)

    TCPROSHandler.create_transport = create_once


def write_at_once() -> None:
    """Let the thread that publishes write a message itself, if it need not wait.

    Symptom: a message is sent up to some milliseconds late on a busy machine, and half of the time
    in lock-step is spent on switches between threads.
    Cause: rospy has a queue and a thread for each connection (QueuedConnection in
    rospy/impl/tcpros_pubsub.py), and publish() yields the processor after each message.
    """
    rospy.topics.QueuedConnection = DirectConnection


class DirectConnection(QueuedConnection):
    """Writes a message at once if nothing is queued and the socket takes it; queues the rest."""

    is_followed = False
    """Whether another message follows at once, so that the kernel sends both in one packet."""

    def __init__(self, connection: Any, queue_size: int) -> None:
        self._accepted = connection.stat_num_msg
        """The number of messages that have been written or are queued."""
        self._rest = b""
        """The rest of a message that the socket took in part; it must not be dropped."""
        super().__init__(connection, queue_size)

    def write_data(self, data: bytes) -> bool:
        """Write or queue a message; raise the error of an earlier write."""
        with self._lock:
            error: Optional[Exception] = self._error  # type: ignore
            if error:
                self._error = None
                raise error
            # If messages are queued, the thread has not written as many as were accepted.
            sent = self._send(data) if self._accepted == self._connection.stat_num_msg else 0
            self._accepted += 1
            if sent == len(data):
                self._connection.stat_bytes += sent
                self._connection.stat_num_msg += 1
                return True
            oldest = int(bool(self._queue) and self._queue[0] is self._rest)
            if 0 < self._queue_size <= len(self._queue) - oldest:
                del self._queue[oldest]
                self._accepted -= 1
            self._queue.append(data[sent:])
            if sent:
                self._rest = self._queue[-1]
            self._cond_data_available.notify()
        return True

    def _send(self, data: bytes) -> int:
        """Send as much of `data` as the socket takes now; return the number of bytes."""
        with suppress(OSError):  # also if it takes nothing; the thread reports other errors
            flags = socket.MSG_DONTWAIT | (socket.MSG_MORE if self.is_followed else 0)
            return int(self._connection.socket.send(data, flags))
        return 0


def publish_together(publisher: rospy.Publisher, messages: Sequence[rospy.Message]) -> None:
    """Publish messages that a subscriber receives together.

    Symptom: in lock-step, a third of the time is spent on sending and receiving the poses between
    two commands.
    Cause: each message is a packet, and wakes up the subscriber (publish in rospy/topics.py).
    """
    for number, message in enumerate(messages, 1):
        for link in publisher.impl.connections:
            link.is_followed = number < len(messages)
        publisher.publish(message)


def set_time(now: int) -> None:
    """Set the ROS time of this process to `now` [ns].

    Symptom: a node that publishes /clock must use disable_rostime, and then its ROS time is
    wall-clock time.
    Cause: rospy sets its time from messages on /clock only (rospy/impl/simtime.py).
    """
    rospy.rostime._set_rostime(rospy.Time(*divmod(now, NANOSECONDS)))


def take_publisher_updates(on_call: Callable[[], None]) -> Callable[[str, List[str]], None]:
    """Ignore what other processes report about publishers; return the function that sets them.

    Symptom: any process can make this node connect to any address, as if it were the master.
    Cause: a node does not check who calls publisherUpdate (rospy/impl/masterslave.py).

    Args:
        on_call: called instead if another process reports the publishers of a topic.
    """
    listeners = rospy.impl.registration.get_registration_listeners().listeners
    (manager,) = (each for each in listeners if hasattr(each, "publisher_update"))
    update: Callable[[str, List[str]], None] = manager.publisher_update
    manager.publisher_update = lambda topic, publishers: on_call()
    return update


def count_written(publisher: rospy.Publisher) -> Dict[int, int]:
    """Return the number of messages that have been written to each connection of a publisher."""
    _, _, connections = publisher.impl.get_stats()
    return {link: written for link, _, written, is_open in connections if is_open}


def flush(publisher: rospy.Publisher, before: Dict[int, int], seconds: float = 1.0) -> None:
    """Wait until the last message of a publisher has been written to its connections.

    Symptom: the last message of a node is lost.
    Cause: rospy has a queue and a thread for each connection (QueuedConnection in
    rospy/topics.py), and discards the queues at shutdown.

    Args:
        publisher: the publisher of the message.
        before: the result of `count_written` before the message was published.
        seconds: timeout [s].
    """
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        written = count_written(publisher)
        if all(written[link] > count for link, count in before.items() if link in written):
            return
        time.sleep(0.001)
