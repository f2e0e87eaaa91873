"""Facts about a running system, as the doctor sees them."""

from dataclasses import dataclass
from typing import List, NamedTuple, Optional, Tuple

from mushr_ros_intro.sim.mux import IDLE

USUAL_MASTER = "http://localhost:11311"
"""Where a master runs, and is looked for, if nobody says otherwise."""


class Finding(NamedTuple):
    """Something that is wrong."""

    what: str
    """What it is, as a sentence without its full stop."""
    remedy: str
    """What to do or to type about it, likewise; what is to be typed is at its end."""

    def __str__(self) -> str:
        return f"{self.what}. {self.remedy}"


class Master(NamedTuple):
    """The master that ROS_MASTER_URI names."""

    uri: str
    trouble: str = ""
    """Why it cannot be used, such as "nothing answers there"; empty if it can."""
    is_here: bool = True
    """Whether that is this machine."""
    other: str = ""
    """Another master that runs on this machine, in the usual place."""


MALFORMED = "that is no address; it should look like http://localhost:11311"
NO_MASTER = "no master answers there"
SILENT_MASTER = "the master there does not answer: it is stopped"
NO_ROS = "what answers there does not speak ROS"

REFUSED = "nothing answers at its address: it has died"
STOPPED = "it does not answer: it is stopped, or its machine is out of reach"
UNKNOWN_HOST = "this machine does not know the name of the machine it is on"


class Source(NamedTuple):
    """A node that publishes commands or start poses, and what was heard from it."""

    node: str
    kind: str = ""
    """The type of its messages, such as std_msgs/String; empty if it was not listened to."""
    md5sum: str = ""
    """The sum of that type's definition."""
    stamps: Tuple[int, ...] = ()
    """Of its commands [ns]."""
    speeds: Tuple[float, ...] = ()
    """In its commands [m/s]."""


class Topic(NamedTuple):
    """A topic that leads to the car."""

    name: str
    kind: str
    """The type that the car and the mux expect."""
    md5sum: str
    """The sum of that type's definition."""
    sources: Tuple[Source, ...] = ()
    subscribers: Tuple[str, ...] = ()


class Input(NamedTuple):
    """A topic for commands: one of the mux's inputs, or its output for who goes past it."""

    name: str
    topic: Topic

    @property
    def senders(self) -> List[Source]:
        """The nodes from which commands were heard."""
        return [each for each in self.topic.sources if each.stamps]


class Clock(NamedTuple):
    """The simulated time."""

    sources: Tuple[str, ...] = ()
    """The nodes that publish /clock."""
    moves: bool = False
    """Whether it advanced while it was listened to."""
    resume: str = ""
    """The service that lets a held clock go, if there is one."""


@dataclass(frozen=True)
class Facts:
    """What is to be seen of a running system, for one car."""

    car: str
    master: Master
    faults: Tuple[Finding, ...] = ()
    """What is wrong on this machine alone: files, paths, network names."""
    inputs: Tuple[Input, ...] = ()
    """By falling priority."""
    output: Topic = Topic("", "", "")
    """Where the mux publishes and the car listens."""
    placement: Topic = Topic("", "", "")
    """Where the car is placed."""
    dead: Tuple[Tuple[str, str], ...] = ()
    """Each node that is registered but cannot be reached, and REFUSED, STOPPED or UNKNOWN_HOST."""
    strays: Tuple[Tuple[str, Tuple[str, ...]], ...] = ()
    """Each other topic of commands without a subscriber, and who publishes there."""
    other_cars: Tuple[str, ...] = ()
    active: str = IDLE
    """The input that the mux listens to."""
    clock: Optional[Clock] = None
    """None in wall-clock time."""
    now: Optional[Tuple[int, int]] = None
    """When the listening began and ended, by the clock that the nodes go by [ns]."""
    listened: float = 0.0
    """How long that was [s]."""
    contact: str = ""
    """Where the car stands against a wall."""
    pose: str = ""
    """Where the car is, if it reports that."""
    moves: Optional[bool] = None
    """Whether its pose changed; None if it reports none."""
