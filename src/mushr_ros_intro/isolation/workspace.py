"""Copy the user's workspaces for nodes that run as another user.

This user may not reach a workspace, for example in a home directory of mode 0700. The packages of
the system stay where they are.
"""

import os
import re
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import partial
from typing import Callable, Dict, Iterator, List, Sequence

import rospkg

_JUNK = {"__MACOSX", "__pycache__", "build", "devel", "desktop.ini", "Thumbs.db"}
"""Not copied, like hidden files."""

SYSTEM = ("/usr/", "/opt/ros/")
"""Where the distribution and ROS install packages, which all users may read."""

_INHERITED = (
    "CMAKE_PREFIX_PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "ROS_DISTRO",
    "ROS_ETC_DIR",
    "ROS_PACKAGE_PATH",
    "ROS_PYTHON_VERSION",
    "ROS_ROOT",
    "ROS_VERSION",
)
"""The environment variables for ROS that a node gets."""


def is_junk(name: str) -> bool:
    """Return whether a file or folder with this name is left out of copies of packages."""
    return name in _JUNK or name.startswith(".")


def inherited() -> Dict[str, str]:
    """Return the environment variables for ROS of this process."""
    return {name: os.environ[name] for name in _INHERITED if name in os.environ}


def search_path() -> str:
    """Return the PATH of a node: the folders of the system, and of the Python that runs this.

    Others, such as those of pyenv in the home directory, are hidden from a node.
    """
    folders = os.environ["PATH"].split(os.pathsep)
    own = (*SYSTEM, "/bin/", "/sbin/", os.path.join(sys.prefix, ""))
    return os.pathsep.join(each for each in folders if f"{each}/".startswith(own))


def environment_of(ros: Dict[str, str], packages: Sequence[str] = ()) -> Dict[str, str]:
    """Return the environment of a node, which contains nothing of the user's own.

    Args:
        ros: the environment variables for ROS.
        packages: the folders of the node's own packages; none if they are in `ros`.
    """
    return {
        **ros,
        "PATH": search_path(),
        "PYTHONPATH": os.pathsep.join([*_module_paths(packages), *_paths(ros, "PYTHONPATH")]),
        "ROS_PACKAGE_PATH": os.pathsep.join([*packages, *_paths(ros, "ROS_PACKAGE_PATH")]),
        "ROS_HOSTNAME": "localhost",
        "ROS_MASTER_URI": os.environ.get("ROS_MASTER_URI", ""),  # of the replay in this process
        "LANG": "C.UTF-8",
        "PYTHONUNBUFFERED": "1",
        "OPENBLAS_NUM_THREADS": "1",  # the unused threads would cost 0.1 s at the start
    }


def _module_paths(packages: Sequence[str]) -> Iterator[str]:
    """Yield the folders of the Python modules of packages, whether they are built or not."""
    for folder in packages:
        built = os.path.join(folder, ".build/devel/lib/python3/dist-packages")
        modules = os.path.join(folder, "src")
        if os.path.isdir(built):
            yield built
        if os.path.isfile(os.path.join(folder, "setup.py")) and os.path.isdir(modules):
            yield modules


def temporary_folder() -> str:
    """Return a folder for temporary files that all users can reach, if there is one."""
    usual = tempfile.gettempdir()
    return next(filter(_is_reachable, (usual, "/tmp", "/var/tmp")), usual)


def _is_reachable(folder: str) -> bool:
    """Return whether all users may enter a folder and all folders above it."""
    path = os.path.realpath(folder)
    while os.path.isdir(path) and os.stat(path).st_mode & stat.S_IXOTH:
        if path == "/":
            return True
        path = os.path.dirname(path)
    return False


