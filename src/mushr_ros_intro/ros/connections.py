"""Wait until a topic's two ends have found each other.

ROS connects nodes some time after they have told the master of a topic, and what is published
before that is lost. Now and then it does not connect them at all: where a subscriber registers at
the very moment at which a publisher does, rospy may take the master's answer, which does not name
the publisher yet, after the master's news, which does.
"""

import errno
import http.client
import socket
import time
import xml.parsers.expat
import xmlrpc.client
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List, Sequence, Set

import rosgraph
import rospy

PATIENCE = 5.0
"""How long a node waits at its start for the other ends of its topics [s of wall-clock time]."""

_PING_AFTER = 0.5  # [s] from when on those are left out that do not answer ...
_PING_PATIENCE = 3.0  # ... for so long [s]; one that is only busy does
REANNOUNCE_EVERY = 1.0
"""How long to wait for a connection before the subscribers are reminded, again and again [s]."""


class CallError(RuntimeError):
    """A call to the master or to a node failed: it returned an error, or one of the subclasses."""


class UnknownHostError(CallError):
    """The host name in the address cannot be resolved."""


class RefusedError(CallError):
    """Nothing listens at the address."""


class NoResponseError(CallError):
    """No response came in time."""


class NotRosError(CallError):
    """The response is not one of a ROS master or node."""


def registered_nodes(topic: str, role: str) -> List[str]:
    """Return the names of the nodes that are registered at a topic.

    Args:
        topic: its full name.
        role: "publishers" or "subscribers".

    Raises:
        rosgraph.MasterException, OSError: the master does not answer.
    """
    publishers, subscribers, _ = rosgraph.Master("mushr_ros_intro").getSystemState()
    entries = publishers if role == "publishers" else subscribers
    return [name for entry, names in entries if entry == topic for name in names]


def wait_until_connected(end: Any, role: str, patience: float = PATIENCE) -> bool:
    """Wait until `end` is connected with every live node at the other end of its topic.

    Where that takes long, whoever subscribes is told again who publishes.

    Args:
        end: a rospy.Publisher or rospy.Subscriber.
        role: what the nodes at the other end are, "publishers" or "subscribers".
        patience: how long to wait [s of wall-clock time].

    Returns:
        Whether it is connected with all of them, False if the node is shut down meanwhile. Nobody
        at the other end counts as connected.
    """
    began = time.monotonic()
    reminders = 0
    while True:
        waited = time.monotonic() - began
        try:
            names = registered_nodes(end.resolved_name, role)
        except (rosgraph.MasterException, OSError):
            return False
        is_connected = _is_connected(end, role, names)
        if not is_connected and waited > _PING_AFTER:
            # At the same time: nobody waits for each node that is stopped.
            with ThreadPoolExecutor(len(names)) as pool:
                alive = [
                    name for name, is_alive in zip(names, pool.map(responds, names)) if is_alive
                ]
            is_connected = _is_connected(end, role, alive)
        if is_connected:
            return True
        if waited > patience or rospy.is_shutdown():
            return False
        if waited > (reminders + 1) * REANNOUNCE_EVERY:
            reminders += 1
            reannounce(end, role)
        time.sleep(0.01)


def _is_connected(end: Any, role: str, names: Sequence[str]) -> bool:
    """Say whether `end` is connected with as many nodes as there are names.

    A subscriber counts a connection that it has only begun to make. It is for the publishers to
    say whether what they publish reaches it.
    """
    if end.get_num_connections() < len(names):
        return False
    return role == "subscribers" or all(_serves(name, end.resolved_name) for name in names)


def responds(name: str) -> bool:
    """Say whether a node answers at all, to which it has some seconds: it may be busy."""
    caller = rospy.get_name()
    try:
        ask(rosgraph.Master(caller).lookupNode(name), _PING_PATIENCE, caller, "getPid")
    except (rosgraph.MasterException, OSError, CallError):
        return False
    return True


