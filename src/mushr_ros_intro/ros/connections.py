"""Connections between nodes, as the master and the nodes report them.

ROS connects two nodes some time after they have registered a topic. Messages that are published
before that are lost. If a subscriber and a publisher register at the same moment, rospy may not
connect them at all: it processes the master's notification, which contains the publisher, before
the master's older answer, which does not contain it. Announcing the publisher again repairs this.
"""

import time
import xmlrpc.client
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import compress
from typing import Any, Dict, List

import rosgraph
import rospy

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros.commands import as_typed
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault, ask
from mushr_ros_intro.stamps import CONNECTION_TIMEOUT

REANNOUNCE_PERIOD = 1.0
"""Period at which a publisher is announced to subscribers that are not connected [s]."""

_PING_AFTER = 0.5
"""After this time, nodes that do not respond are ignored [s]."""

_PING_TIMEOUT = 3.0
"""Timeout for the response of a node [s]. A busy node may need longer."""


def registered_nodes(topic: str, role: str) -> List[str]:
    """Return the names of the nodes that are registered at a topic.

    Args:
        topic: the full name of the topic.
        role: "publishers" or "subscribers".

    Raises:
        rosgraph.MasterException, OSError: the master does not answer.
    """
    publishers, subscribers, _ = rosgraph.Master("mushr_ros_intro").getSystemState()
    entries = publishers if role == "publishers" else subscribers
    return [name for entry, names in entries if entry == topic for name in names]


def connected_nodes(end: Any) -> Dict[int, str]:
    """Return the nodes that are connected to a publisher or subscriber, by their connections.

    A new connection has a new number, also if it is to the same node. rospy notices that a node has
    ended when it writes the second message after that.

    Args:
        end: a rospy.Publisher; the nodes have their names. Or a rospy.Subscriber; the nodes have
            their addresses.
    """
    return {link.id: link.endpoint_id for link in end.impl.connections if not link.done}


def is_published(topic: str) -> bool:
    """Return whether a publisher of a topic is registered at the master."""
    with suppress(rosgraph.MasterException, OSError):
        return bool(registered_nodes(topic, "publishers"))
    return False


def is_dead(topic: str) -> bool:
    """Return whether no publisher of a topic responds; False if the master does not answer."""
    with suppress(rosgraph.MasterException, OSError):
        return not any(map(responds, registered_nodes(topic, "publishers")))
    return False


def wait_for_subscriber(publisher: rospy.Publisher, seconds: float) -> None:
    """Wait until a node subscribes to a topic and all its subscribers are connected.

    Args:
        publisher: the publisher of the topic.
        seconds: timeout [s of wall-clock time].

    Raises:
        UserError: no node subscribes; the message names the topic and the remedy.
        rospy.ROSInterruptException: the node is shut down.
    """
    if wait_until_connected(publisher, "subscribers", seconds, minimum=1):
        return
    if rospy.is_shutdown():
        raise rospy.ROSInterruptException("shut down while waiting for a subscriber")
    if not publisher.get_num_connections():
        raise UserError(_no_subscriber(publisher.resolved_name, seconds))
    rospy.logwarn("not every subscriber to %s is connected", publisher.resolved_name)


def _no_subscriber(topic: str, seconds: float) -> str:
    """Return the message for a topic that has no subscriber."""
    names: List[str] = []
    with suppress(rosgraph.MasterException, OSError):
        names = registered_nodes(topic, "subscribers")
    if names:
        return as_typed(
            f"no node is connected to {topic} after {seconds:g} s, but these nodes are registered: "
            f"{', '.join(names)}. Do they respond (rosnode ping)? A node that is stopped (for "
            "example with Ctrl-Z) can block the master. To find the cause, type: "
            "rosrun mushr_ros_intro doctor.py"
        )
    car, separator, _ = topic.strip("/").partition("/mux/")
    argument = f" car_name:={car}" if separator and car != "car" else ""
    return as_typed(
        f"no node subscribes to {topic} after {seconds:g} s. Is the car running "
        f"(roslaunch mushr_ros_intro sim.launch{argument}), and is this its topic (rostopic list)? "
        "For the actual car, use real_car.launch"
    )


