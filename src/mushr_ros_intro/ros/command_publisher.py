"""Publish commands to a car, and stop it in the end."""

import math
import threading
import time
from typing import Dict, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros import connections, conversions, node, ros_time, rospy_fixes
from mushr_ros_intro.sim.takeover import NOBODY, TakeoverMonitor


class TakeoverError(UserError):
    """Another node drives the car, or nobody can tell."""


class CommandPublisher:
    """The publisher of one input of a car's mux (ackermann_msgs/AckermannDriveStamped).

    When the node is shut down, the car is stopped: the last message is a stop.
    """

    def __init__(self, topic: str, car_name: str, active_topic: Optional[str] = None) -> None:
        """Advertise the topic.

        Args:
            topic: for the commands.
            car_name: of the car; its base frame is the frame of the commands.
            active_topic: std_msgs/String, where the mux publishes which input drives. If it is
                given,
                the node gives up when another input drives the car.
        """
        self._frame = f"{car_name}/base_footprint".lstrip("/")
        self._lock = threading.Lock()
        self._last: Optional[Command] = None
        self._written: Dict[int, int] = {}
        self._is_stopped = False
        # A stalled machine may let several commands fall due at once, and every one counts.
        self._publisher = rospy.Publisher(
            topic, AckermannDriveStamped, queue_size=100, tcp_nodelay=True
        )
        self.topic = self._publisher.resolved_name
        rospy.on_shutdown(self.stop)
        self._monitor = TakeoverMonitor(topic.rsplit("/", 1)[-1])
        self._active: Optional[str] = None
        self._active_topic = active_topic
        self._active_sub = None
        if active_topic:
            self._active_sub = rospy.Subscriber(active_topic, String, self._on_active)

    def wait_for_subscriber(self, seconds: float) -> None:
        """Wait until a node takes the commands; see connections.wait_for_subscriber."""
        connections.wait_for_subscriber(self._publisher, seconds)

    def wait_until_free(self, seconds: float, countdown: float) -> None:
        """Wait until the mux has published which input drives, and then for the countdown.

        Args:
            seconds: how long to wait for the mux [s of wall-clock time].
            countdown: how long to wait then; logged every second [s of wall-clock time].

        Raises:
            TakeoverError: the mux publishes nothing.
            rospy.ROSInterruptException: the node is shut down.
        """
        is_known = self._active_sub is None or ros_time.wait_for(
            lambda: self._active is not None, seconds
        )
        if not is_known:
            raise TakeoverError(
                f"nothing was published on {self._active_topic} within {seconds:g} s, so "
                "a takeover would not be noticed. Is the mux running, and is this its topic "
                "(rostopic list)?"
            )
        end = time.monotonic() + countdown
        for left in range(math.ceil(countdown), 0, -1):
            rospy.loginfo("the car drives in %d s; Ctrl-C cancels", left)
            ros_time.wait_for(lambda: False, end - left + 1 - time.monotonic())  # noqa: B023

    def publish(self, command: Command) -> None:
        """Publish a command.

        Raises:
            rospy.ROSInterruptException: the car has been stopped for good.
        """
        with self._lock:
            if self._is_stopped:
                raise rospy.ROSInterruptException("the car has been stopped")
            self._publish(command)

    def end(self, stamp: int) -> None:
        """Publish the stop at the end of a plan, at `stamp` [ns]; another plan may follow."""
        self.publish(Command(stamp, 0.0, 0.0))
        with self._lock:
            self._monitor = self._monitor.rest()

    def stop(self) -> None:
        """Stop the car for good if it has been driven, and wait until the stop has been sent."""
        with self._lock:
            if self._last and not self._is_stopped:
                if self._last.speed or self._last.steering_angle:
                    self._publish(Command(max(ros_time.now(), self._last.stamp), 0.0, 0.0))
                rospy_fixes.flush(self._publisher, self._written)
            self._is_stopped = True

    def _publish(self, command: Command) -> None:
        """Publish a command; needs the lock."""
        self._last = command
        self._written = rospy_fixes.count_written(self._publisher)
        self._publisher.publish(conversions.command_to_msg(command, self._frame))

    def _on_active(self, msg: String) -> None:
        """Stop the car and give up if another input drives it."""
        with self._lock:
            self._active = msg.data
            if self._is_stopped:
                return
            self._monitor = self._monitor.hear(msg.data, self._last is not None)
        if self._monitor.lost_to:
            self.stop()
            node.give_up(TakeoverError(self._takeover()))

    def _takeover(self) -> str:
        """Return the message for a car that has been lost."""
        active = self._monitor.lost_to
        why = "another node drives the car"
        if active.lower() in NOBODY:
            why = "the commands did not reach the car in time"
        text = f"{self._active_topic} is '{active}': {why}. The plan is given up"
        if not self._last:
            text = (
                f"{text}. No command has been sent. MuSHR's joystick holds the car unless its "
                "button for autonomous driving (RB) is pressed all the time"
            )
        return text
