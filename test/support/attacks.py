#!/usr/bin/python3
"""Attacks of a node on the machine that grades it.

test/system/test_attacks.py grades this file as the node of a submission. It imports nothing of this
package, which a node cannot see. It prints the attacks that succeed, and how.
"""

import ctypes
import fcntl
import importlib.util
import json
import mmap
import os
import signal
import socket
from contextlib import suppress
from typing import Any, Callable, Dict, Iterator, NamedTuple

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLONE_NEWUSER = 0x10000000
_AF_VSOCK = 40
_KEY_SPEC_SESSION_KEYRING = -3
_MB = 1_000_000


class Targets(NamedTuple):
    """What the attacks aim at."""

    secret: str
    """The path of a file in the folder of hidden plans, which all users may read and write."""
    solutions: str
    """Paths of solutions, separated by colons."""
    port: int
    """A server listens here on the loopback interface of the machine."""
    process: int
    """A process of the machine."""
    token: str
    """Is in the environment of grade.py."""
    add_key: int
    """The number of the system call."""


def _read_secret(targets: Targets) -> Any:
    with open(targets.secret, encoding="utf-8") as file:
        return file.read()


def _write_secret(targets: Targets) -> Any:
    with open(targets.secret, "a", encoding="utf-8"):
        return targets.secret


def _find_solution(targets: Targets) -> Any:
    package = importlib.util.find_spec("mushr_ros_intro")
    if package and package.origin:  # otherwise, its folder is empty
        return "import mushr_ros_intro"
    readable = [each for each in targets.solutions.split(":") if os.access(each, os.R_OK)]
    return [each for each in readable if os.path.isfile(each) or os.listdir(each)]


def _write_system(_: Targets) -> Iterator[str]:
    for folder in ("/", "/dev", "/etc", "/opt", "/run", "/run/lock", "/usr", "/var", "/mnt"):
        with suppress(OSError), open(f"{folder}/attack", "wb"):
            yield folder


def _fill(_: Targets) -> Iterator[str]:
    for folder in (os.environ["HOME"], "/dev/shm"):
        paths = [f"{folder}/attack{number}" for number in range(10)]
        with suppress(OSError):
            for path in paths:
                with open(path, "wb") as file:
                    file.write(bytes(15 * _MB))
            yield folder
        for path in filter(os.path.exists, paths):
            os.remove(path)


def _add_key(targets: Targets) -> Any:
    arguments = (b"user", b"attack", b"the plan", 8, _KEY_SPEC_SESSION_KEYRING)
    return _LIBC.syscall(targets.add_key, *arguments) != -1


def _use_together(_: Targets) -> Iterator[str]:
    """Watch a file that all nodes see, or lock one so that another process notices it."""
    path = os.path.join(os.environ["HOME"], "lock")
    for lock in (fcntl.flock, fcntl.lockf):
        with open(path, "wb") as file:
            lock(file, fcntl.LOCK_EX)
            child = os.fork()
            if child == 0:
                with suppress(OSError), open(path, "wb") as other:
                    lock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os._exit(0)
                os._exit(1)
            if os.waitpid(child, 0)[1]:
                yield lock.__name__
    if _LIBC.inotify_init() != -1:
        yield "inotify"


def _privileges(_: Targets) -> Iterator[str]:
    with open("/proc/self/status", encoding="ascii") as file:
        status = dict(line.split(":\t", 1) for line in file if ":\t" in line)
    for name in ("CapPrm", "CapEff", "CapInh", "CapAmb"):
        if int(status[name], 16):
            yield f"{name} {status[name].strip()}"
    if int(status["NoNewPrivs"]) != 1:
        yield "set-user-ID programs"


def _see_environment(targets: Targets) -> Iterator[str]:
    parts = [each.encode() for each in (targets.token, os.path.dirname(targets.secret))]
    for process in filter(str.isdigit, os.listdir("/proc")):
        for name in ("environ", "cmdline"):
            with suppress(OSError), open(f"/proc/{process}/{name}", "rb") as file:
                text = file.read()
                if any(part in text for part in parts):
                    yield f"/proc/{process}/{name}"


def _see_process(targets: Targets) -> Any:
    return os.path.exists(f"/proc/{targets.process}")


def _signal(_: Targets) -> Any:
    """Whether a signal does not end a process that sends it to itself, as in process 1."""
    return os.getpid() == 1


def _connect(targets: Targets) -> Iterator[str]:
    yield from (name for _, name in socket.if_nameindex() if name != "lo")
    with suppress(OSError), socket.create_connection(("127.0.0.1", targets.port), 2):
        yield f"port {targets.port}"


def _leave(targets: Targets) -> Any:
    """Start a process that tries to survive; grade.py looks for it."""
    if os.fork() == 0:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.setsid()
        if os.fork() == 0:
            os.execvp("sh", ["sh", "-c", "sleep 600", targets.token])
        os._exit(0)
    return False


def _allocate(_: Targets) -> Any:
    return len(bytearray(3000 * _MB))


FILLS = "fill the memory with files in `/tmp` or `/dev/shm`"
LEAVE = "leave a process behind"
ATTACKS: Dict[str, Callable[[Targets], Any]] = {
    "read hidden plans, results and other submissions": _read_secret,
    "change results": _write_secret,
    "read or import the solution": _find_solution,
    "write to the folders of the system": _write_system,
    FILLS: _fill,
    "keep a key in the kernel for the next replay": _add_key,
    "signal to another node with a lock on a file": _use_together,
    "use privileges, or gain them": _privileges,
    "read the environment or the arguments of grade.py": _see_environment,
    "see the processes of the machine": _see_process,
    "survive signals that it sends to itself": _signal,
    "reach the network of the machine": _connect,
    "trace another process": lambda _: _LIBC.ptrace(0, 0, 0, 0) != -1,
    "create namespaces": lambda _: _LIBC.unshare(_CLONE_NEWUSER) != -1,
    "mount a folder": lambda _: _LIBC.mount(b"none", b"/tmp", b"tmpfs", 0, None) != -1,
    "reach the host of a virtual machine (AF_VSOCK)": lambda _: socket.socket(_AF_VSOCK),
    LEAVE: _leave,
    "use too much memory": _allocate,
    "use shared memory, which is no data of a process": lambda _: mmap.mmap(-1, _MB),
}
"""The attacks; each returns what it has reached, or fails."""


def main() -> None:
    """Run all attacks; targets.json is beside this file."""
    with open(os.path.join(os.path.dirname(__file__), "targets.json"), encoding="utf-8") as file:
        targets = Targets(**json.load(file))
    found: Dict[str, str] = {}
    for each, attack in ATTACKS.items():
        try:
            reached = attack(targets)
            reached = list(reached) if isinstance(reached, Iterator) else reached
            found[each] = str(reached) if reached else ""
        except (OSError, MemoryError):
            found[each] = ""
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
