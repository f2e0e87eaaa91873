"""Drive plans with path_publisher.py, one at a time, and follow those that start elsewhere."""

import json
import signal
import subprocess
import threading
import time
from typing import Any, Callable, Collection, Dict, Mapping, Optional, Sequence, Tuple

import rosgraph
import rospy

from mushr_ros_intro.browser import plans, rosapi
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros.connections import is_alive
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT

END_TIMEOUT = 10.0
"""Timeout for the end of path_publisher.py after SIGINT [s]; then it is killed."""


class PlanDrive:
    """The latest drive of path_publisher.py, which this program or for example a terminal started.

    Args:
        program: the path of path_publisher.py.
        namespace: of its node.
        changed: is called, in any thread, when a drive of this program begins or ends.
    """

    def __init__(self, program: str, namespace: str, changed: Callable[[], None]) -> None:
        self._program = program
        self._namespace = namespace
        self._name = rosgraph.names.ns_join(namespace, "path_publisher")
        self._changed = changed
        self._lock = threading.Lock()
        self._process: Optional[subprocess.Popen[bytes]] = None
        """That of the latest drive; None if it started elsewhere."""
        self._node = "", 0
        """Address and process of the latest node that started elsewhere."""
        self._is_elsewhere = False
        """Whether this node is running."""
        self._plan: Optional[str] = None
        self._written: Optional[float] = None
        self._begun = 0.0
        self._is_stopped = False

    @property
    def state(self) -> Optional[Dict[str, Any]]:
        """The latest drive, or None before the first one."""
        if not self._begun:
            return None
        return {
            "plan": self._plan,
            "written": self._written,
            "begun": self._begun,
            "running": self._is_running() or self._is_elsewhere,
            "stopped": self._is_stopped,
        }

    def start(self, plan: str, written: Optional[float], parameters: Mapping[str, Any]) -> None:
        """Start a drive.

        Args:
            plan: the name of the plan.
            written: when its file was written [s since 1970].
            parameters: of path_publisher.py.

        Raises:
            UserError: another drive is running, the node cannot be started, or the master does not
                answer.
        """
        with self._lock:
            if self._is_running():
                raise UserError(f"{self._plan} is being driven; stop it first")
            try:
                if is_alive(self._name):
                    raise UserError(f"{self._name} is running already; stop it first")
                rospy.set_param(self._name, {})  # deletes those of earlier runs
            except OSError as error:
                raise UserError(rosapi.no_answer(error)) from None
            command = [self._program, f"__ns:={self._namespace}", "__name:=path_publisher"]
            command += [
                f"_{each}:={json.dumps(value, ensure_ascii=False)}"  # which is YAML
                for each, value in parameters.items()
            ]
            try:
                process = subprocess.Popen(command, start_new_session=True)
            except OSError as error:
                raise UserError(f"{self._program} cannot be started: {error}") from None
            self._begin(plan, written, process)
        threading.Thread(target=self._wait, args=[process], daemon=True).start()
        self._changed()

    def look(self, services: Collection[str], folders: Sequence[str]) -> None:
        """Find out whether a drive that started elsewhere is running; takes time.

        Args:
            services: those that the master knows.
            folders: contain the plans.

        Raises:
            OSError: the master does not answer.
        """
        node = self._find() if f"{self._name}/get_loggers" in services else None  # rospy offers it
        with self._lock:
            is_own = node is not None and self._process is not None and node[1] == self._process.pid
            if self._is_running() or is_own:
                return
            self._is_elsewhere = node is not None
            if node is None or node == self._node:
                return
            self._node = node
            plan = plans.name_of(str(rospy.get_param(f"{self._name}/plan_file", "")), folders)
            self._begin(plan, plans.versions(folders).get(plan or ""), None)

    def stop(self) -> None:
        """Interrupt the drive, as Ctrl-C does.

        Raises:
            UserError: there is no drive, or its node does not respond.
        """
        with self._lock:
            if self._is_running():
                assert self._process
                self._process.send_signal(signal.SIGINT)
            elif self._is_elsewhere:
                self._shut_down(self._node[0])
            else:
                raise UserError("no plan is being driven")
            self._is_stopped = True
        self._changed()

    def end(self) -> None:
        """Interrupt the drive of this program, if there is one, and wait for its end."""
        if self._is_running():
            assert self._process
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()

    def _begin(
        self,
        plan: Optional[str],
        written: Optional[float],
        process: "Optional[subprocess.Popen[bytes]]",
    ) -> None:
        """Note that a drive has begun; needs the lock."""
        self._process, self._plan, self._written = process, plan, written
        self._is_elsewhere = process is None
        self._begun = time.time()
        self._is_stopped = False

    def _is_running(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _find(self) -> Optional[Tuple[str, int]]:
        """Return the address and the process of the node, or None if it does not respond."""
        caller = rospy.get_name()
        try:
            uri = ask(rosgraph.get_master_uri(), CALL_TIMEOUT, caller, "lookupNode", self._name)
            return uri, ask(uri, CALL_TIMEOUT, caller, "getPid")
        except CallError:
            return None

    def _shut_down(self, uri: str) -> None:
        """Ask a node to end, as rosnode kill does."""
        try:
            ask(uri, CALL_TIMEOUT, rospy.get_name(), "shutdown", "stopped in the browser")
        except CallError as error:
            if error.fault is CallFault.NO_RESPONSE:  # otherwise it has ended before its answer
                raise UserError(f"{self._name} does not respond ({error})") from None

    def _wait(self, process: "subprocess.Popen[bytes]") -> None:
        process.wait()
        self._changed()
