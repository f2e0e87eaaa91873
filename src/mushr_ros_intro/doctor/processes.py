"""Find the nodes of this machine that are not registered at the current master."""

import glob
import os
from contextlib import suppress
from typing import Container, List

from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER


def abandoned_nodes(uri: str, master: int, registered: Container[int]) -> List[str]:
    """Return the nodes that started before the master did and are not registered at it.

    A process is a node if roslaunch has started it with a name, or if it is rviz. Processes of
    other users and those with another ROS_MASTER_URI are left out.

    Args:
        uri: the address of the master.
        master: its process id on this machine.
        registered: the process ids of the registered nodes.

    Returns:
        Such as "/rviz (process 1234)".
    """
    found = []
    for folder in sorted(glob.glob("/proc/[0-9]*")):
        with suppress(OSError):  # the process has ended, or belongs to another user
            pid = int(os.path.basename(folder))
            name = _node_name(folder, uri)
            is_older = _start_time(folder) < _start_time(f"/proc/{master}")
            if name and is_older and pid not in registered:
                found.append(f"{name} (process {pid})")
    return found


def _node_name(folder: str, uri: str) -> str:
    """Return the name of the node that a process is; empty if it is none of the master at `uri`."""
    words = _strings(f"{folder}/cmdline")
    names = [word[len("__name:=") :] for word in words if word.startswith("__name:=")]
    if not names and os.path.basename(words[0]) == "rviz":
        names = ["rviz"]
    environment = dict(word.split("=", 1) for word in _strings(f"{folder}/environ") if "=" in word)
    its_uri = environment.get("ROS_MASTER_URI", DEFAULT_MASTER)
    if not names or its_uri.rstrip("/") != uri.rstrip("/"):
        return ""
    return f"{environment.get('ROS_NAMESPACE', '').rstrip('/')}/{names[0]}"


def _strings(path: str) -> List[str]:
    """Return the strings of a file in which each ends with a null character."""
    with open(path, "rb") as file:
        return file.read().decode(errors="replace").split("\0")


def _start_time(folder: str) -> int:
    """Return when a process started [ticks since boot], see proc(5)."""
    with open(f"{folder}/stat", encoding="utf-8", errors="replace") as file:
        return int(file.read().rpartition(")")[2].split()[19])
