"""Answer those services of rosapi that list topics, nodes and parameters, and return the time."""

import inspect
import json
from typing import Any, Callable, Dict, Iterable, List, Set, Tuple, Union

import rosgraph
import roslib.message
import rospy

from mushr_ros_intro.browser.messages import to_values
from mushr_ros_intro.ros.conversions import MessageError
from mushr_ros_intro.ros.xmlrpc_client import CallError, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT

PREFIX = "/rosapi/"

Values = Dict[str, Any]


def call(service: str, args: Union[Values, List[Any]]) -> Values:
    """Return the values of the answer of a service; `service` begins with PREFIX.

    The arguments have their names, or are in the order of the fields of the service.

    Raises:
        MessageError: there is no such service, or its arguments are wrong.
        CallError: the master or a node does not answer.
    """
    answer = _SERVICES.get(service[len(PREFIX) :])
    if answer is None:
        known = ", ".join(_SERVICES)
        raise MessageError(f"service {service} is not offered; of {PREFIX}, there are {known}")
    signature = inspect.signature(answer)
    values = list(args.values()) if isinstance(args, dict) else args
    try:
        bound = signature.bind(**args) if isinstance(args, dict) else signature.bind(*args)
    except TypeError:
        bound = None
    if bound is None or not all(isinstance(each, str) for each in values):
        expected = [*signature.parameters]
        raise MessageError(f"arguments of {service} are {args}; expected text for {expected}")
    return answer(*bound.args)


def _master(method: str, *arguments: Any) -> Any:
    return ask(rosgraph.get_master_uri(), CALL_TIMEOUT, rospy.get_name(), method, *arguments)


def no_answer(error: Exception) -> str:
    """Return the message for a master that does not answer, because of `error`."""
    return f"the ROS master does not answer ({error}); restart the simulation"


def topic_types() -> Dict[str, str]:
    """Return the type of each topic that the master knows.

    Raises:
        CallError: the master does not answer.
    """
    return dict(_master("getTopicTypes"))


def services() -> Set[str]:
    """Return the names of the services that the master knows.

    Raises:
        CallError: the master does not answer.
    """
    return {name for name, _ in _master("getSystemState")[2]}


def _of_node(entries: Iterable[Tuple[str, List[str]]], node: str) -> List[str]:
    return sorted(name for name, nodes in entries if node in nodes)


def _topics() -> Values:
    types = topic_types()
    return {"topics": [*types], "types": [*types.values()]}


def _topics_and_raw_types() -> Values:
    types = topic_types()
    texts = []
    for each in types.values():
        kind = roslib.message.get_message_class(each) if each != "*" else None
        texts.append(kind._full_text if kind else "")
    return {"topics": [*types], "types": [*types.values()], "typedefs_full_text": texts}


def _nodes() -> Values:
    entries = [entry for entries in _master("getSystemState") for entry in entries]
    return {"nodes": sorted({node for _, nodes in entries for node in nodes})}


def _node_details(node: str) -> Values:
    publishers, subscribers, services = _master("getSystemState")
    return {
        "subscribing": _of_node(subscribers, node),
        "publishing": _of_node(publishers, node),
        "services": _of_node(services, node),
    }


def _get_param(name: str, default: str = "") -> Values:
    """Return JSON, of the default if there is no such parameter, as rosbridge does."""
    try:
        value = rospy.get_param(name)
    except KeyError:
        return {"value": default or "null"}
    except OSError as error:
        raise CallError(no_answer(error)) from None
    return {"value": json.dumps(to_values(value), default=str)}


def _get_time() -> Values:
    return {"time": to_values(rospy.get_rostime())}


_SERVICES: Dict[str, Callable[..., Values]] = {
    "topics": _topics,
    "topics_and_raw_types": _topics_and_raw_types,
    "nodes": _nodes,
    "node_details": _node_details,
    "get_param": _get_param,
    "get_param_names": lambda: {"names": _master("getParamNames")},
    "get_time": _get_time,
}
