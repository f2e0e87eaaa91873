"""Run a node that is not trusted: bubblewrap, another user, and limits.

The tools are bwrap, and those of util-linux, which every Debian has: setpriv, prlimit, choom.
"""

import glob
import importlib.util
import os
import re
import shutil
import subprocess
import tempfile
from concurrent.futures import ProcessPoolExecutor
from typing import Dict, Iterator, List, NamedTuple, Sequence, Tuple

from mushr_ros_intro.isolation import system_calls, workspace
from mushr_ros_intro.isolation.node_process import MAX_MEMORY
from mushr_ros_intro.paths import package_folder

FIRST_USER = 60_000
USERS = 5_000
"""If root grades, each replay runs as another user without a name, from this range of numbers."""

LIMITS = {
    "--data": MAX_MEMORY,  # of a process [bytes]
    "--fsize": 20_000_000,  # size of a file [bytes]
    "--nofile": 512,  # open files of a process
    "--cpu": 120,  # time of a process [s]
    "--core": 0,  # size of a core dump [bytes]
}

MAX_PROCESSES = 200
"""Processes and threads of the user of a replay."""

_FILES = 64_000_000
"""Size of all files in /tmp, and of all in /dev/shm [bytes]."""

_VISIBLE = (
    *("/bin", "/lib", "/lib32", "/lib64", "/libx32", "/sbin", "/usr", "/opt/ros"),
    *("/etc/alternatives", "/etc/debian_version", "/etc/fonts", "/etc/group", "/etc/hosts"),
    *("/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d", "/etc/localtime"),
    *("/etc/matplotlibrc", "/etc/nsswitch.conf", "/etc/os-release", "/etc/passwd"),
    *("/etc/protocols", "/etc/python3", "/etc/ros", "/etc/services", "/etc/timezone"),
)
"""What a node sees of the system. Not all of it exists on every system."""

_PACKAGE = (
    *("lib/mushr_ros_intro", "lib/python3/dist-packages/mushr_ros_intro"),
    *("share/mushr_ros_intro", "share/doc/ros-mushr-ros-intro"),
)
"""Where this package is in /usr if it is installed; it contains solutions."""

_WORKSPACES = "/tmp/ros"
"""Where a node in namespaces sees the copies of the user's workspaces."""

# The arguments of bwrap are in a file, because a node can read its command line.
_BWRAP = 'exec bwrap --args 3 --seccomp 4 "$@" 3<"$0/arguments" 4<"$0/filter"'
_OPEN_FOLDERS = 'chmod 1777 /tmp /tmp/home /dev/shm && exec "$@"'  # bwrap makes them for root only


