"""Read a drive from a bag."""

from typing import Any, Callable, Dict, List, Tuple

import rosbag

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


def read_bag(path: str, commands: str, pose: str, pose_offset: float, timeout: int) -> DriveLog:
    """Return the drive in a bag.

    Args:
        path: of the bag.
        commands: the topic of the commands that reached the car.
        pose: the topic of the poses.
        pose_offset: distance of the reported point in front of the rear axle [m].
        timeout: how long the car follows a command [ns].

    Raises:
        UserError: the bag cannot be read, or has no such drive.
    """
    try:
        with rosbag.Bag(path) as bag:
            topics = bag.get_type_and_topic_info().topics
            types = {topic: info.msg_type for topic, info in topics.items()}
            messages = [
                (topic, msg, arrival.to_nsec())
                for topic, msg, arrival in bag.read_messages(topics=(commands, pose))
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
    _check_type(path, commands, types, [_COMMAND], "commands")
    _check_type(path, pose, types, list(_POSES), "poses")
    part = _POSES[types[pose]]
    sent = _received(commands, messages, _speed_and_angle)
    poses = _received(pose, messages, lambda msg: conversions.pose_from_msg(part(msg)))
    values = [drive_arc(Pose(*each), -pose_offset, 0.0) for each in poses.values]
    return drive_log(path, sent, poses._replace(values=values), timeout)


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


def _speed_and_angle(msg: Any) -> Tuple[float, float]:
    command = conversions.command_from_msg(msg)
    return command.speed, command.steering_angle
