"""Observe a running system and return facts about it, for the doctor. Every wait has a timeout."""

import re
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import SequenceMatcher, get_close_matches
from typing import AbstractSet, Any, Dict, Iterable, List, Sequence, Tuple

import rosgraph.network
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock as ClockMsg
from std_msgs.msg import String

from mushr_ros_intro.doctor.facts import Clock, Facts, Master, Publisher, Topic
from mushr_ros_intro.doctor.listener import Listener
from mushr_ros_intro.doctor.network import is_local, resolve, run_in_parallel
from mushr_ros_intro.doctor.processes import left_parameters
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import initial_pose_topic
from mushr_ros_intro.ros.ros_time import wait_for
from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER, CallError, CallFault, ask
from mushr_ros_intro.simulator.mux import IDLE, full_topic, parse_config

_CLOCK_TIMEOUT = 5.5
"""How long to wait until /clock advances [s]; in lock-step it waits 5 s for commands."""

_VIEWERS = (
    "rviz",
    "rqt",
    "rostopic",
    "record",
    "plan_recorder",
    "web_view",
    "drive_monitor",
    "doctor",
)
"""How the names of nodes begin that only show or record messages."""

_MUX_INPUTS = ("safety", "teleop", "navigation", "default")
"""The inputs of MuSHR's mux, for a mux without parameters."""


@dataclass(frozen=True)
class _Graph:
    """The registrations at the master."""

    publishers: Dict[str, List[str]]
    subscribers: Dict[str, List[str]]
    services: List[str]
    dead: Dict[str, CallFault]
    pids: Dict[str, int]
    """The process ids of the nodes that can be reached."""

    def live(self, nodes: Dict[str, List[str]], topic: str) -> List[str]:
        """Return the publishers or subscribers of a topic that can be reached."""
        return [each for each in nodes.get(topic, []) if each not in self.dead]


