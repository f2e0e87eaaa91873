"""Select one of several command inputs for the car."""

import math
import threading
import time
from typing import Dict, NamedTuple

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.simulator.mux import Input, Mux, full_topic, read_config
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS, CurrentTime

LATE_AFTER = COMMAND_PERIOD // 2
"""If a command arrives later than this after its stamp, its timeout counts from its arrival [ns].

In wall-clock time only. So a sender with a late clock can drive the car.
"""


class WithoutStamp(NamedTuple):
    """The newest command without a valid stamp; it counts from its arrival."""

    expires: int = -1
    """When it expires [ns]; -1 if there was no such command."""
    min_wall: float = -math.inf
    """It does not expire before this wall-clock time [s, monotonic]."""


class AckermannCmdMux:
    """The mux as a node.

    The parameters below its name are the configuration, and its topics are below its name: the
    input ``input/navigation`` of /car/mux/ackermann_cmd_mux is the topic
    /car/mux/ackermann_cmd_mux/input/navigation. Publishes the name of the input that drives on
    ``active`` below its name, and a stop when the last live input expires.

    Example: ``roslaunch mushr_ros_intro sim.launch`` starts it with config/ackermann_cmd_mux.yaml
    """

    def __init__(self, name: str = "") -> None:
        """Subscribe to the inputs; `name` is the name of the node if it is empty."""
        with node.parameters(name or "~") as parameters:
            config = read_config(parameters)
        self._name = name or rospy.get_name()
        self._lock = threading.Lock()
        self._is_live = threading.Event()
        self._mux = Mux()
        self._time = CurrentTime()
        self._without_stamp = WithoutStamp()
        self._frame = ""
        self._announced = ""

        self._output_pub = rospy.Publisher(
            full_topic(self._name, config.publisher),
            AckermannDriveStamped,
            queue_size=100,
            tcp_nodelay=True,
        )
        # On a busy machine, another node must see each change.
        self._active_pub = rospy.Publisher(
            f"{self._name}/active", String, queue_size=100, latch=True
        )
        self._announce()

        # Connect the output before the inputs, so that no command of a connected sender is lost.
        wait_until_connected(self._output_pub, "subscribers")
        self.inputs: Dict[str, rospy.Subscriber] = {}
        """The subscribers by topic."""
        for each in config.inputs:
            topic = full_topic(self._name, each.topic)
            self.inputs[topic] = rospy.Subscriber(
                topic, AckermannDriveStamped, self._on_command, each, tcp_nodelay=True
            )
            rospy.loginfo(
                f"input {each.name}: {topic}, priority {each.priority}, "
                f"timeout {each.timeout / NANOSECONDS:g} s"
            )

    def _send(self, msg: AckermannDriveStamped) -> None:
        """Send a message to the car; a replay overrides this method to record the message."""
        self._output_pub.publish(msg)

    def run(self) -> None:
        """Send a stop whenever the last live input expires, until the node is shut down."""
        while not rospy.is_shutdown():
            if not self._is_live.wait(ros_time.SHUTDOWN_POLL_PERIOD):
                continue
            with self._lock:
                seen = ros_time.now()
                now = self._read_clock()
                self._expire(now)
                deadline = self._mux.deadline or seen
                held = self._held()
            if deadline <= now and held > 0.0:
                time.sleep(min(held, ros_time.SHUTDOWN_POLL_PERIOD))
            else:  # returns early if the clock is set back
                ros_time.sleep_until(deadline, seen)

    def _held(self) -> float:
        """Return how long no input may expire [s of wall-clock time]; needs the lock.

        A command without a valid stamp counts from its arrival. In lock-step, this node's clock may
        be seconds late at that time and then advance at once, and the command would expire at once.
        So such a command is valid for at least its timeout in wall-clock time, too.
        """
        newest = self._without_stamp
        return newest.min_wall - time.monotonic() if self._mux.deadline == newest.expires else 0.0

    def _expire(self, now: int) -> None:
        """Send a stop if the last live input has expired at `now` [ns]; needs the lock."""
        if self._held() > 0.0:
            return
        has_stamp = self._mux.deadline != self._without_stamp.expires
        self._mux, stop = self._mux.expire(now)
        if stop is not None:
            self._is_live.clear()
            # A stop without a stamp applies on arrival. A command that arrives later, but has an
            # earlier stamp, replaces it (see car/history.py).
            stamp = stop if has_stamp and ros_time.is_simulated() else 0
            self._output_pub.publish(
                conversions.command_to_msg(Command(stamp, 0.0, 0.0), self._frame)
            )
            self._announce()

    def _read_clock(self) -> int:
        """Return the time [ns]; needs the lock. If the clock was set back, all inputs expire."""
        if self._time.update(ros_time.now()):
            rospy.logwarn("the clock was set back; all inputs expire")
            self._mux = self._mux.restart(self._time.now)
        return self._time.now

    @conversions.ignore_bad_messages
    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Forward a command unchanged if its input may drive."""
        command = conversions.command_from_msg(msg)
        with self._lock:
            now = self._read_clock()
            stamp = ros_time.received_stamp(command.stamp)
            has_stamp = command.stamp == stamp
            begin, until = stamp, stamp + source.timeout
            if ros_time.is_simulated():
                until += 0 if has_stamp else source.timeout
            else:
                begin = min(stamp, now)  # the stamp is in the future if the sender's clock is early
                if now > stamp + LATE_AFTER:
                    until = now + source.timeout
            # Expire first. In simulated time, the output then depends on the stamps alone.
            self._expire(begin)
            self._mux, passes = self._mux.command(source, begin, until)
            if not has_stamp and self._mux.deadline == until:
                min_wall = time.monotonic() + source.timeout / NANOSECONDS
                self._without_stamp = WithoutStamp(until, min_wall)
            if passes:
                self._frame = msg.header.frame_id
                self._send(msg)
                self._announce()
            self._is_live.set()

    def _announce(self) -> None:
        """Publish the name of the input that drives if it has changed."""
        if self._mux.active != self._announced:
            self._announced = self._mux.active
            self._active_pub.publish(String(data=self._announced))
