"""Record a drive in a bag, and read it from there."""

import contextlib
import io
import os
import subprocess
import sys
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

import rosbag
import roslib.packages
import rospkg
import rospy
import tf2_py
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import TransformStamped

from mushr_ros_intro.comparison.drive_log import DriveLog, Received, drive_log
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose, drive_arc
from mushr_ros_intro.ros import conversions

_POSES: Dict[str, Callable[[Any], Any]] = {
    "geometry_msgs/PoseStamped": lambda msg: msg.pose,
    "geometry_msgs/PoseWithCovarianceStamped": lambda msg: msg.pose.pose,
    "nav_msgs/Odometry": lambda msg: msg.pose.pose,
}
"""The types of messages with a pose, and how to get it."""

_COMMAND = "ackermann_msgs/AckermannDriveStamped"

_CACHE = rospy.Duration(1e9)
"""Transforms are kept for the whole bag."""

TF_TOPICS = ("/tf", "/tf_static")


class Source(NamedTuple):
    """Where the commands and the poses of a drive are."""

    commands: str
    """The topic of the commands that reached the car."""
    pose: str
    """The topic of the poses; not used with `frames`."""
    frames: Optional[Tuple[str, str]] = None
    """The pose is that of the second frame in the first one, from /tf."""
    pose_offset: float = 0.0
    """Distance of the point whose pose is reported, in front of the rear axle [m]."""

    @property
    def topics(self) -> Tuple[str, ...]:
        """The topics that are read."""
        return (self.commands, *(TF_TOPICS if self.frames else (self.pose,)))


def record(path: str, source: Source, seconds: float) -> None:
    """Record the topics of a drive into a new bag, until `seconds` have passed or Ctrl-C.

    Raises:
        UserError: the bag cannot be written.
    """
    try:
        open(path, "x").close()
        os.remove(path)
    except OSError as error:
        text = f"{path} cannot be written ({error.strerror}); expected the name of a new bag"
        raise UserError(f"--record: {text}") from None
    programs: Sequence[str] = ()
    with contextlib.suppress(rospkg.ResourceNotFound):
        programs = roslib.packages.find_node("rosbag", "record")
    if len(programs) != 1:
        found = ", ".join(programs) or "none"
        text = f"ROS finds {found} as the program record of rosbag; expected one"
        raise UserError(f"--record: {text}. Is the package rosbag installed?")
    (program,) = programs
    options = ["--output-name", path, "--duration", str(seconds)]
    process = subprocess.Popen([program, *options, *source.topics], stdout=sys.stderr)
    with contextlib.suppress(KeyboardInterrupt):  # it also ends the recording
        process.wait()
    if process.wait():
        raise UserError(f"--record: rosbag record failed, exit status {process.returncode}")


def read_bag(path: str, source: Source, timeout: int) -> DriveLog:
    """Return the drive in a bag; `timeout` is how long the car follows a command [ns].

    Raises:
        UserError: the bag cannot be read, or has no such drive.
    """
    try:
        with rosbag.Bag(path) as bag:
            topics = bag.get_type_and_topic_info().topics
            types = {topic: info.msg_type for topic, info in topics.items()}
            messages = [
                (topic, msg, arrival.to_nsec())
                for topic, msg, arrival in bag.read_messages(topics=source.topics)
            ]
    except OSError as error:
        reason = error.strerror or "it ends too early"
        raise UserError(f"{path}: the bag cannot be read ({reason}); expected a bag") from None
    except rosbag.ROSBagUnindexedException:
        text = "the bag has no index, because its recording did not end; run rosbag reindex first"
        raise UserError(f"{path}: {text}") from None
    except Exception as problem:  # a damaged bag makes rosbag raise errors of many classes
        reason = " ".join(f"{type(problem).__name__}: {problem}".split())[:200]
        text = f"the bag cannot be read ({reason}); expected a bag that rosbag play can play"
        raise UserError(f"{path}: {text}") from None
    commands = _commands(path, source.commands, types, messages)
    if source.frames:
        poses = _transforms(path, source.frames, messages)
    else:
        poses = _poses(path, source.pose, types, messages)
    values = [drive_arc(Pose(*each), -source.pose_offset, 0.0) for each in poses.values]
    return drive_log(path, commands, poses._replace(values=values), timeout)


