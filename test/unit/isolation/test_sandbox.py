"""Check what a node sees and gets; test/system/test_grade_class.py runs nodes in the sandbox."""

import errno
import os
import subprocess
import sys

import pytest

from mushr_ros_intro.isolation import sandbox, system_calls
from mushr_ros_intro.isolation.sandbox import Sandbox, make_sandbox
from support.grading import ISOLATED

ENVIRONMENT = {"PATH": "/usr/bin", "ROS_PACKAGE_PATH": "/home/ann/.ros/0:/usr/share"}


@pytest.fixture
def isolated(tmp_path, monkeypatch):
    """Return a sandbox with namespaces, and the home folder of a node."""
    monkeypatch.setattr(sandbox.system_calls, "make_filter", lambda has_locks: Filter())
    (tmp_path / "home").mkdir()
    (tmp_path / ".ros").mkdir()
    return Sandbox(True, True, ("/usr/share",), str(tmp_path), True), str(tmp_path / "home")


class Filter:
    """Stands in for a filter of system calls."""

    def export_bpf(self, file):
        file.write(b"filter")


def test_arguments_of_bwrap(isolated):
    """The command line, which a node can read, has no path of the machine."""
    box, home = isolated
    plan, folder = f"{box.folder}/x/hidden.txt", f"{box.folder}/ann"
    node = [f"{folder}/node.py", f"_plan_file:={plan}"]
    command = box.wrap(node, ENVIRONMENT, home, plan, folder)
    inside = command[command.index("sh") :]
    assert inside[-2:] == ["/tmp/submissions/ann/node.py", "_plan_file:=/tmp/plans/hidden.txt"]
    assert [each for each in inside if box.folder in each] == [home]  # $0 of the outer shell
    with open(os.path.join(home, "arguments"), encoding="utf-8") as file:
        arguments = file.read().split("\0")
    places = {
        (option, path)
        for option, path, place in zip(arguments, arguments[1:], arguments[2:])
        if option in ("--bind", "--ro-bind") and place.startswith("/tmp/")
    }
    assert places == {("--ro-bind", each) for each in (plan, folder, f"{box.folder}/.ros")}
    hides = [place for option, place in zip(arguments, arguments[1:]) if option == "--tmpfs"]
    assert hides == ["/usr/share", "/tmp", "/dev/shm"]


def test_a_missing_package(monkeypatch):
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: None)
    with pytest.raises(OSError, match="apt-get install bubblewrap python3-seccomp"):
        make_sandbox([], "/tmp")


def test_a_folder_for_locks_that_cannot_be_written(monkeypatch):
    pytest.importorskip("seccomp")
    monkeypatch.setattr("os.access", lambda path, _: path != "/dev/shm")
    with pytest.raises(OSError, match="chmod 1777 /dev/shm"):
        make_sandbox([], "/tmp")


@ISOLATED
def test_a_bwrap_that_does_not_limit_the_size(tmp_path, monkeypatch):
    """As in Debian 11 and Ubuntu 20.04."""
    pytest.importorskip("seccomp")
    old = tmp_path / "bwrap"
    old.write_text('#!/bin/sh\n[ "$1" = --help ] || exec /usr/bin/bwrap "$@"\n')
    old.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    made, missing = make_sandbox([], "/tmp")
    assert not made.limits_size and "a node can fill the memory" in missing


CALLS = """
import ctypes, errno
from mushr_ros_intro.isolation.system_calls import FORBIDDEN, make_filter, number_of
numbers = {name: number_of(name) for names in FORBIDDEN.values() for name in names}
make_filter(has_locks=False).load()
for error, names in FORBIDDEN.items():
    for name in names:
        ctypes.set_errno(0)
        ctypes.CDLL(None, use_errno=True).syscall(numbers[name], *6 * [0])
        if ctypes.get_errno() != error:
            print(name, ctypes.get_errno())
"""


def test_forbidden_system_calls():
    """Also those that say which pages of a file are in memory."""
    pytest.importorskip("seccomp")
    done = subprocess.run([sys.executable, "-c", CALLS], capture_output=True, text=True)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)
    assert {"fadvise64", "preadv2", "mincore", "cachestat", "readahead"} <= {
        *system_calls.FORBIDDEN[errno.ENOSYS]
    }
