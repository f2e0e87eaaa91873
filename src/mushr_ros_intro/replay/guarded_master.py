"""A ROS master that protects the simulated car, and records what a node tries to do to it."""

import threading
from functools import partialmethod
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Optional, Tuple
from xmlrpc.server import SimpleXMLRPCRequestHandler

import rosgraph.xmlrpc
from rosgraph.names import resolve_name
from rosmaster.master_api import ROSMasterHandler

REFUSED: Tuple[int, str, int] = (-1, "refused, because it would change the simulated car", 0)
"""The answer to a refused call."""

MAX_NAMES = 100
"""Limit of the number of recorded actions of a node, and of topics: enough for a message."""

MAX_TEXT = 200
"""Limit of the length of their descriptions [characters]."""

MAX_REQUEST = 10_000_000
"""Limit of the length of a call of a node [bytes]; the server reads a call as a whole."""


class GuardedMaster(ROSMasterHandler):
    """The API of a ROS master, with all nodes of the simulated car in this process.

    After `guard`, each call comes from the node under test. A call that would change the simulated
    car is refused and recorded. A publisher is not refused, because the simulated car does not
    subscribe to its own topics.
    """

    def __init__(self) -> None:
        super().__init__()
        self.actions: List[str] = []
        """The first actions that the node tried on the simulated car, each once."""
        self.published: Dict[str, str] = {}
        """The types of the first topics on which the node has published, by topic."""
        self.plan_is_read = False
        """Whether the node has read its parameter ~plan_file."""
        self._updates: Dict[str, List[str]] = {}  # of publishers, by topic, for the owner
        self._owner: Optional[str] = None
        self._parameters: Tuple[str, ...] = ()
        self._topics: FrozenSet[str] = frozenset()

    def serve(self) -> str:
        """Start to serve; return the address.

        From now on, no server of this process reads a call that is longer than MAX_REQUEST.
        """
        handler = rosgraph.xmlrpc.SilenceableXMLRPCRequestHandler
        handler.do_POST = partialmethod(_answer, self.record)
        server = rosgraph.xmlrpc.XmlRpcNode(0, self)
        server._run_init()  # now, because it chooses a free port
        threading.Thread(target=server.server.serve_forever, daemon=True).start()
        return str(server.uri)

    def guard(
        self,
        owner: str,
        parameters: Iterable[str],
        open_topics: Iterable[str],
        update: Callable[[str, List[str]], None] = lambda topic, publishers: None,
    ) -> None:
        """Protect the nodes that are registered now.

        Args:
            owner: the name of the node in this process.
            parameters: parameters that may not be changed, nor those below them.
            open_topics: topics of the simulated car on which the node under test may publish.
            update: sets the publishers of one of the topics of the owner.
        """
        publishers, subscribers, _ = self.getSystemState("/")[2]
        self._topics = frozenset(name for name, _ in publishers + subscribers) - set(open_topics)
        self._parameters = tuple(parameters)
        self._own_uri, self._update = self.reg_manager.get_node(owner).api, update
        self._owner = owner

    def unpublished(self) -> List[str]:
        """Return the topics to which the node under test subscribes, and nobody publishes."""
        publishers, subscribers, _ = self.getSystemState("/")[2]
        published = {topic for topic, _ in publishers}
        return [t for t, nodes in subscribers if t not in published and set(nodes) != {self._owner}]

    def notify(self) -> bool:
        """Tell the owner about new publishers of its topics; return whether there were any.

        A topic is connected only while the node under test waits. So a message that it publishes
        without waiting for the connection is always lost.
        """
        with self.ps_lock:  # held while a publisher is registered
            updates, self._updates = self._updates, {}
        for topic, publishers in updates.items():
            self._update(topic, publishers)
        return bool(updates)

    def _notify_topic_subscribers(
        self, topic: str, pub_uris: List[str], sub_uris: List[str]
    ) -> None:
        if self._owner is not None and self._own_uri in sub_uris:
            self._updates[topic] = pub_uris
            sub_uris = [each for each in sub_uris if each != self._own_uri]
        super()._notify_topic_subscribers(topic, pub_uris, sub_uris)

    def record(self, action: str) -> None:
        """Record an action of the node under test."""
        action = action[:MAX_TEXT]
        if action not in self.actions and len(self.actions) < MAX_NAMES:
            self.actions.append(action)

    def _dispatch(self, method: str, params: Tuple[Any, ...]) -> Any:
        """Answer a call; XML-RPC servers call this method for every call."""
        if method.startswith("_") or not hasattr(ROSMasterHandler, method):
            raise AttributeError(f"a ROS master has no method '{method}'")
        if self._owner is not None:
            if method == "registerPublisher" and len(params) > 2:
                caller, topic, kind = map(str, params[:3])
                if len(self.published) < MAX_NAMES:
                    self.published[resolve_name(topic, caller)[:MAX_TEXT]] = kind[:MAX_TEXT]
            if method in ("getParam", "subscribeParam") and len(params) > 1:
                name = str(params[-1]).rstrip("/")
                if name in (params[0], f"{params[0]}/plan_file"):
                    self.plan_is_read = True
            action = self._action(method, *map(str, params[:2]))
            if action:
                self.record(action)
                if not action.startswith("publishes"):
                    return REFUSED
        return getattr(self, method)(*params)

    def _action(self, method: str, caller: str = "", name: str = "") -> str:
        """Return what a call would do to the simulated car; empty if nothing."""
        name = resolve_name(name, caller) if name else name
        if method == "shutdown":
            return "shuts down the master"
        if "register" in method and resolve_name(caller, "/") == self._owner:
            return f"registers or unregisters the node {self._owner}"
        if method in ("setParam", "deleteParam"):
            changed = (f"{each}/".startswith(name.rstrip("/") + "/") for each in self._parameters)
            if any(changed) or name.startswith(tuple(f"{each}/" for each in self._parameters)):
                return f"changes the parameter {name}"
        if method == "registerPublisher" and name in self._topics:
            return f"publishes on {name}"
        if method == "lookupService" and name.startswith(f"{self._owner}/"):
            return f"calls the service {name}"
        if method == "registerService" and name.startswith(f"{self._owner}/"):
            return f"offers the service {name}"
        return ""


def _answer(request: SimpleXMLRPCRequestHandler, record: Callable[[str], None]) -> None:
    """Answer a call, or refuse it if it is too long; `record` then gets a description."""
    length = request.headers.get("content-length", "")
    if length.isdigit() and int(length) <= MAX_REQUEST:
        SimpleXMLRPCRequestHandler.do_POST(request)
        return
    record(f"sends a call of {length or 'unknown'} bytes; the limit is {MAX_REQUEST} bytes")
    request.send_error(413)
    request.close_connection = True
