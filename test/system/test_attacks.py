"""Grade a node that attacks the machine: what is said to be stopped has been tried."""

import functools
import json
import os
import pathlib
import secrets
import shutil
import signal
import socket
import tempfile
from contextlib import suppress

import pytest

from mushr_ros_intro.isolation import system_calls
from support import attacks
from support.attacks import FILLS, LEAVE, Targets
from support.grading import ISOLATED, WITHOUT_NAMESPACES, grade, load
from support.paths import PACKAGE

AS_USER = ("setpriv", "--reuid", "1000", "--regid", "1000", "--clear-groups") * (os.geteuid() == 0)
SOLUTIONS = (
    *(f"{PACKAGE}/src/path_publisher.py", f"{PACKAGE}/examples"),
    *("/usr/lib/mushr_ros_intro", "/usr/share/doc/ros-mushr-ros-intro/examples"),
)


@pytest.fixture
def reached():
    """Return `graded` for a folder that all users may enter; only the sandbox protects it."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        os.chmod(folder, 0o777)
        yield functools.partial(graded, pathlib.Path(folder))


def graded(top, prefix):
    """Grade the attacks in a folder; return what each has reached, and the output of grade.py."""
    for name in ("attacks", "plans", "home"):
        (top / name).mkdir()
        (top / name).chmod(0o777)
    secret = top / "plans" / "secret.txt"
    secret.write_text("0,0,0\n1,0,2\n")
    secret.chmod(0o666)
    token = secrets.token_hex(16)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port, number = server.getsockname()[1], system_calls.number_of("add_key")
        values = (str(secret), ":".join(SOLUTIONS), port, os.getpid(), token, number)
        node = top / "attacks" / "path_publisher.py"
        shutil.copyfile(attacks.__file__, node)
        node.chmod(0o755)
        (top / "attacks" / "targets.json").write_text(json.dumps(Targets(*values)._asdict()))
        home = str(top / "home")
        plans = ("--plans", secret, "--out", top / "home" / "out")
        environment = {"HOME": home, "TMPDIR": home, "TOKEN": token}
        status, output = grade(top / "attacks", *plans, prefix=prefix, **environment)
        assert status == 1, output
    (plan,) = load(top / "home" / "out" / "data" / "attacks.json").plans
    found = json.loads(plan.judgement.recorded.output.splitlines()[-1])
    found[LEAVE] = " ".join(end_survivors(token))
    assert len(found) == 19
    return {name: text for name, text in found.items() if text}, output


def end_survivors(token):
    """End the processes that an attack has left behind, and return them."""
    found = []
    for process in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError), open(f"/proc/{process}/cmdline", "rb") as file:
            if token.encode() in file.read():
                os.kill(int(process), signal.SIGKILL)
                found.append(process)
    return found


def assert_nothing_is_reached(found, output):
    """Or what grade.py says of a system with an old bwrap, such as Debian 11."""
    assert not found or ([*found] == [FILLS] and output.count("can fill the memory with f") == 1)


@ISOLATED
def test_a_user_without_root_is_isolated(reached):
    assert_nothing_is_reached(*reached(AS_USER))


@ISOLATED
@pytest.mark.full
def test_root_is_isolated(reached):
    assert_nothing_is_reached(*reached(()))


@pytest.mark.full
def test_without_namespaces(reached):
    """grade.py says once what is not protected."""
    found, output = reached(WITHOUT_NAMESPACES)
    assert "reach the network of the machine" in found
    assert output.count("isolated: the system refuses namespaces") == 1
