"""Every workaround for rospy and the libraries below it. Nothing else patches anything.

Each function names the symptom, and the lines of rospy (1.16) that cause it.
"""

import errno
import os
import socket
import tempfile
import time
import xmlrpc.client
from typing import Any, Dict

import rosgraph
import rospkg
import rospy
import rospy.impl.paramserver

from mushr_ros_intro.sim.stamps import CALL_TIMEOUT


def apply_before_init_node() -> None:
    """Apply the fixes that have to be in place when rospy.init_node is called."""
    limit_calls()
    write_logs_somewhere()
    forget_log_parameter()
    end_server_with_node()


def limit_calls(seconds: float = CALL_TIMEOUT) -> None:
    """Let calls to the master and to other nodes fail after `seconds`.

    Symptom: if the network to the master is cut, a node hangs for minutes, also at its end. Even a
        log line calls the master. Cause: rospy's XML-RPC clients have no timeout (rospy/core.py,
        xmlrpcapi).
    """
    transport = xmlrpc.client.Transport
    make_connection, single_request = transport.make_connection, transport.single_request

    def make_limited_connection(self: Any, host: Any) -> Any:
        connection = make_connection(self, host)
        connection.timeout = seconds
        if connection.sock is not None:  # kept from the last call
            connection.sock.settimeout(seconds)
        return connection

    def make_limited_request(*arguments: Any, **options: Any) -> Any:
        try:
            return single_request(*arguments, **options)
        except socket.timeout:  # it has no errno, which rospy reads when a node unregisters
            raise OSError(errno.ETIMEDOUT, f"no answer within {seconds:g} s") from None

    transport.make_connection = make_limited_connection  # type: ignore
    transport.single_request = make_limited_request  # type: ignore


def write_logs_somewhere() -> None:
    """Let rospy log into the temporary folder if its own folder cannot be written.

    Symptom: with a read-only or full home a node prints nothing, not even its errors. Cause:
    rospy.core.configure_logging gives up on all log handlers, the terminal's included.
    """
    folder = rospkg.get_log_dir()
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        other = os.path.join(tempfile.gettempdir(), f"ros_log_{os.getuid()}")
        os.environ[rospkg.environment.ROS_LOG_DIR] = other


def forget_log_parameter() -> None:
    """Keep rospy from subscribing to a parameter with the first line of a node's log.

    Symptom: a node that has ended stays known to the master. When the next node of its name starts,
    the master shuts down whatever listens at the old address by then. Cause: rospy does not
    unsubscribe the parameter at shutdown (rospy/impl/rosout.py).
    """
    cache = rospy.impl.paramserver.get_param_server_cache()
    cache.set("/rosout_disable_topics_generation", False)


class _Server(rosgraph.xmlrpc.ThreadingXMLRPCServer):
    """A node's XML-RPC server that ends when its socket is closed."""

    def service_actions(self) -> None:
        """Raise the error that rospy expects from a closed server."""
        super().service_actions()
        if self.socket.fileno() < 0:
            raise OSError("the server is closed")


def end_server_with_node() -> None:
    """Let a node's XML-RPC server end when the node is shut down.

    Symptom: at its end each node uses a whole core for half a second. Cause:
        rosgraph.xmlrpc.shutdown closes the server's socket, and serve_forever polls the closed
        socket without a pause.
    """
    rosgraph.xmlrpc.ThreadingXMLRPCServer = _Server


def count_written(publisher: rospy.Publisher) -> Dict[int, int]:
    """Return the number of messages that have been written to each connection of a publisher."""
    _, _, connections = publisher.impl.get_stats()
    return {link: written for link, _, written, is_open in connections if is_open}


def flush(publisher: rospy.Publisher, before: Dict[int, int], seconds: float = 1.0) -> None:
    """Wait until the last message of a publisher has been written to its connections.

    Symptom: the last message before a node ends is lost. Cause: rospy queues messages for a thread
    per connection (QueuedConnection in rospy/topics.py) and drops the queues at shutdown.

    Args:
        publisher: that sent the message.
        before: what `count_written` returned before the message was published.
        seconds: how long to wait at most [s].
    """
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        written = count_written(publisher)
        if all(written[link] > count for link, count in before.items() if link in written):
            return
        time.sleep(0.001)
