"""The world of a replay: a master, the simulated car, its mux and a map, all in this process.

The node under test sees the usual topics, services and parameters. But the car receives nothing
from ROS except initial poses and the commands on the inputs of the mux, and everything is recorded
here. So the node cannot change the recording, nor move the car by other means.
"""

import os
import threading
import time
from contextlib import suppress
from typing import Any, Callable, Dict, Iterator, List, Optional

import numpy as np
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap
from rosgraph_msgs.msg import Clock

from mushr_ros_intro.car.model import Car, State, at_rest
from mushr_ros_intro.geometry import ORIGIN
from mushr_ros_intro.isolation.node_process import NodeProcess
from mushr_ros_intro.isolation.threads import Threads
from mushr_ros_intro.replay.due_times import DueTimes
from mushr_ros_intro.replay.guarded_master import GuardedMaster
from mushr_ros_intro.replay.mistakes import INITIAL_POSES, command_topic_mistake
from mushr_ros_intro.replay.pace import PAUSE, STEP, WALL_CLOCK, Pace
from mushr_ros_intro.replay.path_delivery import PathDelivery
from mushr_ros_intro.replay.received import CONTROL, Received
from mushr_ros_intro.replay.recording import Recorded
from mushr_ros_intro.replay.reference import Exercise, Reference
from mushr_ros_intro.replay.replay_car import MUX, ReplayCar
from mushr_ros_intro.ros import conversions, ros_time, rospy_fixes
from mushr_ros_intro.simulator.mux import Input, full_topic
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS, from_seconds
from mushr_ros_intro.world.grid import Grid

CAR = "/car/car_sim"
PREDICTED_PATH = "/car/predicted_path"

START = 1_000_000_000 * NANOSECONDS
"""The time at which a replay begins: far from the present, in the year 2001 [ns]."""

NAP, LONG_NAP = 0.001, 0.004
"""Time from a message to an observation of the node, and between two [s of wall-clock time]."""

SHORT_NAP = 0.0001
"""The same after the node has written when its next thread is due: it will wait in a moment."""

MAX_RATE = 1000
"""A node that sends more commands per second has failed."""

CLOSE_LOOKS = 100
"""If nothing arrives from an ended node for so many looks, a child process holds its connection."""


