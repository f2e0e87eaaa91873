"""Answer the read-only services of rosapi, which rosbridge's clients use to look around.

Parameters cannot be set or deleted.
"""

import inspect
import json
from typing import Any, Callable, Dict, Iterable, List, Tuple

import genmsg.msgs
import genpy
import rosgraph
import roslib.message
import rospy

from mushr_ros_intro.ros.connections import ask
from mushr_ros_intro.ros.conversions import MessageError
from mushr_ros_intro.ros.json_messages import message_class, to_values
from mushr_ros_intro.sim.stamps import CALL_TIMEOUT

PREFIX = "/rosapi/"

Values = Dict[str, Any]


def call(service: str, args: Values) -> Values:
    """Return the values of the answer of a service; `service` begins with PREFIX.

    Raises:
        MessageError: there is no such service, or its arguments are wrong.
        CallError: the master or a node does not answer.
    """
    answer = _SERVICES.get(service[len(PREFIX) :])
    if answer is None:
        known = ", ".join(_SERVICES)
        raise MessageError(f"service {service} is not offered; of {PREFIX}, there are {known}")
    expected = inspect.signature(answer).parameters
    missing = [name for name, each in expected.items() if each.default is each.empty]
    if not set(missing) <= set(args) <= set(expected) or not all(
        isinstance(value, str) for value in args.values()
    ):
        raise MessageError(f"arguments of {service} are {args}; expected text for {[*expected]}")
    return answer(**args)


def _master(method: str, *arguments: Any) -> Any:
    """Call a method of the master."""
    return ask(rosgraph.get_master_uri(), CALL_TIMEOUT, rospy.get_name(), method, *arguments)


def topic_types() -> Dict[str, str]:
    """Return the type of each topic that the master knows.

    Raises:
        CallError: the master does not answer.
    """
    return dict(_master("getTopicTypes"))


def service_type(service: str) -> str:
    """Return the type of a service, or an empty text; see `rosservice.get_service_type`."""
    import rosservice  # takes 0.1 s, and few clients ask

    try:
        return rosservice.get_service_type(service) or ""
    except rosservice.ROSServiceException as error:
        raise MessageError(f"service {service} does not respond: {error}") from None


def has_service(service: str) -> bool:
    """Return whether the master knows a service.

    Raises:
        CallError: the master does not answer.
    """
    return any(service == name for name, _ in _master("getSystemState")[2])


def _names(entries: Iterable[Tuple[str, List[str]]]) -> List[str]:
    return sorted(name for name, _ in entries)


def _of_node(entries: Iterable[Tuple[str, List[str]]], node: str) -> List[str]:
    return sorted(name for name, nodes in entries if node in nodes)


def _nodes_at(role: int, topic: str) -> List[str]:
    return sorted(dict(_master("getSystemState")[role]).get(topic, []))


def _topics() -> Values:
    types = topic_types()
    return {"topics": [*types], "types": [*types.values()]}


def _topics_for_type(type: str) -> Values:
    return {"topics": sorted(name for name, each in topic_types().items() if each == type)}


def _topics_and_raw_types() -> Values:
    types = topic_types()
    texts = []
    for each in types.values():
        kind = roslib.message.get_message_class(each) if each != "*" else None
        texts.append(kind._full_text if kind else "")
    return {"topics": [*types], "types": [*types.values()], "typedefs_full_text": texts}


def _services() -> Values:
    return {"services": _names(_master("getSystemState")[2])}


def _services_for_type(type: str) -> Values:
    names = _names(_master("getSystemState")[2])
    return {"services": [name for name in names if service_type(name) == type]}


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
    """Return a parameter as JSON text; an object is as in ROS."""
    names = _master("getParamNames")
    if not any(each == name or each.startswith(f"{name}/") for each in names):
        return {"value": default}
    return {"value": json.dumps(_master("getParam", name), default=str)}


def _get_time() -> Values:
    return {"time": to_values(rospy.get_rostime())}


def _message_details(type: str) -> Values:
    return {"typedefs": _definitions(message_class(type))}


def _service_details(type: str, part: str) -> Values:
    try:
        kind = roslib.message.get_service_class(type)
    except (ValueError, ImportError):
        kind = None
    if kind is None:
        raise MessageError(f"type {type!r} is not known; expected one like std_srvs/Trigger")
    return {"typedefs": _definitions(getattr(kind, part))}


def _definitions(kind: Any) -> List[Values]:
    """Return the fields of a message type, and of all message types in it."""
    waiting, found = [kind], {}
    while waiting:
        each = waiting.pop(0)
        if each._type in found or issubclass(each, genpy.TVal):
            continue
        types = [genmsg.msgs.parse_type(slot_type) for slot_type in each._slot_types]
        blank = each()
        fields = [getattr(blank, name) for name in each.__slots__]
        found[each._type] = {
            "type": each._type,
            "fieldnames": [*each.__slots__],
            "fieldtypes": [base for base, _, _ in types],
            # -1: no array; 0: an array of any length
            "fieldarraylen": [(length or 0) if is_array else -1 for _, is_array, length in types],
            "examples": [
                "[]" if isinstance(field, (list, bytes)) else json.dumps(to_values(field))
                for field in fields
            ],
            "constnames": [],
            "constvalues": [],
        }
        bases = [base for base, _, _ in types if "/" in base]
        waiting += [message_class(base) for base in bases]
    return [*found.values()]


_SERVICES: Dict[str, Callable[..., Values]] = {
    "topics": _topics,
    "topics_for_type": _topics_for_type,
    "topics_and_raw_types": _topics_and_raw_types,
    "topic_type": lambda topic: {"type": topic_types().get(topic, "")},
    "publishers": lambda topic: {"publishers": _nodes_at(0, topic)},
    "subscribers": lambda topic: {"subscribers": _nodes_at(1, topic)},
    "services": _services,
    "services_for_type": _services_for_type,
    "service_type": lambda service: {"type": service_type(service)},
    "nodes": _nodes,
    "node_details": _node_details,
    "get_param_names": lambda: {"names": _master("getParamNames")},
    "has_param": lambda name: {"exists": bool(_master("hasParam", name))},
    "get_param": _get_param,
    "get_time": _get_time,
    "message_details": _message_details,
    "service_request_details": lambda type: _service_details(type, "_request_class"),
    "service_response_details": lambda type: _service_details(type, "_response_class"),
}