def copy_workspaces(folder: str, place: str, hidden: Sequence[str]) -> Dict[str, str]:
    """Copy the user's workspaces; return the environment variables for ROS that use the copies.

    Nothing of this package is copied, because its nodes and examples are solutions. Files in a
    workspace that are not readable for all users are not copied.

    Args:
        folder: an existing folder for the copies.
        place: where a node will see this folder.
        hidden: folders that are not copied, as real paths.

    Raises:
        OSError: a file cannot be copied.
    """
    copies: Dict[str, str] = {}

    def copy(source: str, left_out: Callable[[str], bool] = is_junk) -> None:
        number = str(len(copies))

        def ignore(path: str, names: List[str]) -> List[str]:
            paths = {each: os.path.join(path, each) for each in names}
            return [
                each
                for each in names
                if left_out(each) or paths[each] in hidden or not _is_readable(paths[each])
            ]

        # Follow links, because catkin's workspaces consist of links to other places.
        shutil.copytree(source, os.path.join(folder, number), False, ignore, _copy_file)
        copies[source] = os.path.join(place, number)

    ros = inherited()
    for prefix in _own_paths(ros, "CMAKE_PREFIX_PATH"):
        copy(prefix, left_out={"__pycache__", "mushr_ros_intro"}.__contains__)
    packages = []
    found = rospkg.RosPack(_own_paths(ros, "ROS_PACKAGE_PATH"))
    for name in found.list():
        listed = found.get_path(name)
        source = os.path.dirname(os.path.realpath(os.path.join(listed, "package.xml")))
        if name != "mushr_ros_intro" and source not in hidden:
            packages.append(source)
            copy(source)
            copies[listed] = copies[source]
    translate = partial(_translated, copies)
    _make_usable(folder, translate)
    system = [each for each in _paths(ros, "ROS_PACKAGE_PATH") if each.startswith(SYSTEM)]
    ros["ROS_PACKAGE_PATH"] = os.pathsep.join([*packages, *system])
    modules = [*_module_paths(packages), *_paths(ros, "PYTHONPATH")]
    ros["PYTHONPATH"] = os.pathsep.join(modules)
    return {name: translate(value) for name, value in ros.items()}


def _make_usable(folder: str, translate: Callable[[str], str]) -> None:
    """Let all users enter the folders in `folder`, and translate the paths in CMake's files."""
    for path, _, files in os.walk(folder):
        os.chmod(path, 0o755)
        for name in files:
            if name.endswith(".cmake"):
                _replace(os.path.join(path, name), translate)


def _translated(copies: Dict[str, str], text: str) -> str:
    """Return a text in which the paths of the copied folders are those of their copies."""
    sources = "|".join(map(re.escape, sorted(copies, key=len, reverse=True)))
    pattern = rf"({sources})(?![\w.-])"
    return re.sub(pattern, lambda match: copies[match[1]], text) if copies else text


def _paths(ros: Dict[str, str], name: str) -> List[str]:
    return list(filter(None, ros.get(name, "").split(os.pathsep)))


def _own_paths(ros: Dict[str, str], name: str) -> List[str]:
    """Return the existing folders of a variable that are not the system's."""
    own = (path for path in _paths(ros, name) if not f"{path}/".startswith(SYSTEM))
    return list(dict.fromkeys(filter(os.path.isdir, own)))


def _is_readable(path: str) -> bool:
    """Return whether the permissions of a file or a folder let all users read it."""
    with suppress(OSError):
        mode = os.stat(path).st_mode
        return bool(mode & stat.S_IROTH) and (bool(mode & stat.S_IXOTH) or not stat.S_ISDIR(mode))
    return False  # a link to nowhere


def _copy_file(source: str, target: str) -> str:
    """Copy a file. Of its permissions, keep whether it is executable, but not set-user-ID."""
    shutil.copyfile(source, target)
    os.chmod(target, 0o755 if os.stat(source).st_mode & stat.S_IXUSR else 0o644)
    return target


def _replace(path: str, translate: Callable[[str], str]) -> None:
    with open(path, encoding="utf-8", errors="surrogateescape") as file:
        text = file.read()
    with open(path, "w", encoding="utf-8", errors="surrogateescape") as file:
        file.write(translate(text))