def wait_until_connected(
    end: Any, role: str, seconds: float = CONNECTION_TIMEOUT, minimum: int = 0
) -> bool:
    """Wait until a publisher or subscriber is connected to every live node at its topic.

    Args:
        end: a rospy.Publisher or rospy.Subscriber.
        role: the role of the other nodes, "publishers" or "subscribers".
        seconds: timeout [s of wall-clock time].
        minimum: also wait until there are at least this many connections.

    Returns:
        Whether it is connected; False after the timeout, or if this node is shut down or the
        master does not answer.
    """
    began = announced = time.monotonic()
    while True:
        now = time.monotonic()
        try:
            if end.get_num_connections() >= minimum and _is_connected(
                end, role, ignores_dead=now > began + _PING_AFTER
            ):
                return True
        except (rosgraph.MasterException, OSError):
            return False
        if now > began + seconds or rospy.is_shutdown():
            return False
        if now > announced + REANNOUNCE_PERIOD:
            if announced == began and minimum:
                rospy.loginfo("waiting for a %s of %s", role[:-1], end.resolved_name)
            announced = now
            reannounce(end, role)
        time.sleep(POLL_PERIOD)


def _is_connected(end: Any, role: str, ignores_dead: bool) -> bool:
    """Return whether `end` is connected to all nodes at its topic, or to all that respond.

    A subscriber also counts connections that are not open yet, so each publisher is called.
    """
    names = registered_nodes(end.resolved_name, role)
    if ignores_dead and names:
        with ThreadPoolExecutor(len(names)) as pool:
            names = list(compress(names, pool.map(responds, names)))
    if end.get_num_connections() < len(names):
        return False
    caller = rospy.get_name()
    return role == "subscribers" or all(serves(name, end.resolved_name, caller) for name in names)


def responds(name: str) -> bool:
    """Return whether a node responds within a few seconds."""
    with suppress(rosgraph.MasterException, OSError, CallError):
        _ping(name)
        return True
    return False


def is_alive(name: str) -> bool:
    """Return whether a node is registered, and its process has not ended.

    A process that has ended refuses the connection; one that is busy or suspended does not.

    Raises:
        OSError: the master does not answer.
    """
    try:
        _ping(name)
    except rosgraph.MasterException:
        return False
    except CallError as error:
        return error.fault is CallFault.NO_RESPONSE
    return True


def _ping(name: str) -> None:
    caller = rospy.get_name()
    ask(rosgraph.Master(caller).lookupNode(name), _PING_TIMEOUT, caller, "getPid")


def serves(name: str, topic: str, receiver: str) -> bool:
    """Return whether a node reports that it publishes a topic to the node `receiver`."""
    caller = rospy.get_name()
    with suppress(rosgraph.MasterException, OSError, CallError):
        uri = rosgraph.Master(caller).lookupNode(name)
        links = ask(uri, _PING_AFTER, caller, "getBusInfo")
        wanted = receiver, "o", topic
        return any((to, way, of) == wanted for _, to, way, _transport, of, *_ in links)
    return False


def has_live_publisher(subscriber: rospy.Subscriber) -> bool:
    """Return whether a live node publishes to a subscriber of this node, as that node reports."""
    topic, caller = subscriber.resolved_name, rospy.get_name()
    with suppress(rosgraph.MasterException, OSError):
        return any(serves(name, topic, caller) for name in registered_nodes(topic, "publishers"))
    return False


def reannounce(end: Any, role: str) -> None:
    """Announce the publishers of a topic to its subscribers again.

    Args: as for `wait_until_connected`.
    """
    master, uri = rosgraph.Master(rospy.get_name()), rospy.get_node_uri()
    # The next call to the master reports its error.
    with suppress(rosgraph.MasterException, OSError):
        if role == "subscribers":
            master.registerPublisher(end.resolved_name, end.type, uri)  # the master notifies them
        else:
            uris = master.registerSubscriber(end.resolved_name, end.type, uri)
            with xmlrpc.client.ServerProxy(uri) as node:
                node.publisherUpdate("/master", end.resolved_name, uris)
