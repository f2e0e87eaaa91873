"""Run a node that is not trusted: another user, limits, and namespaces of Linux.

The tools are those of util-linux, which every Debian has: unshare, mount, setpriv, prlimit, choom.
"""

import ctypes
import fcntl
import os
import pwd
import socket
import struct
import subprocess
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.replay import workspace

FIRST_USER = 60_000
USERS = 5_000
"""Each replay runs as another user without a name, from this range of numbers."""

LIMITS = {
    "--data": 1_500_000_000,  # memory of a process [bytes]
    "--nproc": 200,  # processes and threads of the user
    "--fsize": 20_000_000,  # size of a file [bytes]
    "--nofile": 512,  # open files of a process
    "--cpu": 120,  # time of a process [s]
    "--core": 0,  # size of a core dump [bytes]
}

_CLONE_NEWNET = 0x40000000
_SIOCSIFFLAGS = 0x8914
_IFF_UP = 1

# Arguments: the number of visible paths; for each its path, its new place, and ro or rw; the number
# of hidden folders; these folders; the command. First, the visible paths are mounted below /mnt,
# because they may be in a folder that is hidden.
_MOUNT = """
set -eu
mount -t tmpfs -o size=1m tmpfs /mnt
count=$1; shift
for i in $(seq "$count"); do
  if [ -d "$1" ]; then mkdir "/mnt/$i"; else : >"/mnt/$i"; fi
  mount --bind "$1" "/mnt/$i"
  mount -o "remount,bind,nosuid,nodev,$3" "/mnt/$i"
  eval "place_$i=\\$2"
  shift 3
done
for folder in /tmp /var/tmp /dev/shm; do
  mount -t tmpfs -o "mode=1777,size=64m,nr_inodes=10k,nosuid,nodev" tmpfs "$folder"
done
mkdir -m 1777 /tmp/home
for i in $(seq "$count"); do
  eval "place=\\$place_$i"
  if [ -d "/mnt/$i" ]; then mkdir -p "$place"; else mkdir -p "${place%/*}"; : >"$place"; fi
  mount --move "/mnt/$i" "$place"
done
umount /mnt
hidden=$1; shift
for i in $(seq "$hidden"); do
  # A folder in a hidden folder is not there any more. /tmp has been replaced.
  case "$1/" in
  /tmp/*) ;;
  *) [ ! -d "$1" ] || mount -t tmpfs -o mode=700,size=4k tmpfs "$1" ;;
  esac
  shift
done
mount -o remount,bind,ro /
exec "$@"
"""

# Ends the node if this process dies.
_DIE_TOGETHER = ("setpriv", "--pdeathsig", "KILL")

_WORKSPACES = "/tmp/ros"
"""Where a node with namespaces sees the copies of the user's workspaces."""

_NAMESPACES = ("unshare", "--mount", "--pid", "--ipc", "--fork", "--kill-child", "--mount-proc")


