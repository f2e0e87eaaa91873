"""Read which keys are held: from a small window, or from a terminal if there is no display."""

import os
import select
import termios
import time
import tty
from contextlib import suppress
from typing import Any, Union

from mushr_ros_intro.authoring.teleop import Keys, keys_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.stamps import NANOSECONDS

HELP = "W, S: drive; A, D: steer, or the arrow keys; any other key: stop"

HELP_PERIOD = 5 * NANOSECONDS
"""A terminal shows the help again if a key is typed this long after the last time [ns]."""

POLL = 0.01
"""The longest time that `read` waits [s]; a terminal sends an escape sequence faster."""


class Window:
    """A window that shows the help, and which keys are held.

    Args:
        title: of the window.
        values: of speed and steering angle, shown while the window has the focus.

    Raises:
        UserError: there is no display, or no tkinter.
    """

    HELD, RELEASED = "#d9141a", "#d0d0d4"

    def __init__(self, title: str, values: str) -> None:
        try:
            import tkinter  # a separate package in Debian
        except ImportError:
            raise UserError("tkinter is missing (Debian's package python3-tk)") from None
        try:
            self._root = tkinter.Tk(className="keyboard_teleop")
        except tkinter.TclError as error:
            raise UserError(str(error)) from None
        self.is_open = True
        self._keys = Keys()
        self._values = values
        self._root.title(title)
        self._root.resizable(False, False)
        frame = tkinter.Frame(self._root)
        frame.pack()
        self._labels = {}
        for key, row, column in (("w", 0, 1), ("a", 1, 0), ("s", 1, 1), ("d", 1, 2)):
            label = tkinter.Label(frame, text=key.upper(), width=4, height=2)
            label.grid(row=row, column=column, padx=4, pady=4)
            self._labels[key] = label
        tkinter.Label(self._root, text=HELP).pack(padx=4)
        self._status = tkinter.Label(self._root)
        self._status.pack(pady=4)

        self._root.bind("<KeyPress>", self._on_press)
        self._root.bind("<KeyRelease>", self._on_release)
        self._root.bind("<FocusOut>", self._on_focus_out)
        self._root.protocol("WM_DELETE_WINDOW", self._on_close)

    def read(self) -> Keys:
        """Handle all events of the window; return the keys that are held."""
        time.sleep(POLL)
        self._root.update()
        self._keys = self._keys.at(time.monotonic_ns())
        held = {each.key for each in self._keys.held}
        for key, label in self._labels.items():
            label.configure(background=self.HELD if key in held else self.RELEASED)
        has_focus = self._root.focus_displayof() is not None
        self._status.configure(text=self._values if has_focus else "click here to drive")
        return self._keys

    def close(self) -> None:
        """Close the window."""
        self._root.destroy()

    def _on_press(self, event: Any) -> None:
        self._keys = self._keys.down(event.keysym)

    def _on_release(self, event: Any) -> None:
        self._keys = self._keys.up(event.keysym, time.monotonic_ns())

    def _on_focus_out(self, _: Any) -> None:
        self._keys = Keys()

    def _on_close(self) -> None:
        self.is_open = False
        self._keys = Keys()


class Terminal:
    """The terminal that the node was started in.

    Args:
        command: starts the node in a terminal, for the error message.

    Raises:
        UserError: the standard input is not a terminal.
    """

    def __init__(self, command: str) -> None:
        self._input = 0  # the standard input
        try:
            self._settings = termios.tcgetattr(self._input)
        except termios.error:
            raise UserError(
                "no keyboard to drive with: the standard input is not a terminal; set DISPLAY, or "
                f"start the node in a terminal: {command}"
            ) from None
        self.is_open = True
        self._keys = Keys()
        self._rest = ""  # the beginning of an escape sequence
        self._help_due = 0
        tty.setcbreak(self._input)  # discards what was typed before
        self._show_help(time.monotonic_ns())

    def read(self) -> Keys:
        """Wait for characters; return the keys that are held."""
        ready, _, _ = select.select([self._input], [], [], POLL)
        typed = b""
        if ready:
            with suppress(OSError):
                typed = os.read(self._input, 1024)
            self.is_open = bool(typed)
        now = time.monotonic_ns()
        if typed:
            self._show_help(now)
        keys, self._rest = keys_in(self._rest + typed.decode("ascii", errors="replace"))
        if not typed and self._rest:  # it was the key Escape
            keys, self._rest = [self._rest], ""
        for key in keys:
            self._keys = self._keys.typed(key, now)
        self._keys = self._keys.at(now)
        return self._keys

    def close(self) -> None:
        """Restore the settings of the terminal."""
        with suppress(termios.error):  # the terminal may be closed
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._settings)

    def _show_help(self, now: int) -> None:
        """Print the help if it is due: the log lines of other nodes move it off the screen."""
        if now >= self._help_due:
            self._help_due = now + HELP_PERIOD
            print(f"{HELP}; Ctrl-C: end", flush=True)


def open_keyboard(title: str, values: str, command: str) -> Union[Window, Terminal]:
    """Open a window, or the terminal if there is no display; see `Window` and `Terminal`.

    Raises:
        UserError: neither can be opened.
    """
    try:
        return Window(title, values)
    except UserError as error:
        print(f"no window ({error}), so keys are read from the terminal", flush=True)
    return Terminal(command)
