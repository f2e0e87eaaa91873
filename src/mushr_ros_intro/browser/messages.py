"""Convert ROS messages to JSON and back, as rosbridge does.

Binary data is base64 text. Floats that are not finite become null. A time has the fields of ROS 1
(secs, nsecs) and those of Foxglove's clients (sec, nsec).
"""

import base64
import io
import json
import math
import struct
from typing import Any, Callable, Dict, Type

import genpy
import roslib.message
import rospy
from genpy.base import SIMPLE_TYPES_DICT

from mushr_ros_intro.ros.conversions import MessageError

_SECONDS = {"sec": "secs", "nsec": "nsecs", "nanosec": "nsecs"}
"""Other names of the fields of a time."""


def message_class(type_name: str) -> Type[genpy.Message]:
    """Return the class of a message type.

    Raises:
        MessageError: this machine has no such type.
    """
    try:
        found = roslib.message.get_message_class(type_name)
    except (ValueError, ImportError):
        found = None
    if found is None:
        raise MessageError(f"type {type_name!r} is not known; expected one like std_msgs/String")
    return found


def decoder(type_name: str) -> Callable[[bytes], str]:
    """Return the function from a message as ROS transmits it to its JSON text.

    The function raises a MessageError if the message is not of the type, or if this machine has no
    such type.
    """

    def decode(raw: bytes) -> str:
        msg = message_class(type_name)()
        try:
            return json.dumps(to_values(msg.deserialize(raw)))
        except (genpy.DeserializationError, UnicodeDecodeError) as error:
            raise MessageError(f"a message is not a {type_name}: {error}") from None

    return decode


def to_values(value: Any) -> Any:
    """Return a field or a message as a value that JSON has."""
    if isinstance(value, genpy.Message):
        return {name: to_values(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, genpy.TVal):
        secs, nsecs = value.secs, value.nsecs
        return {"secs": secs, "nsecs": nsecs, "sec": secs, "nsec": nsecs}
    if isinstance(value, (list, tuple)):
        if value and isinstance(value[0], int):
            return value  # quickly, because a map has millions
        return [to_values(each) for each in value]
    if isinstance(value, dict):  # of the parameter server
        return {name: to_values(each) for name, each in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


def from_values(kind: Type[genpy.Message], values: Dict[str, Any]) -> genpy.Message:
    """Return the message of a type with the fields in `values`; others have their defaults.

    A header without a stamp gets the current time.

    Raises:
        MessageError: a field is unknown, or its value is of another type or out of range.
    """
    msg = kind()
    header = values.get("header")
    if "header" in msg.__slots__ and (header is None or isinstance(header, dict)):
        values = {**values, "header": {"stamp": _now(), **(header or {})}}
    try:
        genpy.message.fill_message_args(msg, [_with_ros_times(values)])
        _check_numbers(msg, "")
        msg.serialize(io.BytesIO())
    except (genpy.MessageException, ValueError, TypeError, AttributeError, OverflowError) as error:
        text = str(error).split("\n", maxsplit=1)[0]
        raise MessageError(f"not a {msg._type}: {text}") from None
    return msg


def _check_numbers(msg: genpy.Message, prefix: str) -> None:
    """Raise a ValueError if a field, or an element of an array, is not a number of its type.

    genpy's own check depends on its version, and does not always name the field.
    """
    for name, slot_type in zip(msg.__slots__, msg._slot_types):
        value = getattr(msg, name)
        is_array = isinstance(value, (list, tuple))
        base = slot_type.partition("[")[0]
        for number, each in enumerate(value if is_array else [value]):
            path = f"{prefix}{name}[{number}]" if is_array else f"{prefix}{name}"
            if isinstance(each, genpy.Message):
                _check_numbers(each, f"{path}.")
            elif isinstance(each, genpy.TVal):
                kind = "int32" if base == "duration" else "uint32"
                for part in ("secs", "nsecs"):
                    _check_number(getattr(each, part), kind, f"{path}.{part}")
            elif base in SIMPLE_TYPES_DICT and not isinstance(each, bytes):
                _check_number(each, base, path)


def _check_number(value: Any, kind: str, path: str) -> None:
    """Raise a ValueError if a value is not a number, or a Boolean, of a simple type of ROS."""
    try:
        is_valid = isinstance(value, bool) == (kind == "bool")
        struct.pack(SIMPLE_TYPES_DICT[kind], value)
    except (struct.error, OverflowError):
        is_valid = False
    if not is_valid:
        raise ValueError(f"{path} is {value!r:.40}; expected {kind}")


def _now() -> Dict[str, int]:
    time = rospy.get_rostime()
    return {"secs": time.secs, "nsecs": time.nsecs}


def _with_ros_times(value: Any) -> Any:
    """Return values with the names of ROS 1 for the fields of times."""
    if isinstance(value, list):
        return [_with_ros_times(each) for each in value]
    if not isinstance(value, dict):
        return value
    if value and set(value) <= {"secs", "nsecs", *_SECONDS}:
        return {_SECONDS.get(name, name): each for name, each in value.items()}
    return {name: _with_ros_times(each) for name, each in value.items()}
