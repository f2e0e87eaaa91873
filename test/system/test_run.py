"""Check scripts/run: in any folder and environment, on loopback only, and without leftovers."""

import contextlib
import glob
import os
import pty
import re
import signal
import socket
import subprocess
import threading
import uuid

import pytest

from support.display import Display
from support.geometry import POSITION_TOLERANCE
from support.helpers import PATIENCE, wait_for
from support.paths import CHECKOUT
from support.scripts import add_programs, needs_workspace

pytestmark = needs_workspace


@contextlib.contextmanager
def as_terminal(path):
    """Yield the file descriptor of a terminal; what is written to it is written to a file."""
    own, others = pty.openpty()

    def copy():
        with open(path, "ab", buffering=0) as file, contextlib.suppress(OSError):
            while True:  # until all processes have closed the terminal
                file.write(os.read(own, 65536))

    threading.Thread(target=copy, daemon=True).start()
    yield others
    os.close(others)


class Run:
    """The script during a drive, in an environment with wrong settings for ROS."""

    PLAN = "Ann's plan #1: a.txt"

    def __init__(self, folder, seconds, terminal=False, **variables):
        self.mark = f"MARK={uuid.uuid4()}"
        add_programs(folder / "bin", ("cmake", "python", "python3"))
        (folder / self.PLAN).write_text(f"1, 2, 0.5\n1.0, 0.1, {seconds}\n")
        environment = dict(
            [self.mark.split("=")],
            PATH=f"{folder}/bin:/usr/bin:/bin",
            CDPATH="/",
            CMAKE_PREFIX_PATH="/nonsense",
            LANG="C",
            LD_PRELOAD="",
            PYTHONHOME="/nonsense",
            PYTHONPATH="/nonsense",
            ROS_HOSTNAME="nonsense.example",
            ROS_IP="192.0.2.1",
            ROS_MASTER_URI="http://192.0.2.2:11311",
            ROS_NAMESPACE="/nonsense",
            ROS_PACKAGE_PATH="/nonsense",
            **variables,
        )
        self.log = folder / "log"
        with contextlib.ExitStack() as files:
            log = files.enter_context(open(self.log, "wb"))
            if terminal:
                log = files.enter_context(as_terminal(self.log))
            self.process = subprocess.Popen(
                [f"{CHECKOUT}/scripts/run", self.PLAN],
                cwd=str(folder),
                env=environment,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # Without this, a background process ignores SIGINT.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )

    def wait_for_text(self, text):
        wait_for(lambda: text in self.log.read_text() or self.process.poll() is not None, text)
        log = self.log.read_text()
        assert text in log, log

    def processes(self):
        """Return the folders in /proc of the processes of the script."""
        found = []
        for path in glob.glob("/proc/[0-9]*/environ"):
            with contextlib.suppress(OSError), open(path, "rb") as file:  # it has ended
                if self.mark.encode() in file.read():
                    found.append(os.path.dirname(path))
        return found

    def listening(self):
        """Return the TCP addresses on which these processes listen, in the format of /proc."""
        files = set()
        for process in self.processes():
            for path in glob.glob(f"{process}/fd/*"):
                with contextlib.suppress(OSError):  # closed meanwhile
                    files.add(os.readlink(path))
        addresses = []
        for table in glob.glob("/proc/net/tcp*"):
            with open(table) as file:
                lines = [line.split() for line in file.readlines()[1:]]
            addresses += [w[1] for w in lines if w[3] == "0A" and f"socket:[{w[9]}]" in files]
        return addresses

    def __enter__(self):
        return self

    def __exit__(self, kind, error, _):
        self.process.terminate()
        self.process.wait(PATIENCE)
        if kind:  # show the log, too
            raise AssertionError(self.log.read_text()) from error


def test_a_drive(tmp_path):
    with Run(tmp_path, 1.5) as script:
        script.wait_for_text("line 2 of 2")
        script.process.send_signal(signal.SIGSTOP)  # so that it does not end the simulation
        try:  # two for each node, and the master
            wait_for(lambda: len(script.listening()) > 8, "the nodes to listen")
            addresses = script.listening()
        finally:
            script.process.send_signal(signal.SIGCONT)
        assert script.process.wait(PATIENCE) == 0, script.log.read_text()
    assert all(re.match("0100007F:|0{24}01000000:", address) for address in addresses), addresses
    log = script.log.read_text()
    difference = re.search(r"the car drove .* difference (\S+) m", log)
    assert difference, log
    assert float(difference.group(1)) < POSITION_TOLERANCE
    # There is no display.
    assert re.search(r"open http://localhost:\d+ in a browser", log)
    assert script.processes() == []


@pytest.mark.full
@pytest.mark.parametrize(
    "number, moment", [(signal.SIGTERM, "starting"), (signal.SIGINT, "line 2 of 2")]
)
def test_interrupted(tmp_path, number, moment):
    with Run(tmp_path, 100.0) as script:
        script.wait_for_text(moment)
        script.process.send_signal(number)
        assert script.process.wait(PATIENCE) == 128 + number, script.log.read_text()
        assert script.processes() == []


@pytest.mark.full
def test_in_a_terminal(tmp_path):
    """The drive waits for the page, and the page stays until Ctrl-C."""
    with Run(tmp_path, 0.3, terminal=True) as script:
        script.wait_for_text("the drive begins when the page is open")
        address = re.search(r"open http://(localhost):(\d+) in a browser", script.log.read_text())
        assert "line 2 of 2" not in script.log.read_text()
        with socket.create_connection(address.groups()):
            script.wait_for_text("the page stays open until you press Ctrl-C")
        assert "next: scripts/run PLAN" in script.log.read_text()
        script.process.send_signal(signal.SIGINT)
        assert script.process.wait(PATIENCE) == 0, script.log.read_text()
        assert script.processes() == []


@pytest.mark.full
def test_with_a_display(tmp_path):
    """The drive begins when rviz shows its window, and the window stays until Ctrl-C."""
    display = Display()
    try:
        with Run(tmp_path, 1.5, terminal=True, DISPLAY=display.name) as script:
            script.wait_for_text("line 2 of 2")
            wait_for(lambda: display.windows("rviz"), "the window", 1.0)
            script.wait_for_text("rviz stays open until you press Ctrl-C")
            assert display.windows("rviz")
            script.process.send_signal(signal.SIGINT)
            assert script.process.wait(PATIENCE) == 0, script.log.read_text()
            assert script.processes() == []
    finally:
        display.end()


def test_a_wrong_plan(tmp_path):
    """The script starts nothing."""
    (tmp_path / "bad.txt").write_text("0,0,0\nfast,0\n")
    command = [f"{CHECKOUT}/scripts/run", "bad.txt"]
    output = subprocess.STDOUT
    script = subprocess.run(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=output, text=True)
    assert script.returncode == 1
    assert "bad.txt:2:1: speed is 'fast'" in script.stdout
    assert "starting" not in script.stdout
