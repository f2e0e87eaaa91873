"""Keep the drives of a class in a folder, one file for each submission.

Pages and tables are always made from these files: each drive is judged and drawn again.
"""

import fcntl
import hashlib
import json
import os
from contextlib import suppress
from typing import Any, Dict, List, Optional

import numpy as np
import yaml

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.classroom.grades import Grade, StoredDrive, Student
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.replay.recording import Recorded, Sent
from mushr_ros_intro.replay.reference import Reference
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.yaml_file import read_mapping

FOLDER = "data"
"""The folder of the drives, in the output folder of grade.py."""

_LOCK = ".lock"

_SETTINGS = os.path.join(FOLDER, "settings.yaml")
_POINTS = os.path.join(FOLDER, "points.yaml")
"""What later runs use unless their command line says something else."""


_TYPES: Dict[str, Any] = {
    each.__name__: each
    for each in (Car, Grade, Plan, Pose, Recorded, Reference, Row, Sent, StoredDrive, Student)
}


def to_json(value: Any) -> Any:
    """Return a value as JSON: a named tuple becomes an object with its name and its fields."""
    if isinstance(value, np.ndarray):
        return {"array": value.tolist()}
    if isinstance(value, Grid):
        return {"map": to_json((value.cells.shape, value.resolution, value.origin))}
    if isinstance(value, (tuple, list)):
        values = [*map(to_json, value)]
        return {type(value).__name__: values} if hasattr(value, "_fields") else values
    return value


def from_json(value: Any) -> Any:
    """Return the value that `to_json` has converted; the cells of a map are free.

    Raises:
        KeyError, TypeError, ValueError: the value is something else.
    """
    if isinstance(value, list):
        return tuple(map(from_json, value))
    if not isinstance(value, dict):
        return value
    ((name, content),) = value.items()
    if name == "array":
        return np.array(content)
    if name == "map":
        shape, resolution, origin = from_json(content)
        return Grid(np.broadcast_to(np.int8(0), shape), resolution, origin)
    return _TYPES[name](*from_json(content))


class Store:
    """The drives in the output folder of grade.py, for one process at a time."""

    def __init__(self, folder: str) -> None:
        """Open a folder; create it if it does not exist.

        Args:
            folder: the output folder.

        Raises:
            UserError: it contains something else, or another process uses it.
            OSError: it cannot be created or written.
        """
        self._top, self._folder = folder, os.path.join(folder, FOLDER)
        lock = os.path.join(self._folder, _LOCK)
        make_folder(folder, 0o700)
        if os.listdir(folder) and not os.path.exists(lock):
            raise UserError(f"--out {folder}: expected a new or empty folder, or an earlier result")
        make_folder(self._folder)
        self._lock = open(lock, "a", encoding="ascii")  # noqa: SIM115 - as long as this object
        give_to_user(lock)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"--out {folder}: another grade.py writes to this folder; wait until it ends, or "
                "choose another folder"
            ) from None

    def load(self, name: str) -> Optional[Grade]:
        """Return what is stored of a submission; None if there is nothing that can be read."""
        with suppress(OSError, ValueError, KeyError, TypeError):
            return _read(os.path.join(self._folder, f"{name}.json"))
        return None

    def save(self, grade: Grade) -> None:
        """Write what is stored of a submission; the file is complete at any time.

        Raises:
            OSError: it cannot be written.
        """
        text = json.dumps(to_json(grade))
        write_text(os.path.join(self._folder, f"{grade.name}.json"), text)

    def save_settings(self, values: Dict[str, Any]) -> None:
        """Write settings for later runs, with a copy of the file "points", if there is one.

        Raises:
            OSError: they cannot be written.
        """
        others = {name: value for name, value in values.items() if name != "points"}
        write_text(os.path.join(self._top, _SETTINGS), yaml.safe_dump(others))
        copy = os.path.join(self._top, _POINTS)
        if points := values.get("points"):
            with open(points, "rb") as file:
                content = file.read()
            _write(copy, content)
        elif os.path.exists(copy):
            os.unlink(copy)


def load_settings(folder: str) -> Dict[str, Any]:
    """Return the settings of the earlier run that wrote an output folder; "points" is a path.

    Raises:
        UserError: they cannot be read.
    """
    path, points = (os.path.join(folder, each) for each in (_SETTINGS, _POINTS))
    values = read_mapping(path, "the settings of an earlier run") if os.path.exists(path) else {}
    return {**values, "points": points} if os.path.exists(points) else values


def load_all(folder: str) -> List[Grade]:
    """Return what is stored in an output folder of grade.py, by name.

    Raises:
        UserError: a file cannot be read, or is something else.
    """
    try:
        names = sorted(each for each in os.listdir(f"{folder}/{FOLDER}") if each.endswith(".json"))
        return [_read(os.path.join(folder, FOLDER, each)) for each in names]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder}: not the output of grade.py ({error})") from None


def _read(path: str) -> Grade:
    """Return what is stored of a submission.

    Raises:
        OSError, ValueError, KeyError, TypeError: the file cannot be read, or contains something
            else, as that of another version of this package.
    """
    with open(path, encoding="ascii") as file:
        grade = from_json(json.load(file))
    if not isinstance(grade, Grade):
        raise TypeError(f"{path} contains something else")
    return grade


def hash_of(*parts: object) -> str:
    """Return a hash of bytes, texts and other values by their representation."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(b"%d:" % len(data) + data)
    return digest.hexdigest()


def hash_of_folder(folder: str) -> str:
    """Return a hash of the paths, contents and executable bits of all files in a folder.

    Byte code does not count.
    """
    parts: List[object] = []
    for path, folders, names in os.walk(folder):
        folders[:] = sorted(set(folders) - {"__pycache__"})
        for name in sorted(names):
            place = os.path.join(path, name)
            if os.path.isfile(place):
                with open(place, "rb") as file:
                    is_program = os.access(place, os.X_OK)
                    parts += [os.path.relpath(place, folder), is_program, file.read()]
    return hash_of(*parts)


def give_to_user(path: str) -> None:
    """Give a file or a folder to the user who called sudo, if this process runs under sudo."""
    user, group = os.environ.get("SUDO_UID", ""), os.environ.get("SUDO_GID", "")
    if os.geteuid() == 0 and user.isdecimal() and group.isdecimal():
        os.chown(path, int(user), int(group), follow_symlinks=False)


def make_folder(path: str, mode: int = 0o755) -> None:
    """Create a folder and those above it, if they do not exist, as the user who called sudo."""
    path = os.path.abspath(path)
    if not os.path.isdir(path):
        make_folder(os.path.dirname(path))
        os.mkdir(path, mode)
        give_to_user(path)


def write_text(path: str, text: str) -> None:
    """Write a file of the user who called sudo; another process sees the old or the new one."""
    _write(path, text.encode())


def _write(path: str, content: bytes) -> None:
    part = f"{path}.part"
    with open(part, "wb") as file:
        file.write(content)
    give_to_user(part)
    os.replace(part, path)
