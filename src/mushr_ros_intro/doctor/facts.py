"""Facts about a running system that the doctor judges, and the findings that it reports."""

from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Tuple

from mushr_ros_intro.ros.xmlrpc_client import CallFault
from mushr_ros_intro.simulator.mux import IDLE

MANUAL_INPUTS = ("safety", "teleop")
"""The inputs of the mux for people. The nodes that publish there are silent most of the time."""


class Finding(NamedTuple):
    """A fault, and how to repair it."""

    problem: str
    """A sentence without its full stop."""
    remedy: str
    """A sentence without its full stop, with the command to type at its end."""

    def __str__(self) -> str:
        return f"{self.problem}. {self.remedy}"


class Master(NamedTuple):
    """The master at ROS_MASTER_URI."""

    uri: str
    fault: Optional[CallFault] = None
    is_local: bool = True
    """Whether its address is one of this machine."""
    other: str = ""
    """The address of another master that runs on this machine."""


class Publisher(NamedTuple):
    """A node that publishes a topic, and what was received from it."""

    node: str
    msg_type: str = ""
    """Such as std_msgs/String; empty if the doctor did not connect."""
    stamps: Tuple[int, ...] = ()
    """Of its commands [ns]."""
    speeds: Tuple[float, ...] = ()
    """Of its commands [m/s]."""
    steering_angles: Tuple[float, ...] = ()
    """Of its commands [rad]."""
    arrivals: Tuple[int, ...] = ()
    """When its commands arrived [ns of this machine's clock]."""

    @property
    def shortest_gap(self) -> int:
        """The shortest time between two of its commands [ns]; 0 if fewer than two are known."""
        instants = sorted(self.stamps if all(self.stamps) else self.arrivals)
        return min((later - one for one, later in zip(instants, instants[1:])), default=0)


class Topic(NamedTuple):
    """A topic of commands or of initial poses."""

    name: str
    msg_type: str
    """The type that the subscribers expect."""
    publishers: Tuple[Publisher, ...] = ()
    subscribers: Tuple[str, ...] = ()

    @property
    def senders(self) -> List[Publisher]:
        """The publishers from which commands were received."""
        return [each for each in self.publishers if each.stamps]


class Clock(NamedTuple):
    """The simulated time."""

    publishers: Tuple[str, ...] = ()
    """The nodes that publish /clock."""
    window: Optional[Tuple[int, int]] = None
    """The first and the last time that was received on /clock [ns]; None if there was none."""
    resume_service: str = ""
    """The service that resumes a paused clock; empty if there is none."""

    @property
    def advances(self) -> bool:
        """Whether the time changed."""
        return self.window is not None and self.window[0] < self.window[1]


@dataclass(frozen=True)
class Facts:
    """The observed state of the system around one car."""

    car: str
    master: Master
    inputs: Dict[str, Topic] = field(default_factory=dict)
    """The inputs of the mux by name in lower case, by falling priority.

    The first one, "output", is the mux's output with the publishers that bypass the mux.
    """
    output: Topic = Topic("", "")
    """The commands from the mux to the car."""
    initial_pose: Topic = Topic("", "")
    dead: Dict[str, CallFault] = field(default_factory=dict)
    """The registered nodes that cannot be reached."""
    strays: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    """The publishers of each other topic of commands that has no subscriber.

    None if they have ended, which is known of topics with a name like that of an input.
    """
    stray_poses: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    """The same for topics of initial poses; only those whose name is like that of the car's."""
    unpublished: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    """The subscribers of each topic of the car that no node publishes."""
    left_parameters: Dict[str, Dict[str, Any]] = field(default_factory=dict)
    """By node: the parameters of a node started by hand that are not in its command line."""
    mistyped: Dict[str, Dict[str, str]] = field(default_factory=dict)
    """By node: the arguments NAME:=VALUE with the name of such a parameter."""
    other_cars: Tuple[str, ...] = ()
    """The names of the other cars that run."""
    active: str = IDLE
    """The input that the mux forwards."""
    clock: Optional[Clock] = None
    """None in wall-clock time."""
    pose_publishers: Tuple[str, ...] = ()
    """The nodes that report the pose of the car."""
    contact: str = ""
    """The pose at which the car touches a wall."""
    moves: Optional[bool] = None
    """Whether the pose changed; None if none is published."""
    verdict: str = ""
    """How the last drive of a plan ended, as drive_monitor.py publishes it."""

    @property
    def senders(self) -> List[Publisher]:
        """The publishers from which commands were received.

        Without those that send only stops on the input `default`, as in MuSHR.
        """
        return [
            each
            for name, topic in self.inputs.items()
            for each in topic.senders
            if name != "default" or any(each.speeds)
        ]

    @property
    def manual_senders(self) -> List[Publisher]:
        """The publishers by which people drive and from which commands were received."""
        topics = (self.inputs[each] for each in MANUAL_INPUTS if each in self.inputs)
        return [each for topic in topics for each in topic.senders]

    @property
    def control_topic(self) -> str:
        """The topic for a plan's commands: the input navigation, or else the first input."""
        topics = {name: each.name for name, each in self.inputs.items()}
        return topics.get("navigation", next(iter(topics.values()), self.output.name))

    @property
    def car_argument(self) -> str:
        """The argument of the launch files that names the car."""
        return "" if self.car == "car" else f" car_name:={self.car}"


def names(publishers: Iterable[Publisher], separator: str = " and ") -> str:
    """Return the names of nodes as text, each once."""
    return listed((each.node for each in publishers), separator)


def listed(words: Iterable[str], separator: str = " and ") -> str:
    """Return names as text, each once."""
    return separator.join(dict.fromkeys(words))