class Observer:
    """Observes the system around one car.

    Args:
        car: the name of the car.
        uri: the address of the master.
        listening_time: how long to listen to topics [s]; 2.2 s show a rate of one per second.
        call_timeout: for each call to the master or to a node [s].
        masters: the addresses at which to look for another master.
    """

    def __init__(
        self,
        car: str,
        uri: str,
        listening_time: float = 2.2,
        call_timeout: float = 2.0,
        masters: Sequence[str] = (DEFAULT_MASTER,),
    ) -> None:
        self._car, self._uri, self._masters = car, uri, masters
        self._listening_time, self._call_timeout = listening_time, call_timeout
        mux = f"/{car}/mux/ackermann_cmd_mux"
        self._mux, self._output, self._active = mux, f"{mux}/output", f"{mux}/active"
        self._pose, self._collision = f"/{car}/car_pose", f"/{car}/car_sim/collision"
        self._initial_pose = initial_pose_topic(car)
        self._verdict = f"/{car}/drive_monitor/verdict"

    def observe(self) -> Facts:
        """Return the facts. It takes some seconds, whatever is stopped or unreachable."""
        master = self._find_master()
        facts = Facts(self._car, master)
        if master.fault:
            return facts
        try:
            return self._observe_system(facts)
        except CallError as error:  # the master has ended or stopped meanwhile
            return replace(facts, master=master._replace(fault=error.fault))

    def _find_master(self) -> Master:
        """Return whether a master responds, and whether there is another one."""
        try:
            host, port = rosgraph.network.parse_http_host_and_port(self._uri)
        except ValueError:
            return Master(self._uri, CallFault.MALFORMED)
        addresses = resolve(host)
        master = Master(self._uri, is_local=is_local(addresses))
        for each in self._masters:
            _, its_port = rosgraph.network.parse_http_host_and_port(each)
            if not master.other and not (master.is_local and port == its_port):
                with suppress(CallError):
                    self._ask(each, "getPid")
                    master = master._replace(other=each)
        if not addresses:
            return master._replace(fault=CallFault.UNKNOWN_HOST)
        try:
            self._ask(self._uri, "getPid")
        except CallError as error:
            return master._replace(fault=error.fault)
        return master

    def _ask(self, uri: str, method: str, *arguments: Any) -> Any:
        return ask(uri, self._call_timeout, "/doctor", method, *arguments)

    def _parameter(self, name: str) -> Any:
        """Return a parameter's value, None if it is not set."""
        with suppress(CallError):
            return self._ask(self._uri, "getParam", name)
        return None

    def _observe_system(self, facts: Facts) -> Facts:
        """Return the facts about a system whose master responds."""
        graph = self._read_graph()
        inputs = self._read_inputs()
        uses_clock = bool(self._parameter("/use_sim_time"))
        commands = [*inputs.values(), self._output, self._initial_pose]
        strays, stray_poses, other_cars = self._read_other_topics(graph, commands)
        heard = self._listen(graph, commands, uses_clock)
        clock = None
        if uses_clock:
            instants = _instants(heard)
            window = (min(instants), max(instants)) if instants else None
            resume = (each for each in graph.services if each.endswith("/car_sim/resume"))
            publishers = tuple(graph.publishers.get("/clock", []))
            clock = Clock(publishers, window, next(resume, ""))
        topics = {name: _topic(graph, heard, topic) for name, topic in inputs.items()}
        output = _topic(graph, heard, self._output)
        muxes = {node for topic in topics.values() for node in topic.subscribers}
        bypassing = tuple(each for each in output.publishers if each.node not in muxes)
        actives = [msg.data for _, msg, _ in heard.messages(self._active, String)]
        poses = {str(msg.pose) for _, msg, _ in heard.messages(self._pose, PoseStamped)}
        contacts = [msg.poses for _, msg, _ in heard.messages(self._collision, PoseArray)]
        verdicts = [msg.data for _, msg, _ in heard.messages(self._verdict, String)]
        touches = bool(contacts and contacts[-1])
        senders = {each.node for topic in topics.values() for each in topic.publishers}
        nodes = senders.union(*strays.values())
        left, mistyped = self._read_processes(graph, nodes) if facts.master.is_local else ({}, {})
        return replace(
            facts,
            inputs={"output": output._replace(publishers=bypassing), **topics},
            output=output,
            initial_pose=_topic(graph, heard, self._initial_pose, PoseWithCovarianceStamped),
            dead=graph.dead,
            strays=strays,
            stray_poses=stray_poses,
            unpublished=self._read_unpublished(graph, commands),
            left_parameters=left,
            mistyped=mistyped,
            other_cars=other_cars,
            active=_input(actives[-1], inputs) if actives else IDLE,
            clock=clock,
            pose_publishers=tuple(graph.live(graph.publishers, self._pose)),
            contact=str(conversions.pose_from_msg(contacts[-1][0])) if touches else "",
            moves=len(poses) > 1 if poses else None,
            verdict=verdicts[-1].replace("\n", "; ") if verdicts else "",
        )

    def _read_graph(self) -> _Graph:
        """Return what is registered at the master, and which nodes cannot be reached."""
        publishers, subscribers, services = self._ask(self._uri, "getSystemState")
        entries = [*publishers, *subscribers, *services]
        nodes = sorted({node for _, names in entries for node in names})

        def ping(node: str) -> Any:
            try:
                uri = self._ask(self._uri, "lookupNode", node)
            except CallError:
                return None  # it has just signed off
            return self._ask(uri, "getPid")

        jobs = [lambda node=node: ping(node) for node in nodes]
        results = run_in_parallel(jobs, 1.5 * self._call_timeout)
        found = dict(zip(nodes, results))
        dead = {node: pid.fault for node, pid in found.items() if isinstance(pid, CallError)}
        pids = {node: pid for node, pid in found.items() if isinstance(pid, int)}
        names = [name for name, _ in services]
        return _Graph(dict(publishers), dict(subscribers), names, dead, pids)

    def _read_processes(
        self, graph: _Graph, nodes: AbstractSet[str]
    ) -> Tuple[Dict[str, Dict[str, Any]], Dict[str, Dict[str, str]]]:
        """Return the left parameters of nodes, and their arguments that should set one."""
        found, mistyped = {}, {}
        for node in sorted(nodes & graph.pids.keys()):
            parameters = self._parameter(node)
            if isinstance(parameters, dict):
                left, wrong = left_parameters(graph.pids[node], self._uri, parameters)
                found.update({node: left} if left else {})
                mistyped.update({node: wrong} if wrong else {})
        return found, mistyped

    def _read_inputs(self) -> Dict[str, str]:
        """Return the topics of the mux's inputs by name, by falling priority."""
        inputs = {each: f"input/{each}" for each in _MUX_INPUTS}
        with suppress(UserError):
            config = parse_config(self._parameter(self._mux))
            inputs = {each.name.lower(): each.topic for each in config.inputs}
        return {name: full_topic(self._mux, topic) for name, topic in inputs.items()}

    def _read_other_topics(
        self, graph: _Graph, known: Sequence[str]
    ) -> Tuple[Dict[str, Tuple[str, ...]], Dict[str, Tuple[str, ...]], Tuple[str, ...]]:
        """Return the publishers of commands that no node receives, and those of initial poses.

        Also return the names of other cars. The master remembers the type of a topic whose
        publishers have ended.
        """
        strays, stray_poses, cars = {}, {}, []
        for topic, kind in sorted(self._ask(self._uri, "getTopicTypes")):
            if topic in known:
                continue
            publishers = tuple(graph.live(graph.publishers, topic))
            subscribers = graph.subscribers.get(topic)
            is_of_car = topic.startswith(f"/{self._car}/")
            is_misspelt = is_of_car and get_close_matches(topic, known, 1, 0.9)
            if kind == AckermannDriveStamped._type:
                match = re.fullmatch(r"/(.+)/mux/ackermann_cmd_mux/output", topic)
                if subscribers:
                    cars += [match[1]] if match else []
                elif not match and (publishers or is_misspelt):
                    strays[topic] = publishers
            elif kind == PoseWithCovarianceStamped._type and not subscribers:
                # Other estimates of a pose have this type, too, and may have no subscriber.
                senders = tuple(each for each in publishers if "rviz" not in each)
                if senders and _is_like_initial_pose(topic.rpartition("/")[2]):
                    stray_poses[topic] = senders
        return strays, stray_poses, tuple(cars)

    def _read_unpublished(self, graph: _Graph, known: Sequence[str]) -> Dict[str, Tuple[str, ...]]:
        """Return the subscribers of each topic of the car that no node publishes."""
        found = {}
        for topic, nodes in sorted(graph.subscribers.items()):
            waiting = [each for each in _users(nodes) if not each.endswith("/car_sim")]
            is_of_car = topic.startswith(f"/{self._car}/") and topic not in known
            if is_of_car and waiting and not graph.live(graph.publishers, topic):
                found[topic] = tuple(waiting)
        return found

    def _listen(self, graph: _Graph, commands: Sequence[str], uses_clock: bool) -> Listener:
        """Return what the live publishers send.

        A publisher may wait for its first subscriber before it sends. The doctor must not be this
        subscriber, so it subscribes to a topic of commands only if another live node does. But if
        that node rejects the publisher because of its type, the doctor is the only subscriber.
        """
        topics = [each for each in commands if graph.live(graph.subscribers, each)]
        topics += [self._active, self._pose, self._collision, self._verdict]
        topics += ["/clock"] * uses_clock
        expected = {
            (topic, node) for topic in topics for node in graph.live(graph.publishers, topic)
        }
        listener = Listener(topics)
        wait_for(lambda: expected <= listener.connected(), self._call_timeout)
        time.sleep(self._listening_time)
        if uses_clock and graph.live(graph.publishers, "/clock"):
            wait_for(lambda: len(set(_instants(listener))) > 1, _CLOCK_TIMEOUT)
        listener.stop()
        return listener


