#!/usr/bin/python3
"""Let a node drive a plan on the simulated car, and judge it: the test node of replay.test."""

import contextlib
import os
import shlex
import signal
import subprocess
import threading
import time
import unittest
from typing import Any, Callable, Dict, List, Optional, Set, Tuple

import numpy as np
import roslib.packages
import rospkg
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import MapMetaData
from std_srvs.srv import Trigger

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.grading import judge as report
from mushr_ros_intro.grading.checks import as_number
from mushr_ros_intro.parameters import ParameterError, Parameters, number, text
from mushr_ros_intro.plan.find import find_plan, read_plan
from mushr_ros_intro.plan.model import Plan, PlanError
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import CLOCK_LAG, NANOSECONDS, effective_stamp

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
POSES = "/car/car_pose"
PLACEMENTS = "/initialpose"
COLLISIONS = "/car/car_sim/collision"
MAP = "/map_metadata"

AUTO = "auto"
"""The value of a tolerance that depends on the plan."""

_SHOWN_LINES = 15
"""How many of a node's last lines are quoted."""

_START_PATIENCE = 0.3
"""How long the first command waits for the start pose [s of wall-clock time]."""

_STEP = 0.02
"""From one pose of the car to the next [s]; until the node is heard, of wall-clock time too."""


class ReplayError(RuntimeError):
    """A replay that says nothing about the node, because something else is wrong."""


