"""Recognise common mistakes in what a node sends."""

import math
import os
import re
from typing import Mapping, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.geometry import Pose

_SAME = 1e-4
"""Relative difference between commands that count as equal; a node may compute in float32."""


INITIAL_POSES = "/initialpose"
"""The topic of the start pose."""

POSE_TYPE = "geometry_msgs/PoseWithCovarianceStamped"
"""The type of the messages on INITIAL_POSES."""

COMMAND_TYPE = "ackermann_msgs/AckermannDriveStamped"
"""The type of the commands."""


_TRACEBACK = re.compile(
    r"^Traceback \(most recent call last\):\n(?:[ \t].*\n)*"
    r'  File "(.*)", line (\d+).*\n(?:[ \t].*\n)*(\S.*)',
    re.MULTILINE,
)


MAX_ERROR = 200
"""Limit of the length of an exception in a message."""


def printed_error(output: str) -> str:
    """Return the last exception in the output of a node, and its place; "" if there is none.

    rospy prints an exception in a callback, and Python one in a thread. The node keeps running.
    """
    for path, line, error in _TRACEBACK.findall(output)[-1:]:
        return f"{error[:MAX_ERROR]} ({os.path.basename(path)}, line {line})"
    return ""


def topic_mistake(topics: Mapping[str, str], topic: str, kind: str) -> str:
    """Return what a node did instead of publishing messages of a type on a topic; "" if it did.

    Args:
        topics: the types of the topics on which it has published, by topic.
        topic: the right topic.
        kind: the right type.
    """
    if topic not in topics:
        others = ", ".join(sorted({*topics} - {"/rosout"})) or "nothing"
        only = "only this node is run, no other node of a launch file"
        return f"does not publish {topic} ({only}); it publishes {others}"
    if topics[topic] != kind:
        return f"publishes {topics[topic]} on {topic}, not {kind}"
    return ""


def command_topic_mistake(topics: Mapping[str, str], control: str, has_start: bool) -> str:
    """Return what a node did instead of sending commands.

    Args:
        topics: as for `topic_mistake`.
        control: the topic of the commands.
        has_start: whether it has sent a start pose, or needs none.
    """
    if mistake := topic_mistake(topics, control, COMMAND_TYPE):
        return mistake
    text = "has a publisher for this topic, but no message arrived"
    start = "" if has_start else topic_mistake(topics, INITIAL_POSES, POSE_TYPE)
    if start:
        return f"{text}; it {start}: does it wait for a subscriber there?"
    return f"{text}: does it call publish?"


def start_mistake(sent: Pose, wanted: Pose, tolerance: float) -> str:
    """Return a sentence about a common mistake that explains a start pose, if there is one.

    Args:
        sent: the start pose of the node.
        wanted: that of the plan.
        tolerance: of their comparison [m, rad].
    """
    guesses = {
        "x and y are swapped": wanted._replace(x=wanted.y, y=wanted.x),
        "theta is in degrees; expected radians": wanted._replace(theta=math.degrees(wanted.theta)),
        "theta is converted from degrees; that of the plan is in radians": wanted._replace(
            theta=math.radians(wanted.theta)
        ),
        "theta itself is z of the quaternion; expected sin(theta / 2)": wanted._replace(
            theta=2.0 * math.atan(wanted.theta)
        ),
        "theta has the wrong sign": wanted._replace(theta=-wanted.theta),
        "theta is not used, or does not turn the car about the z axis": wanted._replace(theta=0.0),
    }
    close = [text for text, pose in guesses.items() if sent.is_close_to(pose, tolerance)]
    return "".join(f". Perhaps {text}" for text in close[:1])


def command_mistake(
    got: Sequence[Tuple[float, ...]], wanted: Sequence[Tuple[float, ...]], start: Pose
) -> str:
    """Return a sentence about a common mistake that explains all commands, if there is one.

    Args:
        got: the commands of the node.
        wanted: those of the plan.
        start: its start pose.
    """
    if got[1 : len(wanted) + 1] == wanted and np.allclose(got[0], start[:2], rtol=_SAME):
        return ". The first command is the start pose, which is the first line of the plan"
    if [command[::-1] for command in got] == list(wanted):
        return ". Speed and steering angle are swapped in all commands"
    if any(speed for speed, _ in wanted) and not any(speed for speed, _ in got):
        return ". All speeds are 0"
    if len(got) == len(wanted):
        (speeds, angles), (right_speeds, right_angles) = zip(*got), zip(*wanted)
        speed, angle = _factor(speeds, right_speeds), _factor(angles, right_angles)
        if speed is not None and angle is not None:
            mistakes = []
            if abs(speed - 1.0) > _SAME:
                mistakes.append(f"All speeds are {speed:.4g} times those of the plan")
            if abs(angle + 1.0) < _SAME:
                is_reversed = list(got[::-1]) == list(wanted)
                other = ", or the rows are in reverse order" if is_reversed else ""
                sign = "All steering angles have the wrong sign; positive turns left"
                mistakes.append(sign + other)
            elif abs(angle / math.degrees(1.0) - 1.0) < _SAME:
                mistakes.append("All steering angles are in degrees; expected radians")
            elif abs(angle / math.radians(1.0) - 1.0) < _SAME:
                mistakes.append(
                    "All steering angles are converted from degrees; those of the plan are radians"
                )
            elif abs(angle - 1.0) > _SAME:
                mistakes.append(f"All steering angles are {angle:.4g} times those of the plan")
            return "".join(f". {mistake}" for mistake in mistakes)
        first = next((i for i, pair in enumerate(zip(got, wanted)) if not np.allclose(*pair)), 0)
        flipped = [(v, -delta) for v, delta in got[first:]]
        if np.allclose(flipped, wanted[first:], rtol=_SAME):
            return ". From this row on, all steering angles have the wrong sign"
    rows = [command for command in got if command[0]]  # without the stop at the end
    if rows and len(rows) < len(wanted):
        if rows == list(wanted[-len(rows) :]):
            return ". The first rows are missing"
        if rows == list(wanted[: len(rows)]):
            return ". The last rows are missing"
    return ". The rows are in the wrong order" if sorted(got) == sorted(wanted) else ""


def _factor(got: Sequence[float], wanted: Sequence[float]) -> Optional[float]:
    """Return the factor between all numbers of two sequences, or None if there is none."""
    square = float(np.dot(wanted, wanted))
    factor = float(np.dot(got, wanted)) / square if square else 1.0
    is_same = np.allclose(got, factor * np.array(wanted), rtol=_SAME, atol=0.0)
    return factor if is_same else None