class ReplayWorld:
    """The world of one replay. A process can create it only once.

    The clock advances in steps, and only while the node waits and all its messages have been
    processed, initial poses first. At each instant, the car first reports its states, one topic
    after another, and then the node receives the time. Each message is sent when the node has
    processed the one before. So neither the speed nor the load of the machine has an effect. See
    `Pace`, and docs/checks.md.
    """

    def __init__(
        self,
        car: Car,
        parameters: Dict[str, Any],
        mux: Dict[str, Any],
        grid: Optional[Grid],
        exercise: Exercise,
    ) -> None:
        """Start the nodes.

        Args:
            car: the car.
            parameters: of the node of the car, which the node under test may read.
            mux: the configuration of the mux.
            grid: the map, or None.
            exercise: the plan or the path of the node. At a path, the car is placed at its start,
                and a command applies at the instant at which it arrives.
        """
        reference = exercise if isinstance(exercise, Reference) else None
        if reference:
            start = reference.start._asdict()
            parameters = {**parameters, **start, "pose_rate": NANOSECONDS / STEP}
        self._pose_period = from_seconds(1.0 / parameters["pose_rate"])
        self.received = Received(reference.start, START) if reference else Received()
        """What the node has sent to the car."""
        self.count = 0
        """The number of messages that it has sent."""
        self.states: List[State] = []
        """The reported states of the car."""
        self.now = START
        """The simulated time [ns]."""
        self._model, self._grid, self._exercise = car, grid, exercise
        self.due_times = DueTimes()
        self._pending: Iterator[int] = iter(())  # the messages of this instant that are not sent

        self._master = GuardedMaster()
        _join(self._master.serve(), parameters, mux)
        rospy_fixes.set_time(START)
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10_000, tcp_nodelay=True)
        rospy.on_shutdown(lambda: self._master.record(f"shuts down the node {CAR}"))
        begin = reference.start if reference else ORIGIN
        self._car = ReplayCar(car, begin, START, mux, grid)
        if grid is not None:
            _offer_map(grid)
        self._delivery: Optional[PathDelivery] = None  # of the path
        if reference:
            self._delivery = PathDelivery(reference, START, self._master.services.map)
            self._car.add_frames("odom", "base_footprint")  # of courses without a prefix
        self._master.guard(
            CAR,
            ("/use_sim_time", CAR, MUX),
            (CONTROL, INITIAL_POSES, PREDICTED_PATH, "/rosout", "/tf", "/tf_static"),
            rospy_fixes.take_publisher_updates(
                lambda: self._master.record(f"sends publishers to the node {CAR}")
            ),
        )
        # All threads but this one, also those that receive nothing: while one of them waits for a
        # processor, the threads that wait for the same lock of Python seem to wait for a message.
        self._others = Threads(os.getpid(), False, [threading.get_native_id()])
        self._nap = NAP

    def fault(self, pace: Pace) -> str:
        """Return why a running node has failed; empty if it has not failed.

        Call this method after each observation, so that a drive ends at the same instant in all
        runs.
        """
        if rospy.is_shutdown():
            return f"the node has shut down {CAR}"
        if pace.uses_wall_clock:
            return WALL_CLOCK
        recent = self.received.commands[-MAX_RATE:]
        is_fast = len(recent) == MAX_RATE and recent[-1].arrived - recent[0].arrived < NANOSECONDS
        if is_fast or len(self._car.commands) > MAX_RATE:
            return f"the node sends more than {MAX_RATE} commands per second; expected ten"
        return ""

    @property
    def is_ending(self) -> bool:
        """Whether the node has sent commands, and has left ROS."""
        return bool(self.received.commands) and not self._master.publishers.get_apis(CONTROL)

    @property
    def topic_mistake(self) -> str:
        """What the node did instead of sending commands."""
        has_start = self.received.start is not None
        mistake = command_topic_mistake(self._master.published, CONTROL, has_start)
        if missing := self._master.unpublished():
            mistake += f" It waits for messages on {', '.join(missing)}, where nobody publishes"
        return f"it {mistake}"

    @property
    def silence(self) -> float:
        """The time since the node's last command, or since the start [s of simulated time]."""
        commands = self.received.commands
        return (self.now - (commands[-1].arrived if commands else START)) / NANOSECONDS

    def observe(self, pace: Pace, left: Optional[int]) -> None:
        """Observe the node once; if it waits, process its messages or send the next one.

        The threads of this process must not run while the node is observed.

        Args:
            pace: of the clock.
            left: the time until the next command is due [ns]; None if none is expected.
        """
        node_waits, others_wait = pace.observe(self._others)
        if node_waits and others_wait:
            if self._master.notify() or self._process(pace):
                pace.unsettle()
                return
            end = pace.advance(self.now, left, self._time_until_due, self._waits_for_child(pace))
        else:
            pace.unsettle()
            is_polling = others_wait and not node_waits
            end = pace.advance(self.now, left, None) if is_polling else None
        # Without a connection, the node has not initialised ROS yet.
        if end is not None and (self.received.commands or self._clock.get_num_connections()):
            self._send(pace, end)
            self._nap = NAP
        is_written = self.due_times.wait(self._nap)
        self._nap = SHORT_NAP if is_written else min(LONG_NAP, 2.0 * self._nap)

    def _waits_for_child(self, pace: Pace) -> bool:
        """Return whether the node is silent while a child process, which has the real time, runs.

        Such as ``rostopic pub -1``, which waits for 3 s: the time of a silent node ran away.
        """
        return pace.has_children and self.silence > PAUSE / NANOSECONDS

    @property
    def _time_until_due(self) -> Optional[int]:
        """The time until the next thread of the node is due [ns]; None if unknown.

        A thread that receives reports of the car is due when the next one is.
        """
        receives = self._car.publisher.count_connections()
        return self.due_times.time_left(self.now, self._pose_period if receives else None)

    def _send(self, pace: Pace, end: int) -> None:
        """Send the next message of this instant, or advance the clock to `end` [ns]."""
        self._master.notify()  # if the node polls
        self._process(pace)
        written = next(self._pending, None)
        if written is None:
            self._pending = self.step(end)
            written = next(self._pending)
        pace.wrote(written)

    @property
    def time_left(self) -> Optional[int]:
        """The time until the next command is due [ns]; None before the first one."""
        commands = self.received.commands
        return commands[-1].arrived + COMMAND_PERIOD - self.now if commands else None

    def _process(self, pace: Optional[Pace] = None) -> bool:
        """Process the messages that have arrived; return whether there were any."""
        poses, commands = self._car.poses, self._car.commands
        count = len(poses) + len(commands)
        self.count += count
        while poses:
            self._on_initial_pose(poses.popleft())
        while commands:
            self._on_command(*commands.popleft())
            if pace:
                pace.heard()
        return count > 0

    def step(self, end: int) -> Iterator[int]:
        """Advance the clock to `end` [ns], report the states of the car, and then the time.

        Yields:
            How many threads of the node receive a message. The next one must be sent when the node
            has processed it.
        """
        period = self._pose_period
        reports = range(self.now - self.now % period + period, end + 1, period)
        for self.now in [*reports, end]:
            rospy_fixes.set_time(self.now)
            self._car.expire(self.now)
        if reports:
            states = self._car.core.states(reports, self.now)
            self.states += states
            yield from self._car.publisher.publish_each(states)
            if self._delivery:
                yield from self._delivery.give(self.now)
        self._clock.publish(Clock(clock=ros_time.time_from(self.now)))
        yield self._clock.get_num_connections()

    def describe_end(self, process: NodeProcess) -> str:
        """Receive the last messages of a node that has ended; return why it failed, "" if not."""
        wait_until_closed(self._car.inputs[CONTROL].get_num_connections, self._others.are_waiting)
        self._process()
        fault = process.describe_failure()
        if fault or self.received.commands:
            return fault
        return f"the node ended without a command on {CONTROL}; {self.topic_mistake}"

    def wait_until_rest(self) -> None:
        """Let the clock run until the car stands and its last command has expired."""
        last = max((each.time for each in self.received.commands), default=0)
        end = last + 2 * self._model.command_timeout
        while not rospy.is_shutdown():
            if self.states and self.now > end and not self.states[-1].speed:
                return
            for _ in self.step(self.now + self._pose_period):
                pass

    def recording(self, outcome: str) -> Recorded:
        """Return what was recorded, given how the node failed; "" if it did not."""
        received, master = self.received, self._master
        # A node that shuts down this process at once gets a verdict, too.
        states = self.states or [at_rest(self.now, ORIGIN)]
        contacts = [state.collision for state in states if state.collision]
        return Recorded(
            plan=self._exercise,
            car=self._model,
            outcome=outcome,
            start=received.start,
            sent=tuple(received.commands),
            stamps=np.array([state.stamp for state in states], np.int64),
            poses=np.array([state.pose for state in states], float),
            collisions=tuple(dict.fromkeys(contact.pose for contact in contacts)),
            grid=self._grid,
            actions=tuple(master.actions),
            ignored=received.ignored,
            limit=received.limit,
            start_delay=received.start_delay,
            published=tuple(sorted(master.published.items())),
            plan_is_read=master.plan_is_read,
        )

    def _on_initial_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Record an initial pose, and give it to the car."""
        if action := self.received.add_initial_pose(msg, self.now):
            self._master.record(action)
        with suppress(conversions.MessageError):
            event = conversions.initial_pose_from_msg(msg)
            self._car.core.add(event, INITIAL_POSES, self.now)

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Record a command, and give it to the mux."""
        topic = full_topic(MUX, source.topic)  # not what the sender says
        if self._delivery:  # a controller has seen the past, so no command changes it
            msg.header.stamp = max(msg.header.stamp, ros_time.time_from(self.now))
        if topic == CONTROL:
            self.received.add_command(msg, self.now)
        else:
            self._master.record(f"publishes on {topic}")
        with suppress(conversions.MessageError):
            self._car.process(msg, source, self.now)


