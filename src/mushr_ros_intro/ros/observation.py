"""Look at a running system, and return the facts about it."""

import dataclasses
import io
import os
import re
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Set, Tuple
from urllib.parse import urlparse

import rosgraph
import rosgraph.network
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock as ClockMsg
from std_msgs.msg import String

from mushr_ros_intro.doctor import facts as diagnosis
from mushr_ros_intro.doctor.facts import Facts, Finding, Input, Master, Source, Topic
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.connections import (
    CallError,
    NoResponseError,
    NotRosError,
    UnknownHostError,
    ask,
    receivers,
)
from mushr_ros_intro.sim.mux import IDLE, ConfigError, parse_config

CALLER = f"/doctor_{os.getpid()}_{time.time_ns()}"
"""Who we say we are; a publisher drops whom it knows by the same name."""

CALL_PATIENCE = 2.0
"""How long the master or a node may take for an answer [s]."""

LISTENING = 1.5
"""For how long to listen to topics [s]."""

CLOCK_PATIENCE = 5.5
"""How long to wait for a clock to move [s]; in lock-step, it waits for commands for 5 s."""

_INPUTS = ("safety", "teleop", "navigation", "default")
_OWN_TYPE = re.compile(r"our version has \[(.+)/(\w+)\]")  # as publishers say it


class Stream(NamedTuple):
    """What was heard from one publisher of one topic."""

    header: Dict[str, str]
    """Of the connection: the type, its MD5 sum, and so on."""
    messages: List[bytes]
    """As they travel."""


def call(uri: str, method: str, *arguments: Any) -> Any:
    """Call a method of the master or of a node, and return its value.

    Raises:
        CallError: there was no answer, or not the value that was asked for.
    """
    return ask(uri, CALL_PATIENCE, CALLER, method, *arguments)


def at_once(jobs: Sequence[Callable[[], Any]], patience: float) -> List[Any]:
    """Do jobs side by side, and return what each returned; None where it is not done in time.

    Args:
        jobs: functions that raise nothing.
        patience: how long to wait for all of them [s].
    """
    results: List[Any] = [None] * len(jobs)

    def run(index: int) -> None:
        results[index] = jobs[index]()

    threads = [threading.Thread(target=run, args=(each,), daemon=True) for each in range(len(jobs))]
    deadline = time.monotonic() + patience
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    return list(results)


def look_at_master(uri: str) -> Master:
    """See whether a master answers at `uri`."""
    host = port = None
    with suppress(ValueError):
        parsed = urlparse(uri)
        host, port = parsed.hostname, parsed.port
    if not uri.startswith("http://") or not host or not port:
        return Master(uri, diagnosis.MALFORMED)

    def find_addresses() -> List[str]:
        try:
            return [str(each[4][0]) for each in socket.getaddrinfo(host, port)]
        except OSError:
            return []

    (addresses,) = at_once([find_addresses], CALL_PATIENCE)
    here = [*rosgraph.network.get_local_addresses(), "::1"]
    is_here = all(each in here or each.startswith("127.") for each in addresses or [""])
    other = ""
    if not is_here or port != urlparse(diagnosis.USUAL_MASTER).port:
        with suppress(CallError):
            call(diagnosis.USUAL_MASTER, "getPid")
            other = diagnosis.USUAL_MASTER
    if not addresses:
        return Master(uri, f"nobody knows a machine called {host}", is_here, other)
    try:
        call(uri, "getPid")
    except CallError as error:
        if isinstance(error, NotRosError):
            return Master(uri, diagnosis.NO_ROS, is_here, other)
        is_stopped = is_here and isinstance(error, NoResponseError)
        trouble = diagnosis.SILENT_MASTER if is_stopped else diagnosis.NO_MASTER
        return Master(uri, trouble, is_here, other)
    return Master(uri, "", is_here, other)


