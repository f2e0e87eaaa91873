"""Check how requests are read, and how frames are written."""

import json
from contextlib import suppress

import pytest
from geometry_msgs.msg import PoseWithCovariance
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.browser.messages import MessageError, from_values
from mushr_ros_intro.browser.protocol import (
    Message,
    ProtocolError,
    Request,
    cbor,
    read_request,
    response,
    status,
)

CALL = {"op": "call_service", "service": "/s"}
PUBLISH = Request("publish", 7, "/a", msg={"data": 1})


@pytest.mark.parametrize(
    ("values", "request_"),
    [
        ({"op": "subscribe", "topic": "/a"}, Request("subscribe", topic="/a")),
        (
            {
                **{"op": "subscribe", "id": "x:1", "topic": "/a", "type": None, "fragment_size": 9},
                **{"throttle_rate": 50, "queue_length": 3, "compression": "cbor-raw"},
            },
            Request(
                "subscribe", "x:1", "/a", throttle_rate=50, queue_length=3, compression="cbor-raw"
            ),
        ),
        (
            {"op": "subscribe", "topic": "/a", "compression": "png"},
            Request("subscribe", topic="/a"),
        ),
        ({"op": "publish", "id": 7, "topic": "/a", "latch": False, "msg": {"data": 1}}, PUBLISH),
        ({**CALL, "args": ["a"]}, Request("call_service", service="/s", args=["a"])),
        (
            {**CALL, "id": {}, "args": {"a": 1}},
            Request("call_service", service="/s", args={"a": 1}),
        ),
    ],
)
def test_requests(values, request_):
    assert read_request(json.dumps(values)) == request_


RATE = "subscribe: throttle_rate"


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ("{", "the frame is not JSON: "),
        (b"\xff\xfe", "the frame is not JSON: "),
        ("[" * 100_000, "the frame is not JSON: "),
        ('{"op": "publish", "msg": {"x": NaN}}', "the frame is not JSON: NaN is not a number of"),
        ("7", "op is missing; expected one of advertise, "),
        ('{"op": ["publish"]}', 'op is ["publish"]; expected one of '),
        ('{"op": "fragment"}', 'op is "fragment"; expected one of '),
        ('{"op": "subscribe"}', "subscribe: topic is missing; expected text"),
        ('{"op": "subscribe", "topic": ""}', 'subscribe: topic is ""; expected text'),
        ('{"op": "publish", "topic": "/a", "msg": [1]}', "publish: msg is [1]; expected an object"),
        (
            '{"op": "subscribe", "topic": "/a", "throttle_rate": -1}',
            f"{RATE} is -1; expected a num",
        ),
        ('{"op": "subscribe", "topic": "/a", "throttle_rate": true}', f"{RATE} is true; expected"),
        (json.dumps({**CALL, "args": 1}), "call_service: args is 1; expected an object or a list"),
        (json.dumps({"op": "a" * 1000}), f'op is "{"a" * 76}...; expected one of '),
    ],
)
def test_faults(frame, message):
    with pytest.raises(ProtocolError) as caught:
        read_request(frame)
    assert str(caught.value).startswith(message)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda some: st.lists(some) | st.dictionaries(st.sampled_from(("pose", "position", "x")), some),
)
FIELDS = ("id", "topic", "type", "msg", "service", "args", "throttle_rate", "queue_length", "latch")
FRAMES = st.fixed_dictionaries(
    {"op": st.sampled_from(("advertise", "publish", "subscribe", "call_service")) | JSON},
    optional=dict.fromkeys(FIELDS, JSON),
)


@given(FRAMES)
def test_any_frame_is_read_or_refused(values):
    with suppress(ProtocolError):
        read_request(json.dumps(values))


@given(st.dictionaries(st.sampled_from(("pose", "covariance")), JSON))
def test_any_values_are_a_message_or_refused(values):
    with suppress(MessageError):
        from_values(PoseWithCovariance, values)


def test_replies():
    assert json.loads(status("no", None)) == {"op": "status", "level": "error", "msg": "no"}
    assert json.loads(status("no", "x"))["id"] == "x"
    answer = json.loads(response(Request("call_service", 7, service="/s"), "no", result=False))
    expected = {"op": "service_response", "service": "/s", "values": "no", "result": False, "id": 7}
    assert answer == expected


def test_a_message_is_encoded_once():
    calls = []
    message = Message('/a"', b"raw", lambda raw: calls.append(raw) or '{"data": 1}', 3_000_000_005)
    for _ in range(2):
        frame = json.loads(message.frame("none"))
        assert frame == {"op": "publish", "topic": '/a"', "msg": {"data": 1}}
    assert calls == [b"raw"]
    assert message.frame("cbor-raw") == cbor(
        {"op": "publish", "topic": '/a"', "msg": {"secs": 3, "nsecs": 5, "bytes": b"raw"}}
    )


@pytest.mark.parametrize(
    ("value", "encoded"),
    [  # RFC 8949, appendix A, or its rules
        (23, "17"),
        (24, "1818"),
        (1000, "1903e8"),
        (1_000_000, "1a000f4240"),
        (1_000_000_000_000, "1b000000e8d4a51000"),
        (b"\1\2\3\4", "4401020304"),
        ("\u6c34", "63e6b0b4"),
        ({"a": "A", "b": {"c": 1}}, "a26161614161 62a1616301"),
        (b"\0" * 256, "590100" + "00" * 256),
        (b"\0" * 65_536, "5a00010000" + "00" * 65_536),
    ],
)
def test_cbor(value, encoded):
    assert cbor(value) == bytes.fromhex(encoded)