class Sandbox(NamedTuple):
    """How nodes are isolated from the rest of the system."""

    is_root: bool = False
    """Whether nodes run as another user."""
    has_namespaces: bool = False
    """Whether a node gets namespaces of its own."""
    hidden: Tuple[str, ...] = ()
    """Folders that a node cannot see, even if they are in a folder of the system."""
    folder: str = ""
    """The folder for all that nodes may see; "" if the nodes are trusted."""
    limits_size: bool = False
    """Whether bwrap can limit the size of folders; Debian 11's cannot."""

    def enter(self) -> None:
        """Prepare this process, which must have one thread, to run programs of `wrap`.

        It gets a network with only the loopback interface, which the programs share.

        Raises:
            OSError: the system refuses.
        """
        if self.folder:
            if self.has_namespaces:
                system_calls.enter_network()
            else:
                system_calls.make_filter(has_locks=True).load()

    def wrap(
        self,
        command: Sequence[str],
        environment: Dict[str, str],
        home: str,
        plan: str = "",
        folder: str = "",
        writable: bool = False,
    ) -> List[str]:
        """Return the command that runs a program of a submission in the sandbox.

        Args:
            command: the program, with its arguments.
            environment: of the program.
            home: an empty folder: for the program, or in namespaces, for bwrap only.
            plan: the path of the plan; "" if there is none.
            folder: the folder of the submission; "" if it is not in a folder of its own.
            writable: whether the program may write to `folder`.
        """
        moved = self._moves(plan, folder) if self.has_namespaces else {}

        def move(text: str) -> str:
            for path in sorted(moved, key=len, reverse=True):
                text = text.replace(path, moved[path])
            return text

        tools = ["setpriv", "--pdeathsig", "KILL"]  # the node ends if this process dies
        limits = [f"{name}={value}" for name, value in LIMITS.items()]
        if self.is_root:
            user = str(self.current_user)
            tools += ["--reuid", user, "--regid", user, "--clear-groups"]
            tools += ["--no-new-privs", "--bounding-set=-all", "--inh-caps=-all"]
        if self.is_root or self.has_namespaces and _counts_processes_of_namespaces():
            limits.append(f"--nproc={MAX_PROCESSES}")
        if self.folder:
            tools += ["choom", "-n", "1000", "--", "prlimit", *limits, "--"]
        if self.has_namespaces:
            tools = self._in_bwrap(tools, home, moved, folder if writable else "")
            home = "/tmp/home"
        # With the default, rospy warns: it gives a new folder the owner of HOME, which is root.
        values = {**environment, "HOME": home, "TMPDIR": home, "ROS_LOG_DIR": home}
        assignments = [f"{name}={move(value)}" for name, value in values.items()]
        # bwrap has the same environment, because a node can read it. No library is preloaded.
        return ["env", "-i", *assignments, *tools, *map(move, command)]

    def _in_bwrap(
        self, tools: List[str], home: str, moved: Dict[str, str], writable: str
    ) -> List[str]:
        """Return the tools that run bwrap, and in it other tools; write its files to `home`.

        Args:
            tools: in bwrap.
            home: an empty folder.
            moved: the paths that the program needs, and where it sees them.
            writable: one of these paths, to which it may write; "" for none.
        """
        with open(os.path.join(home, "arguments"), "w", encoding="utf-8") as file:
            file.writelines(f"{each}\0" for each in self._arguments())
            for path, place in moved.items():
                mode = "--bind" if path == writable else "--ro-bind"
                file.writelines(f"{each}\0" for each in (mode, path, place))
        with open(os.path.join(home, "filter"), "wb") as binary:
            system_calls.make_filter(has_locks=bool(writable)).export_bpf(binary)
        opened = ["sh", "-c", _OPEN_FOLDERS, "sh"] if self.is_root else []
        return ["sh", "-c", _BWRAP, home, *opened, *tools]

    def _arguments(self) -> Iterator[str]:
        """Yield the arguments of bwrap that are the same for all programs."""
        yield from ("--unshare-pid", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try")
        yield from ("--die-with-parent", "--new-session")
        if self.is_root:
            yield from ("--cap-drop", "ALL")
            for name in ("SETGID", "SETPCAP", "SETUID"):  # setpriv drops them
                yield from ("--cap-add", f"CAP_{name}")
        for path in ("/etc", "/opt"):  # otherwise, only root may enter them
            yield from ("--dir", path)
        for path in _VISIBLE:
            yield from ("--ro-bind-try", path, path)
        visible = tuple(f"{each}/" for each in _VISIBLE)
        for path in self.hidden:
            if os.path.isdir(path) and path.startswith(visible):
                yield from ("--tmpfs", path)
        yield from ("--proc", "/proc", "--dev", "/dev", "--remount-ro", "/dev")
        size = ("--size", str(_FILES)) if self.limits_size else ()
        for path in ("/tmp", "/dev/shm"):
            yield from (*size, "--tmpfs", path)
        for name in ("home", "plans", "submissions"):
            yield from ("--dir", f"/tmp/{name}")
        yield from ("--dir", "/var", "--chdir", "/tmp/home")
        yield from ("--symlink", "/tmp", "/var/tmp", "--remount-ro", "/")

    @property
    def _workspaces(self) -> str:
        return os.path.join(self.folder, ".ros")

    def copy_workspaces(self) -> Dict[str, str]:
        """Copy the user's workspaces for the nodes; return the environment variables for ROS.

        Raises:
            OSError: a file cannot be copied.
        """
        if not self.is_root and not self.has_namespaces:
            return workspace.inherited()
        os.mkdir(self._workspaces)
        place = _WORKSPACES if self.has_namespaces else self._workspaces
        return workspace.copy_workspaces(self._workspaces, place, self.hidden)

    def _moves(self, plan: str, folder: str) -> Dict[str, str]:
        """Return the paths that a node needs, and where it sees them; arguments as for `wrap`."""
        moved = {self._workspaces: _WORKSPACES} if os.path.isdir(self._workspaces) else {}
        if plan:
            moved[plan] = f"/tmp/plans/{os.path.basename(plan)}"
        if folder:
            moved[folder] = f"/tmp/submissions/{os.path.basename(folder)}"
        return moved

    @property
    def current_user(self) -> int:
        """The number of the user of nodes that this process starts."""
        return FIRST_USER + os.getpid() % USERS

    def end_processes(self) -> None:
        """End all processes that a node of this process has left behind."""
        if self.is_root and not self.has_namespaces:
            user = str(self.current_user)
            setpriv = ("setpriv", "--reuid", user, "--regid", user, "--clear-groups")
            subprocess.run([*setpriv, "kill", "-9", "-1"], stderr=subprocess.DEVNULL, check=False)


def _counts_processes_of_namespaces() -> bool:
    """Return whether the limit on processes of a user is separate in each namespace."""
    version = re.match(r"(\d+)\.(\d+)", os.uname().release)
    return version is not None and tuple(map(int, version.groups())) >= (5, 14)


UNLIMITED = (
    "partly isolated: this system's bwrap has no option --size, so a node can fill the memory with "
    "files; expected bubblewrap of Debian 12 or newer"
)


def make_sandbox(hidden: Sequence[str], folder: str) -> Tuple[Sandbox, str]:
    """Return the best sandbox that the system allows, and what is missing; "" if nothing.

    Args:
        hidden: folders that nodes must not see.
        folder: an empty folder that all users can reach, for all that nodes may see.

    Raises:
        OSError: a package is missing, or /dev/shm cannot be written.
    """
    if not (shutil.which("bwrap") and importlib.util.find_spec("seccomp")):
        raise OSError(
            "the isolation of submissions needs two packages; type: "
            "sudo apt-get install bubblewrap python3-seccomp"
        )
    if not os.access("/dev/shm", os.W_OK):
        raise OSError("/dev/shm cannot be written; type: sudo chmod 1777 /dev/shm")
    is_root = os.geteuid() == 0
    own = [f"{each}/{path}" for each in ("/usr", *glob.glob("/opt/ros/*")) for path in _PACKAGE]
    own.append(package_folder("."))
    folders = {os.path.realpath(each) for each in [*hidden, *own, folder]} - {"/"}
    sandbox = Sandbox(is_root, True, tuple(sorted(folders)), folder)
    with ProcessPoolExecutor(1) as pool:  # another process, because it enters a network
        limits_size, refusal = pool.submit(_try, sandbox).result()
    if not refusal:
        return sandbox._replace(limits_size=limits_size), "" if limits_size else UNLIMITED
    sandbox = sandbox._replace(has_namespaces=False)
    if is_root:
        return sandbox, (
            f"partly isolated: the system refuses namespaces ({refusal}). Each node runs as "
            "another user, but can use the network, and read what all users can read. Protect the "
            f"folders of hidden plans and solutions: chmod go= {package_folder('.')}"
        )
    return sandbox, (
        f"not isolated: the system refuses namespaces ({refusal}). The nodes run as the user of "
        "this program, so a node can read hidden plans and solutions, and change results. To "
        "isolate them, allow namespaces, or run this program as root (sudo)"
    )


def _try(sandbox: Sandbox) -> Tuple[bool, str]:
    """Return whether bwrap limits the size of folders; why namespaces are refused, "" if not."""
    usage = subprocess.run(["bwrap", "--help"], stdout=subprocess.PIPE, text=True, check=False)
    sandbox = sandbox._replace(limits_size="--size" in usage.stdout)
    try:
        sandbox.enter()
    except OSError as error:
        return False, str(error)
    with tempfile.TemporaryDirectory(dir=sandbox.folder) as home:
        command = sandbox.wrap(["true"], {"PATH": os.environ["PATH"]}, home)
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    reasons = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
    return sandbox.limits_size, reasons[-1] if done.returncode else ""
