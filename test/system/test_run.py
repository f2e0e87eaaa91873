"""Check scripts/run: from anywhere, in an odd environment, on loopback only, leaving no trace."""

import contextlib
import glob
import os
import re
import signal
import subprocess
import time
import uuid

import pytest

from support import paths

CHECKOUT = paths.CHECKOUT
PATIENCE = 60.0
"""[s] How long a step of the script may take on a busy machine."""
POSITION_TOLERANCE = 1e-6
"""[m] What the package promises between where the car stops and the closed form."""

pytestmark = pytest.mark.skipif(
    not os.path.exists(f"{CHECKOUT}/build/.workspace/sources"),
    reason="scripts/setup has not built here, and a test does not install anything",
)


class Run:
    """The script at work on a plan of some seconds, in an environment that would mislead ROS."""

    def __init__(self, folder, seconds):
        self.mark = f"MARK={uuid.uuid4()}"
        (folder / "bin").mkdir()
        for name in ("cmake", "python", "python3"):
            (folder / "bin" / name).write_text("#!/bin/sh\nexit 3\n")
            (folder / "bin" / name).chmod(0o755)
        (folder / "a plan.txt").write_text(f"1, 2, 0.5\n1.0, 0.1, {seconds}\n")
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
        )
        self.log = folder / "log"
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(
                [f"{CHECKOUT}/scripts/run", "a plan.txt"],
                cwd=str(folder),
                env=environment,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # Whoever runs the tests in the background has it ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )

    def wait_for_text(self, text):
        deadline = time.monotonic() + PATIENCE
        while text not in self.log.read_text():
            assert time.monotonic() < deadline, f"waited for {text}: {self.log.read_text()}"
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.01)

    def processes(self):
        """Return the folders in /proc of all that the script has started and that still runs."""
        found = []
        for path in glob.glob("/proc/[0-9]*/environ"):
            with contextlib.suppress(OSError), open(path, "rb") as file:  # ended, another user's
                if self.mark.encode() in file.read():
                    found.append(os.path.dirname(path))
        return found

    def listening(self):
        """Return the addresses on which these processes wait for TCP, as /proc writes them."""
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


@pytest.fixture
def run(tmp_path):
    """Return what starts the script for a number of seconds; nothing of it outlives the test."""
    started = []

    def start(seconds):
        started.append(Run(tmp_path, seconds))
        return started[-1]

    yield start
    for each in started:
        each.process.terminate()
        each.process.wait(PATIENCE)


def test_a_drive(run):
    script = run(1.5)
    script.wait_for_text("row 1 of 1")
    addresses = script.listening()
    assert len(addresses) > 8  # two for each node, and the master
    assert all(re.match("0100007F:|0{24}01000000:", address) for address in addresses), addresses
    assert script.process.wait(PATIENCE) == 0, script.log.read_text()
    difference = re.search(r"the car drove .* difference (\S+) m", script.log.read_text())
    assert float(difference.group(1)) < POSITION_TOLERANCE
    assert script.processes() == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["starting", "row 1 of 1"])
def test_an_end_before_time(run, number, moment):
    script = run(100.0)
    script.wait_for_text(moment)
    script.process.send_signal(number)
    assert script.process.wait(PATIENCE) == 128 + number, script.log.read_text()
    assert script.processes() == []


def test_a_plan_that_is_not_there(run, tmp_path):
    script = run(1.0)
    script.wait_for_text("starting")
    (tmp_path / "a plan.txt").unlink()
    assert script.process.wait(PATIENCE) == 1
    assert "a plan.txt:1:1: no such plan file" in script.log.read_text()
    assert script.processes() == []