def _topic(graph: _Graph, heard: Listener, name: str, kind: Any = AckermannDriveStamped) -> Topic:
    """Return what is known about a topic on which messages of the type `kind` are expected."""
    received = heard.messages(name, kind) if kind is AckermannDriveStamped else []
    publishers = []
    for node in graph.publishers.get(name, []):
        header = heard.headers.get((name, node), {})
        commands = [(msg, arrival) for sender, msg, arrival in received if sender == node]
        publishers.append(
            Publisher(
                node,
                header.get("type", ""),
                tuple(each.header.stamp.to_nsec() for each, _ in commands),
                tuple(each.drive.speed for each, _ in commands),
                tuple(each.drive.steering_angle for each, _ in commands),
                tuple(arrival for _, arrival in commands),
            )
        )
    subscribers = _users(graph.subscribers.get(name, []))
    return Topic(name, kind._type, tuple(publishers), subscribers)


def _users(nodes: Iterable[str]) -> Tuple[str, ...]:
    """Return the nodes that do not only show or record messages."""
    return tuple(each for each in nodes if not each.rpartition("/")[2].startswith(_VIEWERS))


def _is_like_initial_pose(name: str) -> bool:
    """Return whether a name may mean initialpose: intialpose has a ratio of 0.95, amcl_pose 0.6."""
    is_similar = SequenceMatcher(None, name, "initialpose").ratio() > 0.75
    return is_similar or "init" in name or "start" in name


def _input(active: str, inputs: Iterable[str]) -> str:
    """Return the input that a mux announces; MuSHR's mux announces teleop as "Teleoperation"."""
    return next((name for name in inputs if active.lower().startswith(name)), active)


def _instants(heard: Listener) -> List[int]:
    """Return the instants [ns] that were received on /clock."""
    return [msg.clock.to_nsec() for _, msg, _ in heard.messages("/clock", ClockMsg)]