class Doctor:
    """Gathers the facts about one car from the master of `uri`."""

    def __init__(self, car: str, uri: str, listening: float = LISTENING) -> None:
        """Take the car's name, the master's address, and for how long to listen [s]."""
        self._car = car
        self._uri = uri
        self._listening = listening
        self._mux = f"/{car}/mux/ackermann_cmd_mux"
        self._addresses: Dict[str, str] = {}
        self._publishers: Dict[str, List[str]] = {}
        self._subscribers: Dict[str, List[str]] = {}
        self._services: List[str] = []
        self._dead: List[Tuple[str, str]] = []

    def look(self, faults: Sequence[Finding] = ()) -> Facts:
        """Return the facts, among them what was found wrong before."""
        master = look_at_master(self._uri)
        facts = Facts(car=self._car, master=master, faults=tuple(faults))
        if master.trouble:
            return facts
        try:
            return self._look_around(facts)
        except CallError:  # it went while we looked
            return dataclasses.replace(facts, master=master._replace(trouble=diagnosis.NO_MASTER))

    def _look_around(self, facts: Facts) -> Facts:
        """Return what there is to see of a system whose master answers."""
        state = call(self._uri, "getSystemState")
        self._publishers, self._subscribers = dict(state[0]), dict(state[1])
        self._services = [name for name, _ in state[2]]
        nodes = sorted({name for part in state for _, names in part for name in names})
        self._find_dead(nodes)

        topics = dict(self._inputs())
        output = f"{self._mux}/output"
        placement = "/initialpose" if self._car == "car" else f"/{self._car}/initialpose"
        past = [*topics.values(), output]
        use_sim_time = bool(self._parameter("/use_sim_time", False))
        reports = [f"{self._mux}/active", f"/{self._car}/car_pose", "/clock"]
        reports.append(f"/{self._car}/car_sim/collision")
        begin = time.time_ns()
        heard = self._listen([*reports, *past, placement], self._listening, reports)
        instants = [begin, time.time_ns()]
        clock = None
        if use_sim_time:
            instants = _clock_stamps(heard)
            clock = self._look_at_clock(instants)

        muxes = {node for topic in topics.values() for node in self._subscribers.get(topic, [])}
        inputs = [Input(name, self._topic(topic, heard)) for name, topic in topics.items()]
        leading = self._topic(output, heard)
        bypass = [each for each in leading.sources if each.node not in muxes]
        inputs.insert(0, Input("output", leading._replace(sources=tuple(bypass))))

        poses = [_pose(each.pose) for each in _messages(heard, PoseStamped)]
        contacts = [each.poses for each in _messages(heard, PoseArray)]
        actives = [each.data for each in _messages(heard, String)]
        strays, cars = self._find_strays([*past, placement])
        return dataclasses.replace(
            facts,
            inputs=tuple(inputs),
            output=leading,
            placement=self._topic(placement, heard, PoseWithCovarianceStamped),
            dead=tuple(self._dead),
            strays=strays,
            other_cars=cars,
            active=actives[-1] if actives else IDLE,
            clock=clock,
            now=(min(instants), max(instants)) if instants else None,
            listened=self._listening,
            contact=_pose(contacts[-1][0]) if contacts and contacts[-1] else "",
            pose=poses[-1] if poses else "",
            moves=any(each != poses[0] for each in poses) if poses else None,
        )

    def _look_at_clock(self, instants: List[int]) -> diagnosis.Clock:
        """Return what is known of the simulated time, of which `instants` [ns] were heard."""
        sources = self._publishers.get("/clock", [])
        moves = len(set(instants)) > 1
        if sources and not moves:
            later = _clock_stamps(self._listen(["/clock"], CLOCK_PATIENCE, ["/clock"], enough=2))
            moves = len({*instants, *later}) > 1
        resume = [each for each in self._services if each.endswith("/car_sim/resume")]
        return diagnosis.Clock(tuple(sources), moves, next(iter(resume), ""))

    def _find_dead(self, nodes: Sequence[str]) -> None:
        """Ask every node whether it is there."""

        def ping(node: str) -> str:
            try:
                self._addresses[node] = call(self._uri, "lookupNode", node)
            except CallError:
                return ""  # it has just gone
            try:
                call(self._addresses[node], "getPid")
            except NoResponseError:
                return diagnosis.STOPPED
            except UnknownHostError:
                return diagnosis.UNKNOWN_HOST
            except CallError:
                return diagnosis.REFUSED
            return ""

        jobs = [lambda node=node: ping(node) for node in nodes]
        answers = at_once(jobs, 1.5 * CALL_PATIENCE)
        self._dead = [
            (node, diagnosis.STOPPED if answer is None else answer)
            for node, answer in zip(nodes, answers)
            if answer != ""
        ]

    def _parameter(self, name: str, default: Any) -> Any:
        """Return a parameter's value, or the default if it is not set."""
        try:
            return call(self._uri, "getParam", name)
        except CallError:
            return default

    def _inputs(self) -> List[Tuple[str, str]]:
        """Return the mux's inputs and their topics, by falling priority."""
        inputs = [(each, f"input/{each}") for each in _INPUTS]
        with suppress(ConfigError):
            config = parse_config(self._parameter(self._mux, None))
            inputs = [(each.name, each.topic) for each in config.inputs]
        return [
            (name, topic if topic.startswith("/") else f"{self._mux}/{topic.lstrip('~')}")
            for name, topic in inputs
        ]

    def _listen(
        self, topics: Sequence[str], seconds: float, reports: Sequence[str], enough: int = 0
    ) -> Dict[Tuple[str, str], Stream]:
        """Listen to every live publisher of topics.

        Args:
            topics: their names.
            seconds: for how long, once connected.
            reports: the topics on which no publisher minds who listens.
            enough: how many messages of each end it early; 0: none do.

        Returns:
            What was heard, by topic and node.
        """
        dead = {node for node, _ in self._dead}
        begin = time.monotonic()

        def hear(topic: str, node: str, stream: Stream) -> None:
            uri = self._addresses[node]
            wanted = set(self._subscribers.get(topic, [])) - dead
            # A publisher that waits for its subscribers would take us for one, and go ahead.
            may_listen = topic in reports or _await_links(uri, topic, wanted, begin + 0.5 * seconds)
            _hear(topic, uri, "*" if may_listen else "?", seconds, enough, stream)

        streams = {
            (topic, node): Stream({}, [])
            for topic in topics
            for node in self._publishers.get(topic, [])
            if node in self._addresses and node not in dead
        }
        jobs = [
            lambda each=each, stream=stream: hear(each[0], each[1], stream)
            for each, stream in streams.items()
        ]
        at_once(jobs, 1.5 * seconds + CALL_PATIENCE)
        return {
            each: Stream(dict(stream.header), list(stream.messages))
            for each, stream in streams.items()
        }

    def _topic(
        self,
        name: str,
        heard: Dict[Tuple[str, str], Stream],
        kind: Any = None,
    ) -> Topic:
        """Return what is known of a topic of messages of `kind`; of commands, if none is given."""
        kind = kind or AckermannDriveStamped
        sources = []
        for node in self._publishers.get(name, []):
            stream = heard.get((name, node), Stream({}, []))
            commands = _decoded(stream, kind) if kind is AckermannDriveStamped else []
            sources.append(
                Source(
                    node,
                    stream.header.get("type", ""),
                    stream.header.get("md5sum", ""),
                    tuple(each.header.stamp.to_nsec() for each in commands),
                    tuple(each.drive.speed for each in commands),
                )
            )
        subscribers = tuple(self._subscribers.get(name, []))
        return Topic(name, kind._type, kind._md5sum, tuple(sources), subscribers)

    def _find_strays(
        self, known: Sequence[str]
    ) -> Tuple[Tuple[Tuple[str, Tuple[str, ...]], ...], Tuple[str, ...]]:
        """Find commands that go to nobody, and other cars."""
        types = dict(call(self._uri, "getTopicTypes"))
        dead = {node for node, _ in self._dead}
        strays, cars = [], []
        for topic, kind in sorted(types.items()):
            if kind != AckermannDriveStamped._type or topic in known:
                continue
            nodes = [each for each in self._publishers.get(topic, []) if each not in dead]
            if self._subscribers.get(topic):
                match = re.fullmatch(r"/(.+)/mux/ackermann_cmd_mux/output", topic)
                cars += [match.group(1)] if match else []
            elif nodes and not topic.endswith("/mux/ackermann_cmd_mux/output"):
                strays.append((topic, tuple(nodes)))
        return tuple(strays), tuple(cars)


