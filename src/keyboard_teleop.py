#!/usr/bin/python3
"""Drive the car with the keys W, A, S, D: in a window, or in the terminal where there is none."""

import contextlib
import os
import select
import signal
import sys
import termios
import threading
import time
import tty
from functools import partial
from types import FrameType
from typing import Any, Callable, Dict, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped

from mushr_ros_intro.authoring.teleop import Keys, Schedule
from mushr_ros_intro.car.model import Command
from mushr_ros_intro.parameters import ParameterError, number
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node

POLL = 0.01
"""How often to look whether a command is due [s]."""


class NoKeyboardError(RuntimeError):
    """Keys cannot be read in this way; says why."""


class KeyboardTeleop:
    """What turns keys into commands, as a node.

    Publishes on ``mux/ackermann_cmd_mux/input/teleop``, relative to the car's namespace, while a
    key is held, and one stop after that.
    """

    def __init__(self) -> None:
        def parameter(name: str, default: float, unit: str, most: float) -> float:
            value = number(f"~{name}", rospy.get_param(f"~{name}", default), unit, 0.0, most)
            rospy.loginfo("%s: %g %s", name, value, unit)
            return value

        self.speed = parameter("speed", 2.0, "m/s", 100.0)
        self.steering_angle = parameter("steering_angle", 0.34, "rad", 1.5)
        self._frame = f"{rospy.get_namespace().strip('/')}/base_footprint".lstrip("/")
        self._lock = threading.Lock()
        self.keys = Keys()
        self._schedule = Schedule()
        self._ended = False
        self._publisher = rospy.Publisher(
            "mux/ackermann_cmd_mux/input/teleop",
            AckermannDriveStamped,
            queue_size=10,
            tcp_nodelay=True,
        )
        rospy.loginfo("commands to %s", self._publisher.resolved_name)
        self._asked_to_end = False
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, self._on_signal)
        rospy.on_shutdown(self.end)

    @property
    def is_over(self) -> bool:
        """Whether the node is to end."""
        return self._asked_to_end or rospy.is_shutdown()

    def _on_signal(self, number: int, frame: Optional[FrameType]) -> None:
        """Note that a signal asks the node to end.

        The usual handler would hold up a command, and the stop waits for that to be sent.
        """
        self._asked_to_end = True

    def update(self, change: Callable[[Keys], Keys] = lambda keys: keys) -> None:
        """Change which keys are held, and send what is due."""
        with self._lock:
            if self._ended:
                return
            self.keys = change(self.keys).at(time.monotonic_ns())
            self._send()

    def end(self) -> None:
        """Let all keys go for good, and see the stop off: at its end rospy drops what is queued."""
        with self._lock:
            if self._ended:
                return
            self._ended = True
            self.keys = Keys()
            written = self._count_written()
            if not self._send():
                return
            deadline = time.monotonic() + 1.0
            while time.monotonic() < deadline:
                now = self._count_written()
                if all(now[link] > count for link, count in written.items() if link in now):
                    return
                time.sleep(0.001)

    def _send(self) -> bool:
        """Publish what is due, and say whether anything was; needs the lock."""
        now = rospy.get_rostime().to_nsec()
        wanted = self.keys.drive(self.speed, self.steering_angle)
        self._schedule, due = self._schedule.step(wanted, now)
        if due is not None:
            self._publisher.publish(conversions.command_to_msg(Command(now, *due), self._frame))
        return due is not None

    def _count_written(self) -> Dict[int, int]:
        """Return how many messages have been written to each connection."""
        _, _, connections = self._publisher.impl.get_stats()
        return {link: count for link, _, count, connected in connections if connected}


