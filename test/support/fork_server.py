"""Start Python programs in 0.03 s of CPU time instead of 0.2 s: fork_server.py SOCKET.

The server imports everything that the programs need, except rospy. For each request it forks a
child process, which then is the program. rospy is not imported, because it reads the command line
and the environment of its process when it is imported. The child ends after the functions of
atexit; modules are not deleted.

A request is a line of JSON on a connection to the socket; see `Forked`. The server answers with the
process id of the program, and with its exit status when it has ended. The server ends when its
standard input is closed.
"""

import atexit
import contextlib
import gc
import glob
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import tempfile

SERVER = "MUSHR_FORK_SERVER"
"""The environment variable with the path of the server's socket."""

_MODULES = """
    asyncio concurrent.futures email.parser http.client http.server multiprocessing.connection
    unittest xml.etree.ElementTree xmlrpc.server
    hypothesis.strategies
    PIL.Image matplotlib.backends.backend_svg matplotlib.figure matplotlib.patches numpy pytest yaml
    tornado.httpserver tornado.web tornado.websocket
    ackermann_msgs.msg genpy.message geometry_msgs.msg nav_msgs.msg nav_msgs.srv rosgraph_msgs.msg
    rosgraph.xmlrpc roslib.message roslib.packages rosmaster.master_api rosgraph.roslogging
    roslaunch.node_args roslaunch.parent rosmaster.main rospkg rostest sensor_msgs.msg std_msgs.msg
    std_srvs.srv tf2_msgs.msg visualization_msgs.msg
"""


class Forked:
    """A program that the server runs; with the attributes of subprocess.Popen that `Process` uses.

    Its output can be read from `stdout`. It leads a session of its own.
    """

    def __init__(self, command, environment, output=None):
        """Start a program.

        Args:
            command: the path of a Python program, or -m and the name of a module; its arguments.
            environment: of the program. Python itself has the environment of the server.
            output: the path of a file for the output, instead of `stdout`.
        """
        if output:
            write = os.open(output, os.O_WRONLY | os.O_CREAT)
        else:
            read, write = os.pipe()
            self.stdout = os.fdopen(read, "rb")
        self._connection = socket.socket(socket.AF_UNIX)
        self._connection.connect(os.environ[SERVER])
        request = {
            "command": list(command),
            "environment": environment,
            "folder": os.getcwd(),
            "output": f"/proc/{os.getpid()}/fd/{write}",
        }
        self._connection.sendall(json.dumps(request).encode() + b"\n")
        self._answers = self._connection.makefile("rb")
        self.pid = int(self._answers.readline())
        os.close(write)
        self.returncode = None

    def poll(self):
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout=None):
        if self.returncode is None:
            with selectors.DefaultSelector() as selector:
                selector.register(self._connection, selectors.EVENT_READ)
                if not selector.select(timeout):
                    raise subprocess.TimeoutExpired("a forked program", timeout)
            status = self._answers.readline()
            if not status:
                raise OSError("the fork server has ended")
            self.returncode = int(status)
        return self.returncode


@contextlib.contextmanager
def running():
    """Run a server for this process, unless there is one already."""
    if SERVER in os.environ:
        yield
        return
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "fork_server")
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(path)
            listener.listen(128)
            server = subprocess.Popen(
                [sys.executable, os.path.abspath(__file__), str(listener.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
                start_new_session=True,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )
        os.environ[SERVER] = path
        try:
            yield
        finally:
            del os.environ[SERVER]
            server.stdin.close()
            server.wait()


def _import_all():
    """Import all modules that do not import rospy."""
    for name in _MODULES.split():
        importlib.import_module(name)
    package = importlib.import_module("mushr_ros_intro").__path__[0]
    for folder in ("", "plan/", "world/", "car/", "preview/"):
        for path in glob.glob(f"{package}/{folder}[a-z]*.py"):
            name = os.path.relpath(path[:-3], os.path.dirname(package))
            importlib.import_module(name.replace("/", "."))
    assert "rospy" not in sys.modules
    gc.collect()
    gc.freeze()


def _serve(listener):
    """Serve until the standard input is closed; return the request and its output in each child."""
    clients = {}  # the connection for each running program
    woken, waker = socket.socketpair()
    waker.setblocking(False)
    signal.set_wakeup_fd(waker.fileno())
    signal.signal(signal.SIGCHLD, lambda *_: None)
    selector = selectors.DefaultSelector()
    for each in (listener, woken, sys.stdin):
        selector.register(each, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.fileobj is sys.stdin:
                sys.exit()
            if key.fileobj is woken:
                woken.recv(4096)
                _report_ends(clients)
                continue
            client, _ = listener.accept()
            request = json.loads(client.makefile("rb").readline())
            output = os.open(request["output"], os.O_WRONLY)
            pid = os.fork()
            if not pid:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                selector.close()
                for each in (client, listener, woken, waker, *clients.values()):
                    each.close()
                return request, output
            os.close(output)
            clients[pid] = client
            client.sendall(b"%d\n" % pid)


def _report_ends(clients):
    """Send the exit status of each program that has ended; negative for a signal."""
    while clients:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if not pid:
            return
        with contextlib.suppress(OSError), clients.pop(pid) as client:
            number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else None
            code = os.WEXITSTATUS(status) if number is None else -number
            client.sendall(b"%d\n" % code)


def _become(request, output):
    """Give this process the session, the files, the folder and the environment of a program."""
    os.setsid()
    null = os.open(os.devnull, os.O_RDONLY)
    for old, new in ((null, 0), (output, 1), (output, 2)):
        os.dup2(old, new)
    os.close(output)
    os.close(null)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])


def _run(command, status):
    """Run a program in this process; keep its exit status, unless Python has to report its end."""
    try:
        # In place: the defaults of some functions that are imported already are the same list.
        if command[0] == "-m":
            sys.argv[:] = command[1:]
            runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
        else:
            sys.argv[:] = command
            sys.path[0] = os.path.dirname(sys.argv[0])
            runpy.run_path(sys.argv[0], run_name="__main__")
        status.append(0)
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            status.append(end.code or 0)
        raise


if __name__ == "__main__":
    _status = []
    # At its end, Python would delete all modules. For this it copies the memory of the server,
    # which takes 0.07 s of CPU time. The first function of atexit runs after all others.
    atexit.register(lambda: _status and os._exit(_status[0]))
    with socket.socket(fileno=int(sys.argv[1])) as _listener:
        _import_all()
        _request, _output = _serve(_listener)
    _become(_request, _output)
    _run(_request["command"], _status)
