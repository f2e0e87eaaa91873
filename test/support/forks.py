"""Start Python programs as forks of a prepared process.

The imports of rospy and numpy take most of the CPU time of a short program. The prepared process is
a fork of this one, at the import of this module, when it has imported them, but has no threads yet.
A program has its own process, session, arguments, environment, output and exit status, as usual;
only its /proc/PID/cmdline is that of this process.
"""

import atexit
import importlib
import io
import multiprocessing
import os
import runpy
import subprocess
import sys
import threading
from multiprocessing import reduction
from multiprocessing.connection import Connection, wait

import rospy

import mushr_ros_intro.ros.preview  # noqa: F401

_context = multiprocessing.get_context("fork")


class Fork:
    """A started program, with the same interface as subprocess.Popen."""

    def __init__(self, command, environment):
        output, child_output = os.pipe()
        self._status, child_status = _context.Pipe(duplex=False)
        with _lock:
            _requests.send((command, environment))
            for number in (child_output, child_status.fileno()):
                reduction.send_handle(_requests, number, None)
        os.close(child_output)
        child_status.close()
        self.stdout = os.fdopen(output, "rb")
        self.returncode = None
        self.pid = self._status.recv()

    def poll(self):
        """Return the exit status, or None if the program runs."""
        if self.returncode is None and self._status.poll():
            self.returncode = self._status.recv()
        return self.returncode

    def wait(self, timeout=None):
        """Return the exit status, at the latest after `timeout` [s]."""
        if self.returncode is None and not self._status.poll(timeout):
            raise subprocess.TimeoutExpired("fork", timeout)
        return self.poll()


def _serve(requests):
    """Start programs, and send the exit status of each, until this module's process has ended."""
    os.setsid()  # Ctrl-C ends the tests, which then end the programs
    started = {}
    while True:
        for ready in wait([requests, *started]):
            if ready is requests:
                try:
                    command, environment = requests.recv()
                except EOFError:
                    os._exit(0)
                output, status = (reduction.recv_handle(requests) for _ in range(2))
                status = Connection(status)
                program = _context.Process(target=_run, args=(command, environment, output, status))
                program.start()
                os.close(output)
                started[program.sentinel] = program, status
            else:
                program, status = started.pop(ready)
                program.join()
                status.send(program.exitcode)
                status.close()


def _run(command, environment, output, status):
    """Run a program in this process."""
    os.setsid()
    for number in (1, 2):
        os.dup2(output, number)
    os.close(output)
    sys.stdout = io.TextIOWrapper(io.FileIO(1, "w"), write_through=True)
    sys.stderr = io.TextIOWrapper(io.FileIO(2, "w"), write_through=True)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = list(command)
    importlib.reload(rospy.names)  # which has read the arguments and the namespace before
    sys.path[0] = os.path.dirname(os.path.realpath(command[0]))
    status.send(os.getpid())
    try:
        runpy.run_path(command[0], run_name="__main__")
    finally:
        atexit._run_exitfuncs()


_lock = threading.Lock()
_requests, _served = _context.Pipe()
if os.fork() == 0:
    _requests.close()
    _serve(_served)
_served.close()