class Candidate:
    """The node that is to drive: a process that is started, watched and ended."""

    def __init__(self, command: str, arguments: List[str]) -> None:
        """Start `command`, PACKAGE NODE [ARGUMENT...], with more arguments.

        Raises:
            ReplayError: there is no such node, or it cannot be started.
        """
        words = shlex.split(command)
        if len(words) < 2:
            raise ReplayError(f"publisher is '{command}'; expected 'PACKAGE NODE [ARGUMENT...]'")
        try:
            found = roslib.packages.find_node(*words[:2])
        except rospkg.ResourceNotFound:
            raise ReplayError(f"there is no package '{words[0]}' (rospack find)") from None
        if not found:
            raise ReplayError(
                f"there is no node '{words[1]}' in the package '{words[0]}'. "
                f"Is the file executable (chmod +x {words[1]})?"
            )
        try:
            self._process = subprocess.Popen(
                [found[0], *words[2:], *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,
            )
        except OSError as error:
            raise ReplayError(
                f"{found[0]} cannot be started ({error.strerror}). "
                "Does its first line name an interpreter that is there?"
            ) from None
        self._tail = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Keep the end of what the node writes."""
        assert self._process.stdout
        source = self._process.stdout.fileno()
        for chunk in iter(lambda: os.read(source, 65536), b""):
            self._tail = (self._tail + chunk)[-20_000:]

    @property
    def ended(self) -> bool:
        """Whether the node runs no more."""
        return self._process.poll() is not None

    def end(self) -> None:
        """End the node, and what it has started."""
        for number_, patience in ((signal.SIGINT, 3.0), (signal.SIGKILL, 10.0)):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number_)
            try:
                self._process.wait(patience)
            except subprocess.TimeoutExpired:
                continue
        self._reader.join(1.0)

    def describe_end(self) -> str:
        """Say how the node failed; nothing if its exit status is 0."""
        status = self._process.wait()
        if status == 0:
            return ""
        self._reader.join(1.0)
        how = f"ended with the exit status {status}"
        if status < 0:
            how = f"was killed by the signal {signal.Signals(-status).name}"
        return f"the node {how}{self._last_words()}"

    def _last_words(self) -> str:
        """Return the last lines that the node wrote, as text that fits into XML."""
        lines = self._tail.decode(errors="replace").splitlines()[-_SHOWN_LINES:]
        shown = ["".join(c for c in line if c.isprintable()) for line in lines]
        return "; it said nothing" if not shown else "; its last words:\n" + "\n".join(shown)


class Observer:
    """Listens to everything that the verdict needs, and passes on what the node sends to the car.

    The node's commands and start pose come on ``~commands`` and ``~start_pose`` and go to the mux
    and the car from here. So what is seen is what reaches the car, also where the node's queue is
    short and the machine busy, and nothing is lost between the node's first subscriber and its
    second. Until something has come from the node, the clock is held and goes on from here, step by
    step: where a busy machine holds up this process, it does so to the node's time as well.
    """

    def __init__(self, patience: float) -> None:
        """Subscribe, and wait until the car is there.

        Raises:
            ReplayError: it is not within `patience` [s].
        """
        self._lock = threading.Lock()
        self._sent: List[report.Sent] = []
        self._starts: List[Pose] = []
        self._poses: List[Tuple[int, Pose]] = []
        self._is_heard = threading.Event()
        self._is_passed_on = threading.Event()
        self._is_placed = threading.Event()
        self._collisions: List[Pose] = []
        self._map: Optional[MapMetaData] = None
        self.heard = time.monotonic()

        options = {"queue_size": 1000, "tcp_nodelay": True}
        self._commands_pub = rospy.Publisher(CONTROL, AckermannDriveStamped, **options)
        self._start_pub = rospy.Publisher(PLACEMENTS, PoseWithCovarianceStamped, **options)
        self._subscribe(POSES, PoseStamped, self._on_pose)
        _wait_for(lambda: self.count_poses() > 0, f"a pose on {POSES}", patience)
        for publisher in (self._commands_pub, self._start_pub):
            topic = publisher.resolved_name
            _wait_for(publisher.get_num_connections, f"a subscriber of {topic}", patience)
        published = {topic for topic, _ in rospy.get_published_topics()}
        self._tells_collisions = COLLISIONS in published
        if self._tells_collisions:
            collisions = self._subscribe(COLLISIONS, PoseArray, self._on_collision)
            _wait_for(collisions.get_num_connections, f"a publisher of {COLLISIONS}", patience)
        if MAP in published:
            self._subscribe(MAP, MapMetaData, self._on_map)
            _wait_for(lambda: self._map is not None, f"a message on {MAP}", patience)
        self._start_sub = self._subscribe(
            "~start_pose", PoseWithCovarianceStamped, self._on_placement
        )
        commands = self._subscribe("~commands", AckermannDriveStamped, self._on_command)
        self.remappings = [
            f"{PLACEMENTS}:={self._start_sub.resolved_name}",
            f"{CONTROL}:={commands.resolved_name}",
        ]
        threading.Thread(target=self._keep_pace, daemon=True).start()

    def _keep_pace(self) -> None:
        """Move the car's clock until the node is heard, and let it go when that has been passed on.

        Who is held up sends on at once all that a clock which runs on has brought meanwhile.
        """
        step, resume = (
            rospy.ServiceProxy(f"/car/car_sim/{name}", Trigger, persistent=True)
            for name in ("step", "resume")
        )
        # Without the car no pose comes, which is said elsewhere.
        with contextlib.suppress(rospy.ServiceException, rospy.ROSException):
            while not self._is_heard.wait(_STEP):
                step()
            self._is_passed_on.wait()
            resume()

    @staticmethod
    def _subscribe(
        topic: str, kind: Any, callback: Callable[[rospy.Message], None]
    ) -> rospy.Subscriber:
        """Subscribe to a topic of which no message is to be late."""
        return rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)

    def _on_command(self, msg: AckermannDriveStamped) -> None:
        """Note a command, and pass it on as it is; the first one after the start pose.

        A node sends that before, but over a connection of its own, which may be the slower one.
        """
        self._is_heard.set()
        if self._start_sub.get_num_connections() and not self.count_commands():
            self._is_placed.wait(_START_PATIENCE)
        now, stamp = rospy.get_rostime().to_nsec(), msg.header.stamp.to_nsec()
        taken = effective_stamp(stamp, now, CLOCK_LAG)
        sent = report.Sent(taken, taken == stamp, msg.drive.speed, msg.drive.steering_angle)
        with self._lock:
            self._sent.append(sent)
            self.heard = time.monotonic()
        self._commands_pub.publish(msg)
        self._is_passed_on.set()

    def _on_placement(self, msg: PoseWithCovarianceStamped) -> None:
        """Note a start pose, and pass it on as it is."""
        self._is_heard.set()
        try:
            pose = conversions.pose_from_msg(msg.pose.pose)
        except conversions.MessageError:
            pose = Pose(*3 * [float("nan")])
        with self._lock:
            self._starts.append(pose)
            self.heard = time.monotonic()
        self._start_pub.publish(msg)
        self._is_passed_on.set()
        self._is_placed.set()

    def _on_pose(self, msg: PoseStamped) -> None:
        """Note where the car is."""
        with self._lock:
            self._poses.append((msg.header.stamp.to_nsec(), conversions.pose_from_msg(msg.pose)))

    def _on_collision(self, msg: PoseArray) -> None:
        """Note where the car hit a wall; a message without a pose says that it stands at none."""
        with self._lock:
            self._collisions += map(conversions.pose_from_msg, msg.poses)

    def _on_map(self, msg: MapMetaData) -> None:
        """Note how large the map is."""
        self._map = msg

    def count_poses(self) -> int:
        """Return how many poses the car has reported."""
        with self._lock:
            return len(self._poses)

    def count_commands(self) -> int:
        """Return how many commands have come."""
        with self._lock:
            return len(self._sent)

    def first_command(self) -> int:
        """Return when the first command came [ns], or now."""
        with self._lock:
            return self._sent[0].time if self._sent else rospy.get_rostime().to_nsec()

    def stands(self, timeout: int) -> bool:
        """Say whether the car stands, and no command holds, which are good for `timeout` [ns]."""
        with self._lock:
            last = self._sent[-1].time if self._sent else 0
            stamp, pose = self._poses[-1]
            recent = [one for when, one in self._poses[-1000:] if when >= stamp - timeout]
        return stamp > last + 2 * timeout and all(one == pose for one in recent)

    def seen(self, plan: Plan, car: Car, outcome: str) -> report.Replay:
        """Return all that was seen."""
        with self._lock:
            size, origin = (0.0, 0.0), None
            if self._map is not None:
                info = self._map
                size = (info.width * info.resolution, info.height * info.resolution)
                origin = conversions.pose_from_msg(info.origin)
            return report.Replay(
                plan=plan,
                car=car,
                outcome=outcome,
                starts=tuple(self._starts),
                sent=tuple(self._sent),
                stamps=np.array([stamp for stamp, _ in self._poses], np.int64),
                poses=np.array([pose for _, pose in self._poses], float).reshape(-1, 3),
                collisions=tuple(self._collisions) if self._tells_collisions else None,
                map_origin=origin,
                map_size=size,
            )


def replay() -> Tuple[report.Replay, List[report.Check]]:
    """Do the replay that the node's parameters describe.

    Raises:
        ParameterError, PlanError: a parameter, or the plan.
        ReplayError: something that the driving node has nothing to do with.
    """
    plan = read_plan(_find_plan(text("~plan_file", rospy.get_param("~plan_file", None))))
    publisher = text("~publisher", rospy.get_param("~publisher", None))
    patience = number("~patience", rospy.get_param("~patience", 30.0), "s", 0.1, 1e4)
    folder = str(rospy.get_param("~report", ""))
    car = car_from(Parameters(rospy.get_param("/car/car_sim", {}), "/car/car_sim/"))
    default = report.default_tolerances(plan, car)
    tolerances = report.Tolerances(
        _tolerance("~position_tolerance", "m", default.position),
        _tolerance("~angle_tolerance", "rad", default.angle),
        _tolerance("~path_tolerance", "m", default.path),
    )

    observer = Observer(max(patience, 60.0))  # the car is still starting
    ours = set(_publishers())
    candidate = Candidate(publisher, [f"_plan_file:={plan.path}", *observer.remappings])
    began = (time.monotonic(), rospy.get_time())
    try:
        outcome = _watch(candidate, observer, plan, patience, ours)
    finally:
        candidate.end()
    if observer.count_commands():
        _wait_for(lambda: observer.stands(car.command_timeout), "the car to stand", 60.0)
    elapsed, simulated = time.monotonic() - began[0], rospy.get_time() - began[1]

    seen = observer.seen(plan, car, outcome)
    checks = report.judge(seen, tolerances)
    print(report.verdict(checks, seen))
    if folder:
        facts = {
            "plan_file": plan.path,
            "publisher": publisher,
            "car": rospy.get_param("~car", "ideal"),
            "seed": rospy.get_param("~seed", ""),
            "tolerances": tolerances._asdict(),
            "simulated_seconds": simulated,
            "wall_clock_seconds": elapsed,
        }
        report.write(os.path.join(os.environ.get("PWD", "."), folder), seen, checks, facts)
    return seen, checks


def _watch(
    candidate: Candidate, observer: Observer, plan: Plan, patience: float, ours: Set[str]
) -> str:
    """Wait until the node has driven the plan, or has failed to; return how it failed.

    All nodes that publish anything are its own, but for `ours`.
    """
    expected = sum(run.expected for run in report.runs_of(plan))
    limit = plan.duration * 3 // 2 + 5 * NANOSECONDS
    poses, reported = observer.count_poses(), time.monotonic()
    observer.heard = time.monotonic()
    while not candidate.ended:
        if rospy.is_shutdown():
            raise ReplayError("shut down while the node drove")
        wall = time.monotonic()
        count = observer.count_commands()
        if observer.count_poses() > poses:
            poses, reported = observer.count_poses(), wall
        if wall - reported > patience:
            raise ReplayError(f"the car has reported no pose on {POSES} for {patience:g} s")
        if wall - observer.heard > patience:
            if count >= expected:
                return ""  # a node that has done its work need not end
            if count:
                return (
                    f"the node hangs: {count} of {expected} commands came, and then nothing for "
                    f"{patience:g} s, though it still runs"
                )
            others = {node: topics for node, topics in _publishers().items() if node not in ours}
            topics = sorted(set().union(*others.values()) - {"/rosout"})
            return (
                f"the node runs, but published no command on {CONTROL} for {patience:g} s; "
                f"it publishes {', '.join(topics) or 'no topic at all'}"
            )
        if rospy.get_rostime().to_nsec() - observer.first_command() > limit:
            return (
                f"the node still sends commands {(limit - plan.duration) / NANOSECONDS:g} s after "
                f"the end of the plan, which takes {plan.duration / NANOSECONDS:g} s"
            )
        time.sleep(0.01)
    fault = candidate.describe_end()
    if not fault and not observer.count_commands():
        fault = f"the node ended without a command on {CONTROL}"
    return fault


def _publishers() -> Dict[str, Set[str]]:
    """Return the nodes that publish anything, and what."""
    topics: Dict[str, Set[str]] = {}
    _, _, (publishers, _, _) = rospy.get_master().getSystemState()
    for topic, nodes in publishers:
        for node in nodes:
            topics.setdefault(node, set()).add(topic)
    return topics


def _wait_for(condition: Callable[[], Any], what: str, patience: float) -> None:
    """Wait until a condition is met.

    Raises:
        ReplayError: it is not within `patience` [s].
    """
    deadline = time.monotonic() + patience
    while not condition():
        if rospy.is_shutdown() or time.monotonic() > deadline:
            raise ReplayError(f"waited {patience:g} s for {what}")
        time.sleep(0.01)


def _tolerance(name: str, unit: str, default: float) -> float:
    """Return the tolerance that a parameter gives."""
    value = rospy.get_param(name, AUTO)
    if value == AUTO:
        return default
    return number(name, as_number(value), unit, 0.0, 1e6)


def _find_plan(name: str) -> str:
    """Return the path of the plan file that the user means."""
    package = rospkg.RosPack().get_path("mushr_ros_intro")
    plans = os.path.realpath(os.path.join(package, "plans"))
    return os.path.abspath(find_plan(name, plans))


class ReplayTest(unittest.TestCase):
    """One test case for each verdict."""

    _checks: Optional[Dict[str, report.Check]] = None
    _error = ""

    def setUp(self) -> None:
        """Do the replay, once for all test cases."""
        cls = type(self)
        if cls._checks is None and not cls._error:
            try:
                cls._checks = {check.name: check for check in replay()[1]}
            except (ParameterError, PlanError, ReplayError, OSError) as error:
                cls._error = f"there was no replay: {error}"
        if cls._error:
            self.fail(cls._error)

    def _assert_check(self, name: str) -> None:
        """Fail if a verdict is bad, otherwise print it."""
        assert self._checks is not None
        check = self._checks[name]
        if not check.passed:
            self.fail(check.message)
        print(f"{name}: {check.message}")

    def test_node(self) -> None:
        """The node starts, drives, and ends without an error."""
        self._assert_check("node")

    def test_start_pose(self) -> None:
        """The node sends the plan's start pose, and the car takes it."""
        self._assert_check("start_pose")

    def test_commands(self) -> None:
        """The commands are the plan's, in its order."""
        self._assert_check("commands")

    def test_rate(self) -> None:
        """Every row has ten commands a second for as long as it lasts."""
        self._assert_check("rate")

    def test_path(self) -> None:
        """The driven path is close to the predicted one everywhere."""
        self._assert_check("path")

    def test_final_pose(self) -> None:
        """The car ends where the prediction does."""
        self._assert_check("final_pose")

    def test_rest(self) -> None:
        """The car stands at the end."""
        self._assert_check("rest")

    def test_collision(self) -> None:
        """The car drives into no wall."""
        self._assert_check("collision")

    def test_map(self) -> None:
        """The car stays on the map."""
        self._assert_check("map")


if __name__ == "__main__":
    init_node("replay")
    rostest.rosrun("mushr_ros_intro", "replay", ReplayTest)
