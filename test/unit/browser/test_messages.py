"""Check the conversion of messages to JSON and back."""

import io
import json
import math

import pytest
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CompressedImage, LaserScan

from mushr_ros_intro.browser import messages
from mushr_ros_intro.ros.conversions import MessageError

NOW = {"secs": 7, "nsecs": 5}


@pytest.fixture(autouse=True)
def _time(monkeypatch):
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(7, 5))


def decoded(msg):
    buffer = io.BytesIO()
    msg.serialize(buffer)
    return json.loads(messages.decoder(msg._type)(buffer.getvalue()))


def encoded(values):
    return messages.from_values(PoseWithCovarianceStamped, values)


def test_a_message_and_back():
    values = {
        "header": {"seq": 3, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "map"},
        "pose": {
            "pose": {
                "position": {"x": 1.5, "y": -2, "z": 0},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
            "covariance": [0.25] * 36,
        },
    }
    answer = decoded(encoded(values))
    stamp = answer["header"]["stamp"]
    assert (stamp.pop("sec"), stamp.pop("nsec")) == (1, 2)
    assert answer == values


def test_values_that_json_does_not_have():
    scan = decoded(LaserScan(ranges=[1.0, math.inf, -math.inf, math.nan], range_max=math.inf))
    assert scan["ranges"] == [1.0, None, None, None]
    assert scan["range_max"] is None
    assert decoded(CompressedImage(data=b"\x00\xff"))["data"] == "AP8="


@pytest.mark.parametrize(
    ("header", "stamp"),
    [
        (None, NOW),
        ({"frame_id": "map"}, NOW),
        ({"stamp": {"sec": 1, "nanosec": 2}}, {"secs": 1, "nsecs": 2}),
        ({"stamp": {"secs": 0, "nsecs": 0}}, {"secs": 0, "nsecs": 0}),
    ],
)
def test_stamps(header, stamp):
    got = encoded({"header": header} if header else {}).header.stamp
    assert stamp == {"secs": got.secs, "nsecs": got.nsecs}


def at_x(value):
    return {"pose": {"pose": {"position": {"x": value}}}}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"data": 1}, "No field name [data]"),
        ({"header": 3}, "invalid msg_args type: 3"),
        ({"header": {"seq": -1}}, "header.seq is -1; expected uint32"),
        ({"header": {"seq": 1.5}}, "header.seq is 1.5; expected uint32"),
        ({"header": {"frame_id": 5}}, "field header.frame_id must be of type bytes or"),
        ({"header": {"stamp": "now"}}, "No key named [now]"),
        ({"header": {"stamp": {"secs": -5}}}, "header.stamp.secs is -5; expected uint32"),
        ({"header": {"stamp": {"nsecs": "5"}}}, "header.stamp.nsecs is '5'; expected uint32"),
        ({"pose": {"covariance": [1]}}, "Field [pose.covariance] has incorrect number of"),
        (at_x("1"), "pose.pose.position.x is '1'; expected float64"),
        (at_x(None), "pose.pose.position.x is ''; expected float64"),
        (at_x(True), "pose.pose.position.x is True; expected float64"),
        (at_x(10**400), "pose.pose.position.x is 1000"),
        (
            {"pose": {"covariance": [0.0] * 7 + ["a"] + [0.0] * 28}},
            "pose.covariance[7] is 'a'; expected float64",
        ),
    ],
)
def test_wrong_messages(values, message):
    with pytest.raises(MessageError) as caught:
        encoded(values)
    expected = f"not a geometry_msgs/PoseWithCovarianceStamped: {message}"
    assert str(caught.value).startswith(expected)


@pytest.mark.parametrize(
    "name", ["nothing_msgs/Pose", "geometry_msgs/Nothing", "Pose", "", "a/b/c"]
)
def test_unknown_types(name):
    with pytest.raises(MessageError, match="is not known; expected one like std_msgs/String"):
        messages.message_class(name)


def test_a_message_of_another_type():
    with pytest.raises(MessageError, match="a message is not a geometry_msgs/PoseStamped"):
        messages.decoder("geometry_msgs/PoseStamped")(b"\1\2")
