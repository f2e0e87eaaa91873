#!/usr/bin/python3
"""Drive the car with the keys W, A, S, D: in a window, or in the terminal without a display."""

import signal
import sys
import threading
import time
from types import FrameType
from typing import Dict, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped

from mushr_ros_intro.authoring.keyboard import open_keyboard
from mushr_ros_intro.authoring.teleop import Keys, Schedule
from mushr_ros_intro.car.model import Command
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node


class KeyboardTeleop:
    """The teleoperation as a node.

    Publishes on ``mux/ackermann_cmd_mux/input/teleop``, relative to the car's namespace, while a
    key is held, and one stop after that.
    """

    def __init__(self) -> None:
        parameters = Parameters(rospy.get_param("~", {}))
        self._speed = parameters.number("speed", 2.0, "m/s", 0.0, 100.0)
        self._steering_angle = parameters.number("steering_angle", 0.34, "rad", 0.0, 1.5)
        self._car_name = rospy.get_namespace().strip("/")
        self._frame = f"{self._car_name}/base_footprint".lstrip("/")
        self._lock = threading.Lock()
        self._schedule = Schedule()
        self._ended = False
        self._publisher = rospy.Publisher(
            "mux/ackermann_cmd_mux/input/teleop",
            AckermannDriveStamped,
            queue_size=10,
            tcp_nodelay=True,
        )
        self._values = f"{self._speed:g} m/s, {self._steering_angle:g} rad"
        rospy.loginfo("%s; commands to %s", self._values, self._publisher.resolved_name)
        self._asked_to_end = False
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)
        rospy.on_shutdown(self.stop)

    def run(self) -> None:
        """Drive until the keyboard is closed or the node is shut down.

        Raises:
            NoKeyboardError: there is neither a display nor a terminal.
        """
        keyboard = open_keyboard(
            f"Teleop {self._car_name}".strip(),
            self._values,
            f"rosrun mushr_ros_intro keyboard_teleop.py __ns:=/{self._car_name or 'car'}",
        )
        try:
            while keyboard.is_open and not self._asked_to_end and not rospy.is_shutdown():
                keys = keyboard.read()
                with self._lock:
                    if not self._ended:
                        self._send(keys)
        finally:
            self.stop()
            keyboard.close()

    def stop(self) -> None:
        """Send the stop, if the car is driving, and flush it: rospy drops what is queued."""
        with self._lock:
            if self._ended:
                return
            self._ended = True
            written = self._count_written()
            if not self._send(Keys()):
                return
            deadline = time.monotonic() + 1.0
            while time.monotonic() < deadline:
                now = self._count_written()
                if all(now[link] > count for link, count in written.items() if link in now):
                    return
                time.sleep(0.001)

    def _on_signal(self, number: int, frame: Optional[FrameType]) -> None:
        """Ask `run` to end.

        The handler of `init_node` could interrupt `publish`, and `stop` would wait for it.
        """
        self._asked_to_end = True

    def _send(self, keys: Keys) -> bool:
        """Publish the command that is due, if any; return whether there is one; needs the lock."""
        now = rospy.get_rostime().to_nsec()
        wanted = keys.drive(self._speed, self._steering_angle)
        self._schedule, due = self._schedule.step(wanted, now)
        if due is not None:
            self._publisher.publish(conversions.command_to_msg(Command(now, *due), self._frame))
        return due is not None

    def _count_written(self) -> Dict[int, int]:
        """Return the number of messages written to each connection."""
        _, _, connections = self._publisher.impl.get_stats()
        return {link: count for link, _, count, connected in connections if connected}


def main() -> int:
    """Run the node; return its exit status."""
    init_node("keyboard_teleop")
    try:
        KeyboardTeleop().run()
    except UserError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    finally:
        rospy.signal_shutdown("the keyboard is closed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