class Window:
    """A small window that shows which keys are held."""

    HELD, LOOSE = "#d9141a", "#d0d0d4"

    def __init__(self, node: KeyboardTeleop) -> None:
        try:
            import tkinter  # Debian has it in a package of its own
        except ImportError:
            raise NoKeyboardError("there is no tkinter (Debian's package python3-tk)") from None
        try:
            self._root = tkinter.Tk(className="keyboard_teleop")
        except tkinter.TclError as error:
            raise NoKeyboardError(str(error)) from None
        self._node = node
        self._root.title(f"Teleop {rospy.get_namespace().strip('/')}".strip())
        self._root.resizable(False, False)
        frame = tkinter.Frame(self._root)
        frame.pack()
        self._labels = {}
        for key, row, column in (("w", 0, 1), ("a", 1, 0), ("s", 1, 1), ("d", 1, 2)):
            label = tkinter.Label(frame, text=key.upper(), width=4, height=2)
            label.grid(row=row, column=column, padx=4, pady=4)
            self._labels[key] = label
        self._status = tkinter.Label(self._root, width=34)
        self._status.pack(pady=4)

        self._root.bind("<KeyPress>", self._on_press)
        self._root.bind("<KeyRelease>", self._on_release)
        self._root.bind("<FocusOut>", lambda _: self._let_go())
        self._root.protocol("WM_DELETE_WINDOW", self._root.quit)

    def run(self) -> None:
        """Take keys until the window is closed or the node is shut down."""
        try:
            self._tick()
            self._root.mainloop()
        finally:
            self._node.end()
            self._root.destroy()

    def _on_press(self, event: Any) -> None:
        self._node.update(lambda keys: keys.down(event.keysym))

    def _on_release(self, event: Any) -> None:
        self._node.update(lambda keys: keys.up(event.keysym, time.monotonic_ns()))

    def _let_go(self) -> None:
        self._node.update(lambda keys: Keys())

    def _tick(self) -> None:
        """Send what is due, once the keys that have been pressed meanwhile are known."""
        if self._node.is_over:
            self._root.quit()
            return
        self._root.after_idle(self._node.update)
        held = {each.key for each in self._node.keys.held}
        for key, label in self._labels.items():
            label.configure(background=self.HELD if key in held else self.LOOSE)
        if self._root.focus_displayof() is None:
            self._status.configure(text="click here to drive")
        else:
            node = self._node
            self._status.configure(text=f"{node.speed:g} m/s, {node.steering_angle:g} rad")
        self._root.after(int(POLL * 1000), self._tick)


class Terminal:
    """The terminal that the node was started in."""

    def __init__(self, node: KeyboardTeleop) -> None:
        self._node = node
        try:
            self._input = sys.stdin.fileno()
            self._settings = termios.tcgetattr(self._input)
        except (OSError, ValueError, AttributeError, termios.error):
            raise NoKeyboardError("the standard input is no terminal") from None

    def run(self) -> None:
        """Take characters until the terminal is closed or the node is shut down."""
        print("W, S: drive; A, D: steer; any other key: stop; Ctrl-C: end", flush=True)
        try:
            tty.setcbreak(self._input)
            while not self._node.is_over and self._take():
                pass
        finally:
            self._node.end()
            with contextlib.suppress(termios.error):  # where the terminal is gone
                termios.tcsetattr(self._input, termios.TCSADRAIN, self._settings)

    def _take(self) -> bool:
        """Take what has been typed, if anything; say whether the terminal is still there."""
        ready, _, _ = select.select([self._input], [], [], POLL)
        if not ready:
            self._node.update()
            return True
        try:
            typed = os.read(self._input, 1024)
        except OSError:
            return False
        for key in typed.decode("ascii", errors="replace"):
            self._node.update(partial(Keys.typed, key=key, now=time.monotonic_ns()))
        return bool(typed)


def drive() -> int:
    """Run the node, in a window or in the terminal; return its exit status."""
    try:
        node = KeyboardTeleop()
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    try:
        Window(node).run()
        return 0
    except NoKeyboardError as error:
        no_window = error
    try:
        terminal = Terminal(node)
    except NoKeyboardError as no_terminal:
        rospy.logfatal(
            "%s: no keyboard to drive with: no window (%s), and %s. "
            "Set DISPLAY, or start it in a terminal: "
            "rosrun mushr_ros_intro keyboard_teleop.py __ns:=%s",
            rospy.get_name(),
            no_window,
            no_terminal,
            rospy.get_namespace().rstrip("/") or "/car",
        )
        return 1
    rospy.loginfo("no window (%s), so the terminal it is", no_window)
    terminal.run()
    return 0


def main() -> int:
    """Run the node; return its exit status."""
    init_node("keyboard_teleop")
    status = drive()
    rospy.signal_shutdown("the keyboard is let go")
    return status


if __name__ == "__main__":
    sys.exit(main())
