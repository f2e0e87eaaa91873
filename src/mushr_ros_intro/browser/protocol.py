"""Read the requests of rosbridge clients, and write the frames for them.

The protocol is rosbridge v2: https://github.com/RobotWebTools/rosbridge_suite/blob/ros1/ROSBRIDGE_PROTOCOL.md
"""

import json
import struct
from typing import Any, Callable, Dict, List, NamedTuple, NoReturn, Union

MAX_THROTTLE = 1e9
"""The largest throttle rate of a subscription [ms]."""

COMPRESSIONS = ("none", "cbor-raw")
"""Formats of messages: JSON text; binary frames with the messages as ROS transmits them."""

_KINDS = {
    str: "text",
    dict: "an object",
    float: "a number from 0",
    (dict, list): "an object or a list",
}

_FIELDS: Dict[str, Dict[str, type]] = {
    "advertise": {"topic": str, "type": str},
    "unadvertise": {"topic": str},
    "publish": {"topic": str, "msg": dict},
    "subscribe": {"topic": str},
    "unsubscribe": {"topic": str},
    "call_service": {"service": str},
    "set_level": {},
    "status": {},
}
"""The operations of clients, and the fields that each requires. A client's status is ignored."""

_OPTIONS: Dict[str, Dict[str, Any]] = {
    "subscribe": {"type": str, "throttle_rate": float, "queue_length": float, "compression": str},
    "call_service": {"args": (dict, list), "type": str},
}
"""Optional fields; null means that the field is missing. All further fields are ignored."""


Id = Union[str, float, None]
"""A client adds it to a request, and the answer repeats it."""


class ProtocolError(ValueError):
    """A request that cannot be carried out. The text names the fault and what was expected."""


class Request(NamedTuple):
    """One request of a client."""

    op: str
    id: Id = None
    topic: str = ""
    type: str = ""
    """A message type; empty if the client does not name one."""
    msg: Dict[str, Any] = {}
    service: str = ""
    args: Union[Dict[str, Any], List[Any]] = {}
    throttle_rate: float = 0.0
    """The shortest time between two messages [ms]."""
    queue_length: float = 0.0
    """How many messages wait at most; 0 means a default of the server."""
    compression: str = "none"


def read_request(text: Union[str, bytes]) -> Request:
    """Return the request in a frame.

    Raises:
        ProtocolError: the frame is not a request of the protocol.
    """
    try:
        values = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"the frame is not JSON: {error}") from None
    op = values.get("op") if isinstance(values, dict) else None
    if not isinstance(op, str) or op not in _FIELDS:
        raise ProtocolError(f"op is {_shown(op)}; expected one of {', '.join(_FIELDS)}")
    required, options = _FIELDS[op], _OPTIONS.get(op, {})
    fields = {
        name: _checked(op, name, values.get(name), kind)
        for name, kind in {**required, **options}.items()
        if name in required or values.get(name) is not None
    }
    if fields.get("compression", "none") not in COMPRESSIONS:
        fields["compression"] = "none"  # clients must accept uncompressed messages, too
    return Request(op, _id_in(values), **fields)


def _id_in(values: Dict[str, Any]) -> Id:
    value = values.get("id")
    return value if isinstance(value, (str, int, float)) else None


def _checked(op: str, name: str, value: Any, kind: Any) -> Any:
    """Return the value of a field of an operation; raise a ProtocolError if it has another kind."""
    if kind is float:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        is_valid = is_number and 0 <= value <= MAX_THROTTLE
    else:
        is_valid = isinstance(value, kind) and (value != "" or kind is not str)
    if not is_valid:
        raise ProtocolError(f"{op}: {name} is {_shown(value)}; expected {_KINDS[kind]}")
    return value


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number of JSON")


def _shown(value: Any) -> str:
    text = "missing" if value is None else json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."


def status(message: str, request_id: Id) -> str:
    """Return the frame that reports an error."""
    frame: Dict[str, Any] = {"op": "status", "level": "error", "msg": message}
    return json.dumps(frame if request_id is None else {**frame, "id": request_id})


def response(request: Request, values: Any, result: bool = True) -> str:
    """Return the frame that answers a call of a service; without a result, values is the error."""
    frame: Dict[str, Any] = {"op": "service_response", "service": request.service}
    frame.update(values=values, result=result)
    return json.dumps(frame if request.id is None else {**frame, "id": request.id})


class Message:
    """A message of a topic. It is encoded at most once for all clients.

    Args:
        topic: the name of the topic.
        raw: the message as ROS transmits it.
        to_json: returns the message as JSON text.
        now: the time of reception [ns].
    """

    def __init__(self, topic: str, raw: bytes, to_json: Callable[[bytes], str], now: int) -> None:
        self.topic = topic
        self._raw = raw
        self._to_json = to_json
        self._now = now
        self._frames: Dict[str, Union[str, bytes]] = {}

    def frame(self, compression: str) -> Union[str, bytes]:
        """Return the frame that publishes this message; binary frames are bytes."""
        if compression not in self._frames:
            if compression == "cbor-raw":
                secs, nsecs = divmod(self._now, 1_000_000_000)
                msg = {"secs": secs, "nsecs": nsecs, "bytes": self._raw}
                frame: Union[str, bytes] = cbor({"op": "publish", "topic": self.topic, "msg": msg})
            else:
                topic = json.dumps(self.topic)
                frame = f'{{"op": "publish", "topic": {topic}, "msg": {self._to_json(self._raw)}}}'
            self._frames[compression] = frame
        return self._frames[compression]


def cbor(value: Union[int, str, bytes, Dict[str, Any]]) -> bytes:
    """Return a value in the format CBOR (RFC 8949); integers must be from 0 to 2^64 - 1.

    Not with python3-cbor: rosdep does not know it, so ROS Noetic could not install it.
    """
    if isinstance(value, int):
        return _cbor_head(0, value)
    if isinstance(value, bytes):
        return _cbor_head(2, len(value)) + value
    if isinstance(value, str):
        return _cbor_head(3, len(value.encode())) + value.encode()
    items = (cbor(name) + cbor(each) for name, each in value.items())
    return _cbor_head(5, len(value)) + b"".join(items)


def _cbor_head(kind: int, number: int) -> bytes:
    """Return the first bytes of an item of a major type, with its value or length."""
    if number < 24:
        return bytes([kind << 5 | number])
    for extra, (code, limit) in enumerate((("B", 1 << 8), ("H", 1 << 16), ("I", 1 << 32))):
        if number < limit:
            return bytes([kind << 5 | 24 + extra]) + struct.pack(f">{code}", number)
    return bytes([kind << 5 | 27]) + struct.pack(">Q", number)
