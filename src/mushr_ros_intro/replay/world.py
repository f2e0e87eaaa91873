"""The world of a replay: a master, the simulated car, its mux and a map, all in this process.

The node under test sees the usual topics, services and parameters. But the car receives nothing
from ROS except initial poses and the commands on the inputs of the mux, and everything is recorded
here. So the node cannot change the recording, nor move the car by other means.
"""

import os
import threading
import time
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Optional, Sequence, Tuple

import numpy as np
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid

from mushr_ros_intro.car.model import Command, State
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.guarded_master import GuardedMaster
from mushr_ros_intro.replay.node_process import Sample, receiving_activity
from mushr_ros_intro.replay.recording import Sent
from mushr_ros_intro.ros import conversions, node, ros_time, rospy_fixes
from mushr_ros_intro.simulator.ackermann_cmd_mux import AckermannCmdMux
from mushr_ros_intro.simulator.car_sim import CarSim
from mushr_ros_intro.simulator.mux import Input
from mushr_ros_intro.simulator.sim_clock import OwnClock
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE
from mushr_ros_intro.world.grid import Grid

CAR = "/car/car_sim"
MUX = "/car/mux/ackermann_cmd_mux"
CONTROL = f"{MUX}/input/navigation"
INITIAL_POSES = "/initialpose"
PREDICTED_PATH = "/car/predicted_path"

INITIAL_POSE_TIMEOUT = 1.0
"""How long the first command waits for an initial pose [s of wall-clock time]."""

MAX_STEP = 0.5
"""A held clock is stepped after this time, even if the node is not idle [s of wall-clock time]."""

IDLE_SAMPLE = 0.002
"""Time between two samples of a node's activity [s of wall-clock time]."""

CLOSE_TIMEOUT = 1.0
"""Longest wait until the connections of an ended node are closed [s of wall-clock time]."""