class Sandbox(NamedTuple):
    """How nodes are isolated from the rest of the system."""

    is_root: bool = False
    """Whether this process may change its user."""
    user: Optional[int] = None
    """The user of all nodes; None: a different one for each replay."""
    has_namespaces: bool = False
    """Whether a node gets namespaces of its own."""
    hidden: Tuple[str, ...] = ()
    """Folders that a node cannot see."""
    folder: str = ""
    """The folder for all that nodes may see; "" for the usual temporary folder."""

    def enter_network(self) -> None:
        """Move this process, which must have one thread, into a network of its own.

        The network contains only the loopback interface. The programs of `wrap` share it.

        Raises:
            OSError: the system refuses.
        """
        if self.has_namespaces:
            libc = ctypes.CDLL(None, use_errno=True)
            if libc.unshare(_CLONE_NEWNET) != 0:
                raise OSError(ctypes.get_errno(), "unshare(CLONE_NEWNET)")
            with socket.socket() as loopback:
                fcntl.ioctl(loopback, _SIOCSIFFLAGS, struct.pack("16sh", b"lo", _IFF_UP))

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
            home: a folder for the program, which is not used if there are namespaces.
            plan: the path of the plan; "" if there is none.
            folder: the folder of the submission; "" if it is not in a folder of its own.
            writable: whether the program may write to `folder`.
        """
        moved = self._moves(plan, folder) if self.has_namespaces else {}
        home = "/tmp/home" if self.has_namespaces else home

        def move(text: str) -> str:
            for path in sorted(moved, key=len, reverse=True):
                text = text.replace(path, moved[path])
            return text

        # With the default, rospy warns: it gives a new folder the owner of HOME, which is root.
        values = {**environment, "HOME": home, "TMPDIR": home, "ROS_LOG_DIR": home}
        assignments = [f"{name}={move(value)}" for name, value in values.items()]
        inner = ["env", "-i", *assignments, *map(move, command)]
        if not self.is_root:
            return [*_DIE_TOGETHER, *inner]
        user = str(self.current_user)
        limits = [f"{name}={value}" for name, value in LIMITS.items()]
        inner = [
            # Changing the user cancels --kill-child of unshare, so --pdeathsig is needed here, too.
            *(*_DIE_TOGETHER, "--reuid", user, "--regid", user, "--clear-groups"),
            *("--no-new-privs", "--bounding-set=-all", "--inh-caps=-all"),
            *("choom", "-n", "1000", "--", "prlimit", *limits, "--", *inner),
        ]
        without_preload = ["env", "-u", "LD_PRELOAD"]  # nodes may not reach this library
        if not self.has_namespaces:
            return [*without_preload, *inner]
        modes = {path: "rw" if writable and path == folder else "ro" for path in moved}
        triples = [each for path in moved for each in (path, moved[path], modes[path])]
        arguments = [str(len(moved)), *triples, str(len(self.hidden)), *self.hidden]
        tools = [*without_preload, *_DIE_TOGETHER, *_NAMESPACES]
        return [*tools, "--", "sh", "-c", _MOUNT, "sh", *arguments, *inner]

    @property
    def _workspaces(self) -> str:
        return os.path.join(self.folder, ".ros")

    def copy_workspaces(self) -> Dict[str, str]:
        """Copy the user's workspaces for the nodes; return the environment variables for ROS.

        Raises:
            OSError: a file cannot be copied.
        """
        if not self.is_root:
            return workspace.inherited()
        os.mkdir(self._workspaces)
        place = _WORKSPACES if self.has_namespaces else self._workspaces
        return workspace.copy_workspaces(self._workspaces, place, self.hidden)

    def _moves(self, plan: str, folder: str) -> Dict[str, str]:
        """Return the paths that a node needs, and where it sees them; arguments as for `wrap`."""
        moved = {self._workspaces: _WORKSPACES}
        if plan:
            moved[plan] = f"/tmp/plans/{os.path.basename(plan)}"
        if folder:
            moved[folder] = f"/tmp/submissions/{os.path.basename(folder)}"
        return moved

    @property
    def current_user(self) -> int:
        """The number of the user of nodes that this process starts."""
        return FIRST_USER + os.getpid() % USERS if self.user is None else self.user

    def end_processes(self) -> None:
        """End all processes that a node of this process has left behind."""
        if self.is_root and not self.has_namespaces and self.user is None:
            user = str(self.current_user)
            setpriv = ("setpriv", "--reuid", user, "--regid", user, "--clear-groups")
            subprocess.run([*setpriv, "kill", "-9", "-1"], stderr=subprocess.DEVNULL, check=False)


def make_sandbox(user: str, hidden: Sequence[str], folder: str) -> Tuple[Sandbox, str]:
    """Return the best sandbox that the system allows, and what is missing; "" if nothing.

    Args:
        user: the name of the user of all nodes; "" for a different one for each replay.
        hidden: folders that nodes must not see.
        folder: an empty folder that all users can reach, for all that nodes may see.

    Raises:
        UserError: there is no such user, or it is root.
    """
    number = None
    if user:
        try:
            number = pwd.getpwnam(user).pw_uid
        except KeyError:
            raise UserError(f"--user is '{user}'; expected the name of a user") from None
        if number == 0:
            raise UserError("--user is root; expected a user without privileges")
    if os.geteuid() != 0:
        return Sandbox(folder=folder), (
            "not isolated: the nodes run as the user of this program, so a node can read hidden "
            "plans and change results. To isolate them, run this program as root (sudo)"
        )
    folders = {os.path.realpath(each) for each in [*hidden, folder]} - {"/"}
    sandbox = Sandbox(True, number, True, tuple(sorted(folders)), folder)
    probe = "mount -t tmpfs tmpfs /mnt && mount -o remount,bind,ro /"
    command = [*_NAMESPACES, "--net", "--", "sh", "-c", probe]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode == 0:
        return sandbox, ""
    reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return sandbox._replace(has_namespaces=False), (
        f"partly isolated: the system refuses namespaces ({reason}). Each node runs as another "
        "user, but can use the network. Keep hidden plans unreadable for other users"
    )
