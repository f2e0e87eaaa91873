"""Record the messages of a node that drives the simulated car, and forward them to the car."""

import contextlib
import threading
import time
from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg
from std_srvs.srv import Trigger

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.grading.replay import Replay, Sent
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.world.grid import Grid

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
POSES = "/car/car_pose"
INITIAL_POSES = "/initialpose"
COLLISIONS = "/car/car_sim/collision"
MAP = "/map"

INITIAL_POSE_TIMEOUT = 0.3
"""Longest wait of the first command for the initial pose [s of wall-clock time]."""

STEP = 0.02
"""Time between two steps of a held clock [s of wall-clock time]; equal to the pose period."""


class ObservationError(UserError):
    """A failed replay that is not the node's fault."""


class ReplayObserver:
    """Records the messages of the node and of the car.

    The node is started with its command topic and its initial pose topic remapped to topics of this
    process, which forwards the messages. So every recorded message reaches the car, even if the
    machine is busy and the node's queue is short, or if the node sends before the car is connected.

    This process holds the car's clock and steps it in real time until the first message of the
    node, and again after `take_clock`. So a delay of this process also delays the node's clock, and
    the clock does not wait for commands after the last one.
    """

    def __init__(self, patience: float, has_map: bool) -> None:
        """Subscribe, and wait until the car and the mux are connected, and for the map if any.

        Raises:
            ObservationError: they are not connected within `patience` [s of wall-clock time].
        """
        self._lock = threading.Lock()
        self._sent: List[Sent] = []
        self._initial_poses: List[Pose] = []
        self._poses: List[Tuple[int, Pose]] = []
        self._collisions: List[Pose] = []
        self._grid: Optional[Grid] = None
        self._holds_clock = threading.Event()
        self._holds_clock.set()
        self._is_placed = threading.Event()
        self.last_message = time.monotonic()
        """When the node sent its last message [s of monotonic wall-clock time]."""

        self._commands_pub, self._initial_pose_pub = (
            rospy.Publisher(topic, kind, queue_size=1000, tcp_nodelay=True)
            for topic, kind in (
                (CONTROL, AckermannDriveStamped),
                (INITIAL_POSES, PoseWithCovarianceStamped),
            )
        )
        _subscribe(POSES, PoseStamped, self._on_pose)
        wait_for(lambda: self.count_poses() > 0, f"a pose on {POSES}", patience)
        for publisher in (self._commands_pub, self._initial_pose_pub):
            topic = publisher.resolved_name
            wait_for(publisher.get_num_connections, f"a subscriber to {topic}", patience)
        published = {topic for topic, _ in rospy.get_published_topics()}
        self._reports_collisions = COLLISIONS in published
        if self._reports_collisions:
            collisions = _subscribe(COLLISIONS, PoseArray, self._on_collision)
            wait_for(collisions.get_num_connections, f"a publisher of {COLLISIONS}", patience)
        if has_map:
            _subscribe(MAP, numpy_msg(OccupancyGrid), self._on_map)
            wait_for(lambda: self._grid is not None, f"a message on {MAP}", patience)
        self._initial_pose_sub = _subscribe(
            "~start_pose", PoseWithCovarianceStamped, self._on_initial_pose
        )
        commands = _subscribe("~commands", AckermannDriveStamped, self._on_command)
        self.remappings = [
            f"{INITIAL_POSES}:={self._initial_pose_sub.resolved_name}",
            f"{CONTROL}:={commands.resolved_name}",
        ]
        """Arguments for the node."""
        threading.Thread(target=self._step_clock, daemon=True).start()

    def take_clock(self) -> None:
        """Hold the car's clock from now on, and step it in real time."""
        self._holds_clock.set()

    def _step_clock(self) -> None:
        """Step the car's clock while it is held."""
        step, resume = (
            rospy.ServiceProxy(f"/car/car_sim/{name}", Trigger, persistent=True)
            for name in ("step", "resume")
        )
        # If the car has died, no pose arrives; the test node reports this.
        with contextlib.suppress(rospy.ServiceException, rospy.ROSException):
            while not rospy.is_shutdown():
                step()
                time.sleep(STEP)
                if not self._holds_clock.is_set():
                    resume()
                    self._holds_clock.wait()

    def _on_command(self, msg: AckermannDriveStamped) -> None:
        """Record a command and forward it unchanged.

        The first command waits for the initial pose, which the node sends earlier over another
        connection.
        """
        if self._initial_pose_sub.get_num_connections() and not self.count_commands():
            self._is_placed.wait(INITIAL_POSE_TIMEOUT)
        stamp = msg.header.stamp.to_nsec()
        taken = ros_time.received_stamp(stamp)
        sent = Sent(taken, taken == stamp, msg.drive.speed, msg.drive.steering_angle)
        with self._lock:
            self._sent.append(sent)
            self.last_message = time.monotonic()
            is_first = len(self._sent) == 1
        self._commands_pub.publish(msg)
        if is_first:
            self._holds_clock.clear()

    def _on_initial_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Record an initial pose and forward it unchanged."""
        try:
            pose = conversions.pose_from_msg(msg.pose.pose)
        except conversions.MessageError:
            pose = Pose(*3 * [float("nan")])
        with self._lock:
            self._initial_poses.append(pose)
            self.last_message = time.monotonic()
        self._initial_pose_pub.publish(msg)
        self._holds_clock.clear()
        self._is_placed.set()

    def _on_pose(self, msg: PoseStamped) -> None:
        """Record a pose of the car."""
        with self._lock:
            self._poses.append((msg.header.stamp.to_nsec(), conversions.pose_from_msg(msg.pose)))

    def _on_collision(self, msg: PoseArray) -> None:
        """Record the pose of a collision; an empty message means that there is none."""
        with self._lock:
            self._collisions += map(conversions.pose_from_msg, msg.poses)

    def _on_map(self, msg: OccupancyGrid) -> None:
        """Record the map."""
        self._grid = conversions.grid_from_msg(msg)

    def count_poses(self) -> int:
        """Return how many poses the car has reported."""
        with self._lock:
            return len(self._poses)

    def count_commands(self) -> int:
        """Return how many commands the node has sent."""
        with self._lock:
            return len(self._sent)

    def span(self) -> int:
        """Return the time between the stamps of the first and the last command [ns]."""
        with self._lock:
            return self._sent[-1].time - self._sent[0].time if self._sent else 0

    def stands(self, timeout: int) -> bool:
        """Return whether the car is at rest and its last command has expired.

        Args:
            timeout: how long a command is valid after its stamp [ns].
        """
        with self._lock:
            last = self._sent[-1].time if self._sent else 0
            stamp, pose = self._poses[-1]
            recent = [each for when, each in self._poses[-1000:] if when >= stamp - timeout]
        return stamp > last + 2 * timeout and all(each == pose for each in recent)

    def replay(self, plan: Plan, car: Car, outcome: str) -> Replay:
        """Return the recorded messages.

        Args:
            plan: the plan that the node had to drive.
            car: the car.
            outcome: a description of the node's failure; empty if there is none.
        """
        with self._lock:
            return Replay(
                plan=plan,
                car=car,
                outcome=outcome,
                starts=tuple(self._initial_poses),
                sent=tuple(self._sent),
                stamps=np.array([stamp for stamp, _ in self._poses], np.int64),
                poses=np.array([pose for _, pose in self._poses], float).reshape(-1, 3),
                collisions=tuple(self._collisions) if self._reports_collisions else None,
                grid=self._grid,
            )


def _subscribe(
    topic: str, kind: Any, callback: Callable[[rospy.Message], None]
) -> rospy.Subscriber:
    """Subscribe to a topic without delay (TCP_NODELAY)."""
    return rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)


def wait_for(condition: Callable[[], Any], what: str, seconds: float) -> None:
    """Wait until a condition is true.

    Raises:
        ObservationError: the condition is still false after `seconds` of wall-clock time; the
            message contains `what`.
    """
    if not ros_time.wait_for(condition, seconds):
        raise ObservationError(f"waited {seconds:g} s for {what}")