def _serves(name: str, topic: str) -> bool:
    """Say whether a node says that it publishes a topic to this one."""
    caller = rospy.get_name()
    try:
        uri = rosgraph.Master(caller).lookupNode(name)
        return caller in receivers(uri, _PING_AFTER, caller, topic)
    except (rosgraph.MasterException, OSError, CallError):
        return False


def receivers(uri: str, patience: float, caller: str, topic: str) -> Set[str]:
    """Return the names of the nodes to which a node says that it publishes a topic.

    Args and raises: as `ask`.
    """
    links = ask(uri, patience, caller, "getBusInfo")
    # Each is a number, the node at the other end, the direction, the transport, the topic, ...
    return {each[1] for each in links if each[2:5:2] == ["o", topic]}


def ask(uri: str, patience: float, caller: str, method: str, *arguments: Any) -> Any:
    """Call a method of the master or of a node, and return its value.

    Args:
        uri: the address of the master or the node.
        patience: timeout for connecting and for each read [s].
        caller: the name of the calling node.
        method: a method of the Master API or the Slave API of ROS.
        arguments: the method's arguments after the caller's name.

    Raises:
        CallError: the call failed; its subclass tells how.
    """
    try:
        server = xmlrpc.client.ServerProxy(uri, transport=_Transport(patience))
        code, message, value = getattr(server, method)(caller, *arguments)
    except (socket.timeout, TimeoutError):
        raise NoResponseError(f"{uri}: no response within {patience:g} s") from None
    except socket.gaierror:
        raise UnknownHostError(f"{uri}: unknown host") from None
    except OSError as error:
        raise RefusedError(f"{uri}: {error}") from None
    except (
        xmlrpc.client.Error,
        xml.parsers.expat.ExpatError,
        http.client.HTTPException,
        TypeError,
        ValueError,
    ):
        raise NotRosError(f"{uri}: not a ROS master or node") from None
    if code != 1:
        raise CallError(str(message))
    return value


class _Transport(xmlrpc.client.Transport):
    """An XML-RPC connection with a timeout."""

    def __init__(self, patience: float) -> None:
        super().__init__()
        self._patience = patience

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        """Return a connection to a host, with the timeout set."""
        connection = super().make_connection(host)
        connection.timeout = self._patience
        return connection


def limit_calls(patience: float = PATIENCE) -> None:
    """Let no call of this process to the master or to a node take longer than `patience` [s].

    Where the way to the master is cut, a call takes up to minutes: that of each line of the log,
    before which rospy asks the master for a parameter, and those by which a node signs off.
    """
    make_connection = xmlrpc.client.Transport.make_connection

    def make_limited_connection(transport: Any, host: Any) -> Any:
        connection = make_connection(transport, host)
        connection.timeout = patience
        if connection.sock is not None:  # it is kept from the last call
            connection.sock.settimeout(patience)
        return connection

    single_request = xmlrpc.client.Transport.single_request

    def make_limited_request(*arguments: Any, **options: Any) -> Any:
        try:
            return single_request(*arguments, **options)
        except socket.timeout:  # has no number, for which rospy looks when a node signs off
            raise OSError(errno.ETIMEDOUT, f"no answer within {patience:g} s") from None

    xmlrpc.client.Transport.make_connection = make_limited_connection  # type: ignore
    xmlrpc.client.Transport.single_request = make_limited_request  # type: ignore


def reannounce(end: Any, role: str) -> None:
    """Have the topic's subscribers told again who publishes it; `end` and `role` as above."""
    master, uri = rosgraph.Master(rospy.get_name()), rospy.get_node_uri()
    try:
        if role == "subscribers":
            master.registerPublisher(end.resolved_name, end.type, uri)  # which the master passes on
        else:
            uris = master.registerSubscriber(end.resolved_name, end.type, uri)
            with xmlrpc.client.ServerProxy(uri) as node:
                node.publisherUpdate("/master", end.resolved_name, uris)
    except (rosgraph.MasterException, OSError):
        return  # the next look at the master says so