def _check_type(path: str, topic: str, types: Dict[str, str], known: List[str], what: str) -> None:
    """Raise a UserError if a topic is not in the bag, or has no messages of the known types."""
    if types.get(topic) in known:
        return
    found = f"is of the type {types[topic]}" if topic in types else "is not in the bag"
    others = [f"{other} ({kind})" for other, kind in sorted(types.items()) if kind in known]
    raise UserError(
        f"{path}: the topic {topic} {found}; expected one with {what}. The bag has "
        f"{', '.join(others) or 'none'}"
    )


def _received(topic: str, messages: List[Any], get: Callable[[Any], Any]) -> Received:
    """Return the messages of a topic; those that cannot be used are ignored."""
    arrivals, stamps, values, ignored = [], [], [], []
    for msg, arrival in ((msg, arrival) for each, msg, arrival in messages if each == topic):
        try:
            values.append(get(msg))
        except conversions.MessageError as error:
            ignored.append(str(error))
        else:
            arrivals.append(arrival)
            stamps.append(msg.header.stamp.to_nsec())
    return Received(topic, arrivals, stamps, values, tuple(ignored))


def _commands(path: str, topic: str, types: Dict[str, str], messages: List[Any]) -> Received:
    """Return the commands; see `read_bag`."""
    _check_type(path, topic, types, [_COMMAND], "commands")

    def get(msg: Any) -> Tuple[float, float]:
        command = conversions.command_from_msg(msg)
        return command.speed, command.steering_angle

    return _received(topic, messages, get)


def _poses(path: str, topic: str, types: Dict[str, str], messages: List[Any]) -> Received:
    """Return the poses of a topic; see `read_bag`."""
    _check_type(path, topic, types, list(_POSES), "poses")
    part = _POSES[types[topic]]
    return _received(topic, messages, lambda msg: conversions.pose_from_msg(part(msg)))


def _own_transform(msg: Any) -> TransformStamped:
    """Return a transform that tf2 accepts; a bag has classes of its own."""
    buffer = io.BytesIO()
    msg.serialize(buffer)
    own = TransformStamped().deserialize(buffer.getvalue())
    own.header.frame_id = own.header.frame_id.lstrip("/")
    own.child_frame_id = own.child_frame_id.lstrip("/")
    return own


def _transforms(path: str, frames: Tuple[str, str], messages: List[Any]) -> Received:
    """Return the poses of the second frame in the first one, one for each message on /tf."""
    parent, child = (frame.lstrip("/") for frame in frames)
    buffer = tf2_py.BufferCore(_CACHE)
    arrivals: List[int] = []
    stamps: List[int] = []
    values: List[Pose] = []
    ignored: List[str] = []
    for topic, msg, arrival in messages:
        if topic not in TF_TOPICS:
            continue
        set_one = buffer.set_transform_static if topic == TF_TOPICS[1] else buffer.set_transform
        for each in msg.transforms:
            set_one(_own_transform(each), "bag")
        try:
            newest = buffer.lookup_transform_core(parent, child, rospy.Time())
        except tf2_py.TransformException as error:
            ignored.append(str(error))
            continue
        stamp = newest.header.stamp.to_nsec()
        if not stamps or stamp > stamps[-1]:
            pose = conversions.pose_from_msg(
                PoseMsg(newest.transform.translation, newest.transform.rotation)
            )
            arrivals.append(arrival)
            stamps.append(stamp)
            values.append(pose)
    if not values:
        reason = f" ({ignored[-1]})" if ignored else ""
        raise UserError(
            f"{path}: /tf has no transform from {parent} to {child}{reason}; expected the frames "
            "of the map and of the car"
        )
    return Received(f"/tf from {parent} to {child}", arrivals, stamps, values)
