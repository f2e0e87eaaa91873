"""A ROS master that protects the simulated car, and records what a node tries to do to it."""

import threading
from typing import Any, FrozenSet, Iterable, List, Optional, Tuple

import rosgraph.xmlrpc
from rosgraph.names import resolve_name
from rosmaster.master_api import ROSMasterHandler

REFUSED: Tuple[int, str, int] = (-1, "refused, because it would change the simulated car", 0)
"""The answer to a refused call."""


class GuardedMaster(ROSMasterHandler):
    """The API of a ROS master, with all nodes of the simulated car in this process.

    After `guard`, each call comes from the node under test. A call that would change the simulated
    car is refused and recorded. A publisher is not refused, because the simulated car does not
    subscribe to its own topics.
    """

    def __init__(self) -> None:
        super().__init__()
        self.actions: List[str] = []
        """What the node tried to do to the simulated car, each action once."""
        self._owner: Optional[str] = None
        self._parameters: Tuple[str, ...] = ()
        self._services: FrozenSet[str] = frozenset()
        self._topics: FrozenSet[str] = frozenset()

    def serve(self, port: int) -> str:
        """Start to serve at a port, or at a free one if `port` is 0; return the address.

        Raises:
            OSError: the port is in use.
        """
        server = rosgraph.xmlrpc.XmlRpcNode(port, self)
        server._run_init()  # in this thread, so that an error is raised here
        threading.Thread(target=server.server.serve_forever, daemon=True).start()
        return str(server.uri)

    def guard(self, owner: str, parameters: Iterable[str], open_topics: Iterable[str]) -> None:
        """Protect the nodes that are registered now.

        Args:
            owner: the name of the node in this process.
            parameters: parameters that may not be changed, nor those below them.
            open_topics: topics of the simulated car on which the node under test may publish.
        """
        publishers, subscribers, services = self.getSystemState("/")[2]
        self._topics = frozenset(name for name, _ in publishers + subscribers) - set(open_topics)
        self._services = frozenset(name for name, _ in services)
        self._parameters = tuple(parameters)
        self._owner = owner

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers of a topic."""
        return len(self.publishers.get_apis(topic))

    def record(self, action: str) -> None:
        """Record an action of the node under test."""
        if action not in self.actions:
            self.actions.append(action)

    def _dispatch(self, method: str, params: Tuple[Any, ...]) -> Any:
        """Answer a call; XML-RPC servers call this method for every call."""
        if method.startswith("_") or not hasattr(ROSMasterHandler, method):
            raise AttributeError(f"a ROS master has no method '{method}'")
        if self._owner is not None:
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
        if method == "lookupService" and name in self._services:
            return f"calls the service {name}"
        if method == "registerService" and name in self._services:
            return f"offers the service {name}"
        return ""