def _await_links(uri: str, topic: str, wanted: Set[str], deadline: float) -> bool:
    """Wait until a publisher is connected with all of the nodes `wanted`; in the end, with one.

    Returns:
        Whether it is.
    """
    while wanted:
        try:
            links = receivers(uri, CALL_PATIENCE, CALLER, topic)
        except CallError:
            return False
        if wanted <= links or time.monotonic() > deadline:
            return not wanted.isdisjoint(links)
        time.sleep(0.05)
    return False


def _hear(topic: str, uri: str, md5sum: str, seconds: float, enough: int, stream: Stream) -> None:
    """Connect with a publisher as a subscriber does, and from then on take what it sends.

    To any other sum than "*" and its own it sends nothing, but says what its own is.
    """
    with suppress(CallError, OSError, ValueError, rosgraph.network.ROSHandshakeException):
        _, host, port = call(uri, "requestTopic", topic, [["TCPROS"]])
        with socket.create_connection((host, port), CALL_PATIENCE) as connection:
            header = {"topic": topic, "md5sum": md5sum, "callerid": CALLER}
            rosgraph.network.write_ros_handshake_header(connection, header)
            buffer = io.BytesIO()
            stream.header.update(
                rosgraph.network.read_ros_handshake_header(connection, buffer, 65536)
            )
            match = _OWN_TYPE.search(stream.header.get("error", ""))
            if match:
                stream.header.update(type=match[1], md5sum=match[2])
            data = buffer.getvalue()
            deadline = time.monotonic() + seconds
            while True:
                while len(data) >= 4:
                    (size,) = struct.unpack_from("<I", data)
                    if len(data) < 4 + size:
                        break
                    stream.messages.append(data[4 : 4 + size])
                    data = data[4 + size :]
                left = deadline - time.monotonic()
                if left <= 0.0 or (enough and len(stream.messages) >= enough):
                    return
                connection.settimeout(left)
                received = connection.recv(65536)
                if not received:
                    return
                data += received


def _decoded(stream: Stream, kind: Any) -> List[Any]:
    """Return the messages of a stream, if they are of a kind."""
    if stream.header.get("md5sum") != kind._md5sum:
        return []
    return [kind().deserialize(each) for each in stream.messages]


def _messages(heard: Dict[Tuple[str, str], Stream], kind: Any) -> List[Any]:
    """Return the messages of a kind, of whatever topic and node."""
    return [each for stream in heard.values() for each in _decoded(stream, kind)]


def _pose(msg: Any) -> str:
    """Return a pose as text."""
    try:
        return str(conversions.pose_from_msg(msg))
    except conversions.MessageError as error:
        return str(error)


def _clock_stamps(heard: Dict[Tuple[str, str], Stream]) -> List[int]:
    """Return the instants [ns] that were heard on /clock."""
    return [each.clock.to_nsec() for each in _messages(heard, ClockMsg)]
