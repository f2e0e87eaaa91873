"""Drive plans with path_publisher.py, one at a time."""

import json
import signal
import subprocess
import threading
from typing import Any, Callable, Dict, Optional

import rosgraph
import rospy

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros.connections import responds

END_TIMEOUT = 10.0
"""Timeout for the end of path_publisher.py after SIGINT [s]; then it is killed."""


class PlanDrive:
    """The latest drive.

    Args:
        program: the path of path_publisher.py.
        namespace: of its node.
        changed: is called, in any thread, when a drive begins or ends.
    """

    def __init__(self, program: str, namespace: str, changed: Callable[[], None]) -> None:
        self._program = program
        self._namespace = namespace
        self._changed = changed
        self._lock = threading.Lock()
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._plan = ""
        self._is_stopped = False

    @property
    def state(self) -> Optional[Dict[str, Any]]:
        """The plan, whether it is being driven, the exit status, and whether a client stopped it.

        None before the first drive.
        """
        if self._process is None:
            return None
        status = self._process.poll()
        return {
            "plan": self._plan,
            "running": status is None,
            "exit_status": status,
            "stopped": self._is_stopped,
        }

    def start(self, plan: str, parameters: Dict[str, Any]) -> None:
        """Start a drive; set the parameters of path_publisher.py.

        Raises:
            UserError: another drive is running, or the node cannot be started.
        """
        name = rosgraph.names.ns_join(self._namespace, "path_publisher")
        with self._lock:
            if self._is_running():
                raise UserError(f"{self._plan} is being driven; stop it first")
            if responds(name):
                raise UserError(f"{name} is running already; end it in its terminal first")
            rospy.set_param(name, {})  # deletes those of earlier runs
            command = [self._program, f"__ns:={self._namespace}", "__name:=path_publisher"]
            command += [
                f"_{each}:={json.dumps(value, ensure_ascii=False)}"  # which is YAML
                for each, value in parameters.items()
            ]
            try:
                self._process = subprocess.Popen(command, start_new_session=True)
            except OSError as error:
                raise UserError(f"{self._program} cannot be started: {error}") from None
            self._plan = plan
            self._is_stopped = False
        threading.Thread(target=self._wait, args=[self._process], daemon=True).start()
        self._changed()

    def stop(self) -> None:
        """Interrupt the drive, as Ctrl-C does.

        Raises:
            UserError: there is no drive.
        """
        with self._lock:
            if not self._is_running():
                raise UserError("no plan is being driven")
            assert self._process
            self._process.send_signal(signal.SIGINT)
            self._is_stopped = True
        self._changed()

    def end(self) -> None:
        """Interrupt the drive, if there is one, and wait for its end."""
        if self._is_running():
            assert self._process
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()

    def _is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _wait(self, process: "subprocess.Popen[bytes]") -> None:
        process.wait()
        self._changed()
