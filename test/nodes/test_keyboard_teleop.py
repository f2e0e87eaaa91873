"""Drive with the keys: in a window on a virtual display, and in a terminal."""

import os
import pty
import select
import signal
import subprocess
import termios
import time
from unittest import mock

import pytest
import roslib.packages
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.authoring.keyboard import HELP
from support.display import Display, require
from support.geometry import float32
from support.helpers import PATIENCE, Process, Recording, RosTestCase, wait_for
from support.messages import MUX, TELEOP
from support.world import launch

NODE = (roslib.packages.find_node("mushr_ros_intro", "keyboard_teleop.py")[0], "__ns:=/car")

FORWARD = (2.0, 0.0)
FORWARD_LEFT = (2.0, float32(0.34))
STOP = (0.0, 0.0)
"""[m/s, rad]"""

SILENCE = 0.5
"""[s] Five command periods, and longer than the mux's timeout of 0.2 s."""

REPEATING = 1.5
"""[s] A display repeats a key that is held for 0.5 or 0.66 s, so hold it longer."""


def drives(messages):
    return [(each.drive.speed, each.drive.steering_angle) for each in messages]


def start_world():
    return launch("sim.launch", map="none", laser=False, model=False, watched=False)


class Commands:
    """Code of the tests of window and terminal. One node at a time drives the car."""

    def setUp(self):
        super().setUp()
        self.commands = self.ending(Recording(TELEOP, AckermannDriveStamped))
        self.active = self.ending(Recording(f"{MUX}/active", String).connected())
        self.seen = rospy.Time()

    def wait_for_drive(self, wanted):
        """Wait for such a command after the one that the last call waited for."""
        command = self.commands.first(
            lambda msg: msg.header.stamp > self.seen and drives([msg]) == [wanted],
            f"the command {wanted}",
        )
        self.seen = command.header.stamp

    def check_silence(self):
        """Wait for the stop; check that there is one stop and no later message."""
        self.wait_for_drive(STOP)
        wait_for(lambda: self.active.last.data == "idle", "the mux to be idle")
        count = len(self.commands.messages)
        until = time.monotonic() + SILENCE
        wait_for(lambda: time.monotonic() > until, "silence")
        self.assertEqual(len(self.commands.messages), count, "there are commands after the stop")
        self.assertEqual(drives(self.commands.messages).count(STOP), 1)

    def check_headers(self):
        stamps = [each.header.stamp for each in self.commands.messages]
        self.assertEqual(stamps, sorted(stamps))
        age = (rospy.Time.now() - stamps[-1]).to_sec()
        self.assertTrue(0.0 <= age < PATIENCE, f"the last stamp is {age:g} s old")
        frames = {each.header.frame_id for each in self.commands.messages}
        self.assertEqual(frames, {"car/base_footprint"})


class FaultsTest(RosTestCase):
    """A fault that ends the node with a message."""

    @mock.patch.dict(os.environ, DISPLAY="")
    def test_neither_a_display_nor_a_terminal(self):
        said = "no keyboard to drive with", "DISPLAY"
        self.assert_refused(("keyboard_teleop.py", ["__ns:=/car"], *said))


class NamespaceTest(RosTestCase):
    """Without __ns, in a terminal: no node subscribes."""

    def test_warning(self):
        keyboard, terminal = pty.openpty()
        self.addCleanup(os.close, keyboard)
        self.addCleanup(os.close, terminal)
        node = subprocess.Popen(
            [NODE[0]],
            stdin=terminal,
            stdout=terminal,
            stderr=terminal,
            env={**os.environ, "DISPLAY": ""},
            start_new_session=True,
        )
        self.addCleanup(node.wait)
        self.addCleanup(node.kill)
        output = b""

        def is_printed(text):
            nonlocal output
            if select.select([keyboard], [], [], 0.1)[0]:
                output += os.read(keyboard, 4096)
            return text in output

        wait_for(lambda: is_printed(HELP.encode()), "the help")
        os.write(keyboard, b"w")
        wait_for(
            lambda: is_printed(b"no node subscribes to /mux/ackermann_cmd_mux/"), "the warning"
        )
        wait_for(lambda: is_printed(b"type: rosrun mushr_ros_intro keyboard_teleop.py"), "its end")


class WindowTest(Commands, RosTestCase):
    """In a window; xdotool presses the keys."""

    def setUp(self):
        require(self, "Xvfb", "xdotool")
        super().setUp()
        self.display = self.ending(Display())
        self.node = self.ending(Process(*NODE, DISPLAY=self.display.name))
        self.addCleanup(self.display.xdotool, "keyup", "w", "keyup", "a")
        self.commands.connected()
        self.display.focus_on("^Teleop car$")

    def test_keys(self):
        """Commands while keys are held, one stop when they are released, then silence."""
        self.display.xdotool("keydown", "w")
        self.wait_for_drive(FORWARD)
        wait_for(lambda: self.active.last.data == "teleop", "the mux to pass it on")
        began = rospy.Time.now()
        last = self.commands.after(began + rospy.Duration(REPEATING)).header.stamp
        held = [each for each in self.commands.messages if each.header.stamp <= last]
        self.assertEqual(set(drives(held)), {FORWARD})
        self.display.xdotool("keydown", "a")
        self.wait_for_drive(FORWARD_LEFT)
        self.display.xdotool("keyup", "a")
        self.wait_for_drive(FORWARD)
        self.display.xdotool("keyup", "w")
        self.check_silence()
        self.check_headers()

    @pytest.mark.full
    def test_focus(self):
        """The car stops when the window loses the focus, although the key is still down."""
        self.display.xdotool("keydown", "w")
        self.wait_for_drive(FORWARD)
        script = "import tkinter; tkinter.Tk(className='other').mainloop()"
        self.ending(Process("/usr/bin/python3", "-c", script, DISPLAY=self.display.name))
        self.display.focus_on("^other$")
        self.check_silence()


class TerminalTest(Commands, RosTestCase):
    """In a terminal, without a display."""

    def setUp(self):
        super().setUp()
        self.keyboard, terminal = pty.openpty()
        self.addCleanup(os.close, self.keyboard)
        self.addCleanup(os.close, terminal)
        self.terminal = terminal
        self.settings = termios.tcgetattr(terminal)
        self.node = subprocess.Popen(
            NODE,
            stdin=terminal,
            stdout=terminal,
            env={**os.environ, "DISPLAY": ""},
            start_new_session=True,
        )
        self.addCleanup(self.node.wait)
        self.addCleanup(self.node.kill)
        wait_for(lambda: termios.tcgetattr(terminal) != self.settings, "the terminal to be set")
        self.commands.connected()

    def test_keys(self):
        """Characters drive for a while; then there is one stop, and silence."""
        os.write(self.keyboard, b"wa")
        self.wait_for_drive(FORWARD_LEFT)
        self.check_silence()
        self.check_headers()

    def test_end(self):
        """Ctrl-C, a signal of the terminal: one stop, and the settings are restored."""
        os.write(self.keyboard, b"w")
        self.wait_for_drive(FORWARD)
        os.killpg(self.node.pid, signal.SIGINT)
        self.assertEqual(self.node.wait(PATIENCE), 0)
        self.assertEqual(termios.tcgetattr(self.terminal), self.settings)
        self.check_silence()