def wait_until_closed(is_open: Callable[[], Any], are_waiting: Callable[[], bool]) -> None:
    """Wait until a connection of an ended node has been read to its end.

    Args:
        is_open: returns whether the connection is open.
        are_waiting: returns whether all threads that read wait; if they do for CLOSE_LOOKS looks,
            a child process holds the connection.
    """
    looks = 0  # that have found nothing to receive, one after another
    while is_open() and looks < CLOSE_LOOKS:
        looks = looks + 1 if are_waiting() else 0
        time.sleep(ros_time.POLL_PERIOD)


def _join(uri: str, parameters: Dict[str, Any], mux: Dict[str, Any]) -> None:
    """Set the parameters of a new master, and make this process the node of the car there."""
    os.environ["ROS_MASTER_URI"] = uri
    rospy.set_param("/use_sim_time", True)
    rospy.set_param(CAR, {**parameters, "real_time_factor": 0.0})
    rospy.set_param(MUX, mux)
    # Calls have no limit: the other side may wait for a processor, and rospy would then sleep.
    rospy_fixes.apply_before_init_node()
    rospy.init_node("car_sim", argv=[], disable_rostime=True, disable_signals=True)


def _offer_map(grid: Grid) -> None:
    """Offer a map as map_server.py does."""
    msg = conversions.grid_to_msg(grid, 0, conversions.MAP_FRAME)
    rospy.Publisher("/map", OccupancyGrid, queue_size=1, latch=True).publish(msg)
    rospy.Service("/static_map", GetMap, lambda _: msg)
