"""Start, watch and end the process of the node in a replay."""

import contextlib
import os
import shlex
import signal
import subprocess
import threading
from functools import partial
from typing import List

import roslib.packages
import rospkg

from mushr_ros_intro.errors import UserError

SHOWN_LINES = 15
"""Number of lines at the end of the node's output that a message quotes."""

KEPT_OUTPUT = 20_000
"""Size of the kept end of a node's output [bytes]."""


class Candidate:
    """The process of the node in a replay, with all processes of its group."""

    def __init__(self, command: str, arguments: List[str]) -> None:
        """Start the node.

        Args:
            command: "PACKAGE NODE [ARGUMENT...]".
            arguments: further arguments, such as remappings.

        Raises:
            UserError: there is no such node, or it cannot be started.
        """
        words = shlex.split(command)
        if len(words) < 2:
            raise UserError(f"publisher is '{command}'; expected 'PACKAGE NODE [ARGUMENT...]'")
        try:
            found = roslib.packages.find_node(*words[:2])
        except rospkg.ResourceNotFound:
            raise UserError(f"there is no package '{words[0]}' (rospack find)") from None
        if not found:
            raise UserError(
                f"there is no node '{words[1]}' in the package '{words[0]}'. "
                f"Is the file executable (chmod +x {words[1]})?"
            )
        try:
            self._process = subprocess.Popen(
                [found[0], *words[2:], *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,
            )
        except OSError as error:
            raise UserError(
                f"{found[0]} cannot be started ({error.strerror}). "
                "Does its first line name an existing interpreter?"
            ) from None
        self._output = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Keep the end of the node's output."""
        assert self._process.stdout
        for chunk in iter(partial(os.read, self._process.stdout.fileno(), 65536), b""):
            self._output = (self._output + chunk)[-KEPT_OUTPUT:]

    @property
    def has_ended(self) -> bool:
        """Whether the node's process has ended."""
        return self._process.poll() is not None

    def end(self) -> None:
        """End the node, and all processes of its group."""
        for number, seconds in ((signal.SIGINT, 3.0), (signal.SIGKILL, 10.0)):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(seconds)
        self._reader.join(1.0)

    def describe_failure(self) -> str:
        """Return why the node failed, with the end of its output; empty if its exit status is 0."""
        status = self._process.wait()
        if status == 0:
            return ""
        self._reader.join(1.0)
        how = f"ended with exit status {status}"
        if status < 0:
            how = f"was killed by signal {signal.Signals(-status).name}"
        lines = self._output.decode(errors="replace").splitlines()[-SHOWN_LINES:]
        # The message is written to XML, which must not contain control characters.
        shown = ["".join(c for c in line if c.isprintable()) for line in lines]
        output = "; its last output:\n" + "\n".join(shown) if shown else "; it printed nothing"
        return f"the node {how}{output}"
