#!/usr/bin/python3
"""Drive the car with the keys W, A, S, D: in a window, or in the terminal without a display."""

import rospy

from mushr_ros_intro.authoring.keyboard import open_keyboard
from mushr_ros_intro.authoring.teleop import Schedule
from mushr_ros_intro.car.model import Command
from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.parameters import Values, number
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.ros.commands import as_typed

_COMMAND = "rosrun mushr_ros_intro keyboard_teleop.py __ns:=/car"

_WARNING_PERIOD = 5.0
"""[s]"""


class KeyboardTeleop:
    """The teleoperation as a node.

    Publishes on ``mux/ackermann_cmd_mux/input/teleop``, relative to the car's namespace, while a
    key is held, and one stop after that.

    Example: ``rosrun mushr_ros_intro keyboard_teleop.py __ns:=car``
    """

    PARAMETERS = (
        number("speed", 2.0, "m/s", 0.0, 100.0, "speed of W, of S in reverse"),
        number("steering_angle", 0.34, "rad", 0.0, 1.5, "steering angle of A, of D to the right"),
    )

    def __init__(self, values: Values) -> None:
        self._speed, self._steering_angle = values["speed"], values["steering_angle"]
        self._car_name = rospy.get_namespace().strip("/")
        self._frame = f"{self._car_name}/base_footprint".lstrip("/")
        self._schedule = Schedule()
        self._commands = CommandPublisher("mux/ackermann_cmd_mux/input/teleop")
        self._values = f"{self._speed:g} m/s, {self._steering_angle:g} rad"
        rospy.loginfo("%s; commands to %s", self._values, self._commands.topic)

    def run(self) -> None:
        """Drive until the keyboard is closed or the node is shut down.

        Raises:
            UserError: there is neither a display nor a terminal.
        """
        keyboard = open_keyboard(
            f"Teleop {self._car_name}".strip(),
            self._values,
            as_typed(f"rosrun mushr_ros_intro keyboard_teleop.py __ns:=/{self._car_name or 'car'}"),
        )
        try:
            while keyboard.is_open and not rospy.is_shutdown():
                now = ros_time.now()
                wanted = keyboard.read().drive(self._speed, self._steering_angle)
                self._schedule, due = self._schedule.step(wanted, now)
                if due is not None:
                    self._warn()
                    command = Command(now, *due)
                    self._commands.publish(conversions.command_to_msg(command, self._frame))
        finally:
            keyboard.close()

    def _warn(self) -> None:
        """Warn if no node gets the commands."""
        if not self._commands.has_subscriber():
            rospy.logwarn_throttle(
                _WARNING_PERIOD,
                f"no node subscribes to {self._commands.topic}, so the keys drive no car. Is it "
                f"running? For the car 'car', type: {as_typed(_COMMAND)}",
            )


if __name__ == "__main__":
    node.main("keyboard_teleop", KeyboardTeleop)
