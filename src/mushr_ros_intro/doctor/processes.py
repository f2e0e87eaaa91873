"""Read about nodes of this machine from their processes."""

import glob
import os
from contextlib import suppress
from typing import Any, Dict, List, Mapping, Tuple

from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER


def masters() -> List[str]:
    """Return the addresses of the masters that run on this machine."""
    found = []
    for path in sorted(glob.glob("/proc/[0-9]*/cmdline")):
        with suppress(OSError):
            words = _strings(path)
            if any(os.path.basename(each) == "rosmaster" for each in words[:2]) and "-p" in words:
                found.append(f"http://localhost:{words[words.index('-p') + 1]}")
    return found


def left_parameters(
    pid: int, uri: str, parameters: Mapping[str, Any]
) -> Tuple[Dict[str, Any], Dict[str, str]]:
    """Return the parameters of a node that are not in its command line.

    Also return the arguments without an underscore that have the name of one of them.

    There are none if it was not started by hand: if roslaunch has started it with a name, if it
    is no process of this user, or if it has another ROS_MASTER_URI.

    Args:
        pid: the process id of the node, if it runs on this machine.
        uri: the address of the master.
        parameters: its private parameters at the master.
    """
    folder = f"/proc/{pid}"
    with suppress(OSError):
        words = _strings(f"{folder}/cmdline")
        if _has_master(folder, uri) and not any(word.startswith("__name:=") for word in words):
            given = dict(word.split(":=", 1) for word in words if ":=" in word)
            typed = {name[1:].split("/")[0] for name in given}
            left = {name: value for name, value in parameters.items() if name not in typed}
            return left, {name: value for name, value in given.items() if name in left}
    return {}, {}


def _has_master(folder: str, uri: str) -> bool:
    """Return whether a process uses the master at `uri`."""
    its_uri = _environment(folder).get("ROS_MASTER_URI", DEFAULT_MASTER)
    return its_uri.rstrip("/") == uri.rstrip("/")


def _environment(folder: str) -> Dict[str, str]:
    """Return the environment variables of a process."""
    return dict(word.split("=", 1) for word in _strings(f"{folder}/environ") if "=" in word)


def _strings(path: str) -> List[str]:
    """Return the strings of a file in which each ends with a null character."""
    with open(path, "rb") as file:
        return file.read().decode(errors="replace").split("\0")
