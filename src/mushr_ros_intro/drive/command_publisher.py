"""Publish commands to a car, and stop it at the end."""

import math
import threading
import time
from contextlib import suppress
from typing import Any, Dict, Optional, Set, Tuple

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros import connections, node, ros_time, rospy_fixes
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT

MASTER_PERIOD = 0.4
"""Period at which the master is called during a drive [s of wall-clock time]."""

CLOCK_TIMEOUT = 10.0
"""Simulated time may stand still for this time if no live node publishes it [s]."""

NOBODY = ("idle", "default")
"""The active inputs, in lower case, if no input drives: MuSHR's `default` gets only stops."""


def is_taken_over(active: str, own: str, has_driven: bool) -> bool:
    """Return whether the sender of an input has lost the car.

    Args:
        active: the name of the input that drives, in lower case.
        own: the name of the sender's input, in lower case.
        has_driven: whether the sender's input has driven the car in this plan. If no input drives
            after that, the commands arrived too late.
    """
    return active != own and (has_driven or active not in NOBODY)


class CommandPublisher:
    """The publisher of one input of a car's mux (ackermann_msgs/AckermannDriveStamped).

    When the node is shut down, the car is stopped: the last message is a stop.
    """

    def __init__(self, topic: str, active_topic: Optional[str] = None) -> None:
        """Advertise the topic.

        Args:
            topic: the topic of the commands.
            active_topic: the topic on which the mux publishes the input that drives
                (std_msgs/String). If it is given, the node ends when another input drives the car.
        """
        self._lock = threading.Lock()
        self._last: Optional[AckermannDriveStamped] = None
        self._written: Dict[int, int] = {}
        self._is_stopped = False
        # On a busy machine, several commands can be due at once; none may be lost.
        self._publisher = rospy.Publisher(
            topic, AckermannDriveStamped, queue_size=100, tcp_nodelay=True
        )
        self.topic = self._publisher.resolved_name
        rospy.on_shutdown(self.stop)
        self._input = topic.rsplit("/", 1)[-1].lower()
        self._is_known = False  # which input drives
        self._has_driven = False  # this input, in this plan
        self._active_topic = active_topic
        self._mux: Dict[str, Tuple[Any, Set[int]]] = {}
        """Publishers and subscribers with the ids of their connections to the mux.

        The key is the fault if all of these connections are lost.
        """
        if active_topic:
            self._active = rospy.Subscriber(active_topic, String, self._on_active)

    def wait_for_subscriber(self, seconds: float) -> None:
        """Wait until a node subscribes to the commands; see connections.wait_for_subscriber.

        After that, `publish` fails if the connection to the mux is lost. The mux is the subscriber
        that publishes the output beside this input; if there is none, all subscribers count.
        """
        connections.wait_for_subscriber(self._publisher, seconds)
        nodes = connections.connected_nodes(self._publisher)
        muxes: Set[str] = set()
        with suppress(rosgraph.MasterException, OSError):
            output = f"{self.topic.partition('/input/')[0]}/output"
            muxes = set(connections.registered_nodes(output, "publishers"))
        nodes = {link: name for link, name in nodes.items() if name in muxes} or nodes
        names = ", ".join(sorted(nodes.values()))
        self._mux[f"{names} is no longer connected to {self.topic}"] = self._publisher, set(nodes)

    def has_subscriber(self) -> bool:
        """Return whether a node is connected, which gets the commands."""
        return bool(connections.connected_nodes(self._publisher))

    def wait_until_free(self, seconds: float, countdown: float) -> None:
        """Wait until the mux has published which input drives, and then for the countdown.

        Args:
            seconds: timeout for the mux [s of wall-clock time].
            countdown: time to wait then; logged every second [s of wall-clock time].

        Raises:
            UserError: the mux does not publish which input drives.
            rospy.ROSInterruptException: the node is shut down.
        """
        if self._active_topic and not ros_time.wait_for(lambda: self._is_known, seconds):
            raise UserError(
                f"no message was published on {self._active_topic} within {seconds:g} s, so "
                "a takeover could not be detected. Is the mux running, and is this its topic "
                "(rostopic list)?"
            )
        if self._active_topic:
            fault = f"the node that published {self._active_topic} is no longer connected"
            self._mux[fault] = self._active, set(connections.connected_nodes(self._active))
        threading.Thread(target=self._watch, daemon=True).start()
        end = time.monotonic() + countdown
        for left in range(math.ceil(countdown), 0, -1):
            rospy.loginfo("the car starts to drive in %d s; Ctrl-C cancels", left)
            ros_time.wait_for(lambda: False, end - left + 1 - time.monotonic())  # noqa: B023

    def publish(self, msg: AckermannDriveStamped) -> None:
        """Publish a command.

        Raises:
            UserError: the connection to the mux is lost, even if a new mux is connected.
            rospy.ROSInterruptException: `stop` has been called.
        """
        with self._lock:
            if self._is_stopped:
                raise rospy.ROSInterruptException("the car has been stopped")
            for fault, (end, links) in self._mux.items():
                if links.isdisjoint(connections.connected_nodes(end)):
                    raise UserError(
                        f"{fault}, so the commands and the stop may not reach the car. It may "
                        "drive on. Did the mux end or restart, or was the network cut (rosnode "
                        "list)? The drive ends"
                    )
            self._publish(msg)

    def end(self, stamp: int) -> None:
        """Publish the stop at the end of a plan, at `stamp` [ns]; another plan may follow."""
        assert self._last  # a plan has at least one row
        self.publish(_stop_after(self._last, stamp))
        with self._lock:
            self._has_driven = False  # the mux may then be idle

    def stop(self) -> None:
        """Stop the car if a command has been sent; flush the stop, and refuse later commands."""
        with self._lock:
            if self._last and not self._is_stopped:
                if self._last.drive.speed or self._last.drive.steering_angle:
                    stamp = max(ros_time.now(), self._last.header.stamp.to_nsec())
                    self._publish(_stop_after(self._last, stamp))
                rospy_fixes.flush(self._publisher, self._written)
            self._is_stopped = True

    def _watch(self) -> None:
        """End the drive if the master or the clock is lost, in a thread: a call takes up to 5 s.

        If the network is cut, no command arrives, and TCP reports no error for minutes. Without
        simulated time, no command is due any more.
        """
        clock = rospy.Subscriber("/clock", Clock) if ros_time.is_simulated() else None
        seen, since = 0, time.monotonic()
        while not self._is_stopped:
            time.sleep(MASTER_PERIOD)
            now = ros_time.now()
            if now != seen:
                seen, since = now, time.monotonic()
            lost = ""
            # rospy of Debian 11 stays connected, and tries to connect again.
            stands = time.monotonic() > since + CLOCK_TIMEOUT and connections.is_dead("/clock")
            if clock and (stands or not connections.connected_nodes(clock)):
                lost = "simulated time stands still: the node that published /clock has ended"
            try:
                ask(rosgraph.get_master_uri(), CALL_TIMEOUT, rospy.get_name(), "getPid")
            except CallError as error:
                if error.fault is not CallFault.REFUSED:  # else it has ended; nodes stay connected
                    lost = f"{error}. The master is suspended, or the network to the master is cut"
            if lost and not self._is_stopped:
                node.end_with_error(UserError(f"{lost}. The drive ends"))
                return

    def _publish(self, msg: AckermannDriveStamped) -> None:
        """Publish a command; needs the lock."""
        self._last = msg
        self._written = rospy_fixes.count_written(self._publisher)
        self._publisher.publish(msg)

    def _on_active(self, msg: String) -> None:
        """Stop the car and end the node if another input drives the car."""
        active = msg.data.strip() or NOBODY[0]
        with self._lock:
            self._is_known = True
            is_lost = is_taken_over(active.lower(), self._input, self._has_driven)
            if self._is_stopped or not is_lost:
                self._has_driven |= active.lower() == self._input and self._last is not None
                return
        # First the error: after the stop, the node's thread ends without one.
        node.end_with_error(UserError(self._takeover(active)))
        self.stop()

    def _takeover(self, active: str) -> str:
        """Return the message for a takeover by the input `active`."""
        why = "another input drives the car"
        if active.lower() in NOBODY:
            why = "the commands did not reach the car in time"
        text = f"{self._active_topic} is '{active}': {why}. The drive ends"
        if not self._last:
            text = (
                f"{text}. No command has been sent. MuSHR's joystick node sends stops unless its "
                "button for autonomous driving (RB) is pressed all the time"
            )
        return text


def _stop_after(last: AckermannDriveStamped, stamp: int) -> AckermannDriveStamped:
    """Return a stop with the stamp `stamp` [ns], in the frame of the last command."""
    msg = AckermannDriveStamped()
    msg.header.stamp, msg.header.frame_id = ros_time.time_from(stamp), last.header.frame_id
    return msg