class ReplayWorld:
    """The world of one replay. A process can create it only once.

    The clock is held until the first command of the node, and again after `hold_clock`. A held
    clock is stepped whenever the node is connected and idle, and its messages are processed. So the
    drive is the same on a fast and on a busy machine, because computing takes no simulated time,
    and a sleeping node wakes up soon.
    """

    def __init__(
        self, parameters: Dict[str, Any], mux: Dict[str, Any], grid: Optional[Grid]
    ) -> None:
        """Start the nodes.

        Args:
            parameters: of the car.
            mux: the configuration of the mux.
            grid: the map, or None.
        """
        self.sent: List[Sent] = []
        """The commands on CONTROL in order of arrival."""
        self.last_message = time.monotonic()
        """When the node sent its last message [s of monotonic wall-clock time]."""
        self.start: Optional[Pose] = None
        """The last initial pose before the first command; NaN if its numbers are unusable."""
        self.ignored = ""
        """The first message that the car ignored, and the reason; empty if there was none."""
        self.states: List[State] = []
        """The reported states of the car."""
        self._is_placed = threading.Event()
        self._is_held = threading.Event()
        self._is_held.set()
        self._step_lock = threading.Lock()

        self._master = GuardedMaster()
        _join(self._master.serve(0), parameters, mux)
        rospy.on_shutdown(lambda: self._master.record(f"shuts down the node {CAR}"))
        self._car = _Car(self)
        if grid is not None:
            maps = rospy.Publisher("/map", OccupancyGrid, queue_size=1, latch=True)
            maps.publish(conversions.grid_to_msg(grid, 0, conversions.MAP_FRAME))
            self._car.use_map(grid)
        rospy_fixes.set_time(self._car.clock.read())
        self._mux = _Mux(self)
        self._master.guard(
            CAR,
            ("/use_sim_time", CAR, MUX),
            (CONTROL, INITIAL_POSES, PREDICTED_PATH, "/rosout", "/tf", "/tf_static"),
        )
        for target in (self._car.run, self._mux.run):
            threading.Thread(target=target, daemon=True).start()

    def follow(self, activity: Callable[[], Optional[int]]) -> None:
        """Begin to step the held clock; `activity` is that of the node, see `NodeProcess`."""
        threading.Thread(target=self._step_clock, args=[activity], daemon=True).start()

    @property
    def actions(self) -> Tuple[str, ...]:
        """What the node did besides driving the car, each action once."""
        return tuple(self._master.actions)

    @property
    def is_alive(self) -> bool:
        """Whether the simulated car runs."""
        return not rospy.is_shutdown()

    def publications(self) -> List[str]:
        """Return the topics of the node under test."""
        publishers = self._master.getSystemState("/")[2][0]
        return sorted(topic for topic, names in publishers if set(names) - {CAR})

    def hold_clock(self) -> None:
        """Hold the clock until the next command."""
        self._is_held.set()

    @property
    def silence(self) -> float:
        """The time since the node's last command, or since the start [s of simulated time]."""
        begin = self.sent[-1].time if self.sent else self.states[0].stamp
        return (self._car.clock.read() - begin) / NANOSECONDS

    def release_clock(self) -> None:
        """Let the clock run."""
        if self._is_held.is_set():
            with self._step_lock:
                self._is_held.clear()
                self._car.clock.control(False)

    def _step_clock(self, activity: Callable[[], Optional[int]]) -> None:
        """Step the clock while it is held, whenever the node is idle."""
        while self._is_held.wait():
            self._step()
            deadline = time.monotonic() + MAX_STEP
            idle = 0  # samples in a row; a node that polls needs a moment to notice the new time
            before = Sample(0.0, None, None)
            while idle < 2 and time.monotonic() < deadline:
                # First the node: its messages make the receiving threads run.
                now = Sample(time.monotonic(), activity(), receiving_activity())
                time.sleep(IDLE_SAMPLE)
                idle = idle + 1 if now.is_idle_since(before) and self._is_connected() else 0
                before = now

    def _is_connected(self) -> bool:
        """Return whether all publishers of commands and initial poses are connected.

        A node may sleep while ROS connects it, so the clock has to wait.
        """
        subscribers = (self._mux.inputs[CONTROL], self._car.initial_poses)
        return all(
            each.get_num_connections() >= self._master.count_publishers(each.resolved_name)
            for each in subscribers
        )

    def _step(self) -> None:
        """Step the clock if it is held."""
        with self._step_lock:
            if self._is_held.is_set():
                clock = self._car.clock.publisher
                written = rospy_fixes.count_written(clock)
                self._car.clock.control(True, step=True)
                rospy_fixes.flush(clock, written, MAX_STEP)

    def wait_until_rest(self, timeout: int) -> None:
        """Let the clock run until the car stands and its last command has expired.

        The node under test must have ended.

        Args:
            timeout: how long a command is valid after its stamp [ns].
        """
        ros_time.wait_for(
            lambda: not self._mux.inputs[CONTROL].get_num_connections(), CLOSE_TIMEOUT
        )
        self.hold_clock()
        while self.is_alive and not self._stands(timeout):
            self._step()

    def _stands(self, timeout: int) -> bool:
        """Return whether the car is at rest and its last command has expired."""
        if not self.states:
            return False
        if not self.sent:
            return True
        stamp, pose = self.states[-1].stamp, self.states[-1].pose
        recent = [each.pose for each in self.states[-1000:] if each.stamp >= stamp - timeout]
        return stamp > self.sent[-1].time + 2 * timeout and all(each == pose for each in recent)

    def recording(self) -> Tuple[List[State], np.ndarray, np.ndarray, Tuple[Pose, ...]]:
        """Return the states of the car when it reported them, corrected by late commands.

        Also return their stamps [ns] and poses, and the poses at which the car hit a wall.
        """
        states = self._car.corrected_states()
        stamps = np.array([state.stamp for state in states], np.int64)
        poses = np.array([state.pose for state in states], float)
        contacts = [state.collision for state in states if state.collision]
        return states, stamps, poses, tuple(dict.fromkeys(contact.pose for contact in contacts))

    def on_states(self, states: List[State], now: int) -> None:
        """Record states of the car; `now` is the time to which the clock advances [ns]."""
        self.states += states
        rospy_fixes.set_time(now)

    def on_initial_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Record an initial pose, and give it to the car."""
        try:
            pose = conversions.initial_pose_from_msg(msg).pose
        except conversions.MessageError as error:
            pose = Pose(*3 * [float("nan")])
            self._ignore(INITIAL_POSES, error)
        if self.sent and self.start:
            self._master.record(f"places the car again, at {pose}")
        else:
            self.start = pose
        self.last_message = time.monotonic()
        self._car.on_message(msg, conversions.initial_pose_from_msg)
        self._is_placed.set()

    def on_command(self, msg: AckermannDriveStamped, topic: str) -> None:
        """Record a command.

        The first command waits for the initial pose, which the node sends earlier over another
        connection.
        """
        self.last_message = time.monotonic()
        if topic != CONTROL:
            self._master.record(f"sends commands on {topic}")
            return
        if not self.sent and self._car.initial_poses.get_num_connections():
            self._is_placed.wait(INITIAL_POSE_TIMEOUT)
        stamp = msg.header.stamp.to_nsec()
        taken = ros_time.received_stamp(stamp)
        self.sent.append(Sent(taken, taken == stamp, msg.drive.speed, msg.drive.steering_angle))
        try:
            conversions.command_from_msg(msg)
        except conversions.MessageError as error:
            self._car.skip(taken)
            self._ignore(CONTROL, error)

    def _ignore(self, topic: str, error: conversions.MessageError) -> None:
        self.ignored = self.ignored or f"a message on {topic}: {error}"

    def on_output(self, msg: AckermannDriveStamped) -> None:
        """Give a command from the mux to the car."""
        self._car.on_message(msg, conversions.command_from_msg)


def _join(uri: str, parameters: Dict[str, Any], mux: Dict[str, Any]) -> None:
    """Set the parameters of a new master, and make this process the node of the car there."""
    os.environ["ROS_MASTER_URI"] = uri
    rospy.set_param("/use_sim_time", True)
    rospy.set_param(CAR, {**parameters, "real_time_factor": 0.0})
    rospy.set_param(MUX, mux)
    argv = [f"initialpose:={INITIAL_POSES}"]
    node.init_node("car_sim", argv=argv, disable_rostime=True, disable_signals=True)


class _Car(CarSim):
    """The simulated car, which receives commands and the map from the world."""

    clock: OwnClock

    def __init__(self, recorder: ReplayWorld) -> None:
        self._recorder = recorder
        self._corrected: List[State] = []
        self._reported: Deque[int] = deque()  # instants whose states late commands may still change
        super().__init__(publishes_clock=True)

    def _subscribe(self) -> None:
        self.initial_poses = rospy.Subscriber(
            "initialpose",
            PoseWithCovarianceStamped,
            self._recorder.on_initial_pose,
            tcp_nodelay=True,
        )

    def skip(self, stamp: int) -> None:
        """Let the clock advance as after a command, although the command is ignored."""
        with self._changed:
            self.clock.on_event(Command(stamp, 1.0, 0.0))

    def _evaluate(self, instants: Sequence[int]) -> List[State]:
        """Return the car's state at instants [ns]; needs the lock."""
        self._correct(instants[-1] - STAMP_TOLERANCE if instants else 0)
        self._reported += instants
        return super()._evaluate(instants)

    def _correct(self, until: int) -> None:
        """Keep the states that were reported until an instant [ns], as they are now."""
        while self._reported and self._reported[0] <= until:
            self._corrected.append(self._history.state_at(self._reported.popleft()))

    def corrected_states(self) -> List[State]:
        """Return the states of the car when it reported them, corrected by late commands."""
        with self._changed:
            if self._reported:
                self._correct(self._reported[-1])
            return list(self._corrected)

    def run(self) -> None:
        """Report the car's state, to the world too."""
        self.clock.run(self._evaluate, self._record)

    def _record(self, states: List[State]) -> None:
        self._recorder.on_states(states, self.clock.read())
        self._publisher.publish(states)


class _Mux(AckermannCmdMux):
    """The mux, which gives its output to the world too."""

    def __init__(self, recorder: ReplayWorld) -> None:
        self._recorder = recorder
        super().__init__(MUX)

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        self._recorder.on_command(msg, self._resolve(source.topic))
        super()._on_command(msg, source)
        self._recorder.release_clock()

    def _send(self, msg: AckermannDriveStamped) -> None:
        super()._send(msg)
        msg._connection_header = {"topic": self._output_pub.resolved_name}
        self._recorder.on_output(msg)
