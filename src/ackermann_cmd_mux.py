#!/usr/bin/python3
"""Choose which of several command inputs drives the car."""

import sys
import threading
import time
from contextlib import suppress

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.ros.sim_time import sleep_until
from mushr_ros_intro.sim.mux import ConfigError, Input, Mux, parse_config, sent_at
from mushr_ros_intro.sim.stamps import NANOSECONDS, STAMP_TOLERANCE

_LOOK_EVERY = 0.5  # [s of wall-clock time] whether the node is shut down


class AckermannCmdMux:
    """The mux as a node.

    Its private parameters are the configuration; the topics in it are private names, so an input
    ``input/navigation`` of the node /car/mux/ackermann_cmd_mux is the topic
    /car/mux/ackermann_cmd_mux/input/navigation. Publishes the winner's name on ``~active``.
    """

    def __init__(self) -> None:
        self._config = parse_config(rospy.get_param("~", {}))
        self._lock = threading.Lock()
        self._live = threading.Event()
        self._mux = Mux()
        self._now = 0
        # When a command runs out [ns] of which the time is a guess, and until when it does not [s].
        self._guess = (-1, 0.0)
        self._frame = ""
        self._announced = ""

        self._output_pub = rospy.Publisher(
            _private(self._config.publisher),
            AckermannDriveStamped,
            queue_size=100,
            tcp_nodelay=True,
        )
        self._active_pub = rospy.Publisher("~active", String, queue_size=1, latch=True)
        self._announce()

        # Who finds an input to send to may count on the way to the car.
        wait_until_connected(self._output_pub, "subscribers")
        for each in self._config.inputs:
            topic = _private(each.topic)
            rospy.Subscriber(topic, AckermannDriveStamped, self._on_command, each, tcp_nodelay=True)
            rospy.loginfo(
                "input %s: %s, priority %d, timeout %g s",
                each.name,
                rospy.resolve_name(topic),
                each.priority,
                each.timeout / 1e9,
            )

    def run(self) -> None:
        """Stop the car whenever the last live input runs out, until the node is shut down."""
        while not rospy.is_shutdown():
            if not self._live.wait(_LOOK_EVERY):
                continue
            with self._lock:
                seen = rospy.get_rostime().to_nsec()
                now = self._read_clock()
                self._expire(now)
                deadline = self._mux.deadline or seen
                held = self._held()
            if deadline <= now and held > 0.0:
                time.sleep(min(held, _LOOK_EVERY))
            else:
                sleep_until(deadline, seen)  # where time moves far back, _read_clock sees it too

    def _held(self) -> float:
        """Return for how long [s of wall-clock time] no input runs out; needs the lock.

        Where a command has no stamp, nobody knows when it was sent: in lock-step the clock here may
        be seconds behind the one that the sender sees, and catch up at any moment. So it is good
        for its timeout by the wall clock, too.
        """
        deadline, until = self._guess
        return until - time.monotonic() if self._mux.deadline == deadline else 0.0

    def _expire(self, now: int) -> None:
        """Stop the car if the last live input has run out at `now` [ns]; needs the lock."""
        if self._held() > 0.0:
            return
        is_guess = self._mux.deadline == self._guess[0]
        self._mux, stop = self._mux.expire(now)
        if stop is not None:
            self._live.clear()
            command = Command(0 if is_guess else stop, 0.0, 0.0)
            self._output_pub.publish(conversions.command_to_msg(command, self._frame))
            self._announce()

    def _read_clock(self) -> int:
        """Return the present [ns]; needs the lock.

        Where the clock jumped back, every input runs out at once.
        """
        now = rospy.get_rostime().to_nsec()
        if now < self._now - STAMP_TOLERANCE:
            rospy.logwarn("the clock jumped back; all inputs start afresh")
            self._mux = self._mux.restart(now)
            self._now = now
        self._now = max(self._now, now)
        return self._now

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Forward a command as it is, if its input may drive."""
        try:
            command = conversions.command_from_msg(msg)
        except conversions.MessageError as error:
            rospy.logwarn_throttle(1.0, f"ignored a command of input {source.name}: {error}")
            return
        with self._lock:
            now, is_simulated = self._read_clock(), not rospy.rostime.is_wallclock()
            stamp, slack = sent_at(command.stamp, now, source.timeout, is_simulated)
            # First what is over by then, so that what comes out depends on the stamps alone.
            self._expire(stamp)
            self._mux, passes = self._mux.command(source, stamp, slack)
            if slack and self._mux.deadline == stamp + source.timeout + slack:
                until = time.monotonic() + source.timeout / NANOSECONDS
                self._guess = (self._mux.deadline, until)
            if passes:
                self._frame = msg.header.frame_id
                self._output_pub.publish(msg)
                self._announce()
            self._live.set()

    def _announce(self) -> None:
        """Publish the name of the input that drives, where it is a new one."""
        if self._mux.active != self._announced:
            self._announced = self._mux.active
            self._active_pub.publish(String(data=self._announced))


def _private(topic: str) -> str:
    """Return `topic` as a private name, unless it is a global or a private one already."""
    return topic if topic.startswith(("/", "~")) else f"~{topic}"


def main() -> int:
    """Run the node; return its exit status."""
    init_node("ackermann_cmd_mux")
    try:
        node = AckermannCmdMux()
    except ConfigError as error:
        rospy.logfatal("%s: the mux's configuration %s", rospy.get_name(), error)
        return 1
    with suppress(rospy.ROSInterruptException):
        node.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
