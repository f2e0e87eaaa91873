"""Record the messages of a node that drives the simulated car, and forward them to the car."""

import contextlib
import threading
import time
from functools import partial
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

CAR = "/car/car_sim"
CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
POSES = "/car/car_pose"
INITIAL_POSES = "/initialpose"
COLLISIONS = "/car/car_sim/collision"
MAP = "/map"

START_TIMEOUT = 60.0
"""Timeout for the car and the mux, which start together with this node [s of wall-clock time]."""

INITIAL_POSE_TIMEOUT = 0.3
"""Longest wait of the first command for the initial pose [s of wall-clock time]."""

STEP = 0.02
"""Time between two steps of a held clock [s of wall-clock time]; equal to the pose period."""


class ReplayObserver:
    """Records the messages of the node and of the car.

    The node is started with its command topic and its initial pose topic remapped to topics of this
    process, which forwards the messages. So every recorded message reaches the car, even if the
    machine is busy and the node's queue is short, or if the node sends before the car is connected.

    This process holds the car's clock and steps it in real time until the first message of the
    node, and again after `take_clock`. So a delay of this process also delays the node's clock, and
    the clock does not wait for commands after the last one.
    """

    def __init__(self, has_map: bool) -> None:
        """Subscribe, and wait until the car and the mux are connected, and for the map if any.

        Raises:
            UserError: they are not connected in time.
        """
        self.sent: List[Sent] = []
        """The commands in order of arrival."""
        self.last_message = 0.0
        """When the node sent its last message [s of monotonic wall-clock time]."""
        self._initial_poses: List[Pose] = []
        self._poses: List[Tuple[int, Pose]] = []
        self._collisions: List[Pose] = []
        self._grid: Optional[Grid] = None
        self._holds_clock = threading.Event()
        self._holds_clock.set()
        self._is_placed = threading.Event()

        publish = partial(rospy.Publisher, queue_size=1000, tcp_nodelay=True)
        subscribe = partial(rospy.Subscriber, tcp_nodelay=True)
        self._commands_pub = publish(CONTROL, AckermannDriveStamped)
        self._initial_pose_pub = publish(INITIAL_POSES, PoseWithCovarianceStamped)
        subscribe(POSES, PoseStamped, self._on_pose)
        wait_for(lambda: self._poses, f"a pose on {POSES}")
        for publisher in (self._commands_pub, self._initial_pose_pub):
            wait_for(publisher.get_num_connections, f"a subscriber to {publisher.resolved_name}")
        collisions = subscribe(COLLISIONS, PoseArray, self._on_collision)
        wait_for(collisions.get_num_connections, f"a publisher of {COLLISIONS}")
        if has_map:
            subscribe(MAP, numpy_msg(OccupancyGrid), self._on_map)
            wait_for(lambda: self._grid is not None, f"a message on {MAP}")
        self._initial_pose_sub = subscribe(
            "~start_pose", PoseWithCovarianceStamped, self._on_initial_pose
        )
        commands = subscribe("~commands", AckermannDriveStamped, self._on_command)
        self.remappings = {
            INITIAL_POSES: self._initial_pose_sub.resolved_name,
            CONTROL: commands.resolved_name,
        }
        """The remappings of the node: the topics of this process by the names of the car's."""
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
        with contextlib.suppress(rospy.ServiceException, rospy.ROSException):  # at the shutdown
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
        is_first = not self.sent
        if is_first and self._initial_pose_sub.get_num_connections():
            self._is_placed.wait(INITIAL_POSE_TIMEOUT)
        stamp = msg.header.stamp.to_nsec()
        taken = ros_time.received_stamp(stamp)
        self.sent.append(Sent(taken, taken == stamp, msg.drive.speed, msg.drive.steering_angle))
        self.last_message = time.monotonic()
        self._commands_pub.publish(msg)
        if is_first:
            self._holds_clock.clear()

    def _on_initial_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Record an initial pose and forward it unchanged."""
        try:
            pose = conversions.pose_from_msg(msg.pose.pose)
        except conversions.MessageError:
            pose = Pose(*3 * [float("nan")])
        self._initial_poses.append(pose)
        self.last_message = time.monotonic()
        self._initial_pose_pub.publish(msg)
        self._holds_clock.clear()
        self._is_placed.set()

    def _on_pose(self, msg: PoseStamped) -> None:
        """Record a pose of the car."""
        self._poses.append((msg.header.stamp.to_nsec(), conversions.pose_from_msg(msg.pose)))

    def _on_collision(self, msg: PoseArray) -> None:
        """Record the pose of a collision; an empty message means that there is none."""
        self._collisions += map(conversions.pose_from_msg, msg.poses)

    def _on_map(self, msg: OccupancyGrid) -> None:
        """Record the map."""
        self._grid = conversions.grid_from_msg(msg)

    def stands(self, timeout: int) -> bool:
        """Return whether the car is at rest and its last command has expired.

        Args:
            timeout: how long a command is valid after its stamp [ns].
        """
        stamp, pose = self._poses[-1]
        recent = [each for when, each in self._poses[-1000:] if when >= stamp - timeout]
        return stamp > self.sent[-1].time + 2 * timeout and all(each == pose for each in recent)

    def replay(self, plan: Plan, car: Car, outcome: str) -> Replay:
        """Return the recorded messages.

        Args:
            plan: the plan that the node had to drive.
            car: the car.
            outcome: a description of the node's failure; empty if there is none.
        """
        stamps, poses = zip(*self._poses)
        return Replay(
            plan=plan,
            car=car,
            outcome=outcome,
            starts=tuple(self._initial_poses),
            sent=tuple(self.sent),
            stamps=np.array(stamps, np.int64),
            poses=np.array(poses, float),
            collisions=tuple(self._collisions),
            grid=self._grid,
        )


def wait_for(condition: Callable[[], Any], what: str) -> None:
    """Wait until a condition is true.

    Raises:
        UserError: the condition is still false after START_TIMEOUT; the message contains `what`.
    """
    if not ros_time.wait_for(condition, START_TIMEOUT):
        raise UserError(f"waited {START_TIMEOUT:g} s for {what}")
