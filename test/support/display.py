"""A virtual display: Xvfb with a free display number."""

import os
import select
import shutil
import subprocess

from support.helpers import PATIENCE, wait_for


def require(test, *programs):
    """Fail the test if one of the programs is not installed."""
    for program in programs:
        test.assertTrue(
            shutil.which(program), f"{program} is not on the PATH; scripts/setup installs it"
        )


class Display:
    """An X server with a screen of 1280 by 900 pixels."""

    def __init__(self):
        reader, writer = os.pipe()
        # Without -noreset, it resets after its last client, and refuses new clients meanwhile.
        options = ["-screen", "0", "1280x900x24", "-noreset", "-nolisten", "tcp"]
        self._server = subprocess.Popen(
            ["Xvfb", "-displayfd", str(writer), *options],
            pass_fds=[writer],
            stderr=subprocess.DEVNULL,
        )
        os.close(writer)
        with open(reader, encoding="ascii") as answer:
            ready, _, _ = select.select([reader], [], [], PATIENCE)
            self.name = ":" + answer.readline().strip() if ready else ":"
        if self.name == ":":
            self.end()
            raise AssertionError(f"Xvfb printed no display number within {PATIENCE:g} s")

    def end(self):
        """End the server; this closes all windows."""
        self._server.terminate()
        self._server.wait()

    def xdotool(self, *arguments):
        """Run xdotool on this display; return the words of its output."""
        return subprocess.run(
            ["xdotool", *arguments],
            env={**os.environ, "DISPLAY": self.name},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ).stdout.split()

    def windows(self, kind):
        """Return the visible windows of a class, the largest first.

        Each is a box (left, top, right, bottom) [pixel].
        """
        boxes = []
        for window in self.xdotool("search", "--onlyvisible", "--class", kind):
            # xdotool's own position of a window inside another one is wrong.
            moved = ("mousemove", "--window", window, "0", "0", "getmouselocation", "--shell")
            values = dict(each.split("=") for each in self.xdotool(*moved))
            left, top = int(values["X"]), int(values["Y"])
            values = self.xdotool("getwindowgeometry", "--shell", window)
            size = dict(each.split("=") for each in values)
            boxes.append((left, top, left + int(size["WIDTH"]), top + int(size["HEIGHT"])))
        return sorted(boxes, key=lambda box: (box[0] - box[2]) * (box[3] - box[1]))

    def focus_on(self, title):
        """Wait for a window with this title (a regular expression), and give it the focus."""
        window = wait_for(lambda: self.xdotool("search", "--name", title), f"window {title}")[-1]

        def has_focus():
            self.xdotool("windowfocus", window)
            return self.xdotool("getwindowfocus") == [window]

        wait_for(has_focus, f"window {title} to have the focus")
