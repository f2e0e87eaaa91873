"""Keep the results of grading in a folder, one file for each submission.

Pages and tables are always made from these files. A stored drive has the hashes of all that it
depends on, so a later run knows whether it is still valid.
"""

import fcntl
import hashlib
import json
import os
import shutil
import sys
import tempfile
from contextlib import suppress
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Set

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.classroom.grades import Grade, PlanGrade, Student, plan_from_json, plan_to_json
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.recording import Recorded, Sent
from mushr_ros_intro.world.grid import Grid

FOLDER = "data"
"""The folder of the results, in the output folder of grade.py."""

_LEFT = "left"
"""The folder in it for the results of submissions that are not in the class any more."""

_LOCK = ".lock"

_HASH = ', "hash": "'
"""Precedes the last value in a file: the hash of the JSON object without this value."""


class Key(NamedTuple):
    """Hashes of what a verdict on a drive depends on."""

    submission: str
    """The files of the submission."""
    plan: str
    options: str
    """The car, the map, the isolation, and other options of the replay."""
    package: str
    """The modules of this package that drive and judge."""
    tolerances: str


class StoredDrive(NamedTuple):
    """One plan, driven by a submission."""

    key: Key
    fault: str
    """Why the submission cannot be built; empty if it was driven."""
    grade: Optional[PlanGrade]
    """The verdict; None if there is a fault."""
    recorded: Dict[str, Any]
    """The recording as a JSON object, to judge it again; empty if there is a fault."""


class Record(NamedTuple):
    """The stored result of a submission."""

    grade: Grade
    drives: Dict[str, StoredDrive]
    """By the name of the plan."""
    time: float
    """When it was written [s since 1970]."""


class Store:
    """The results in the output folder of grade.py, for one process at a time."""

    def __init__(self, folder: str) -> None:
        """Open a folder; create it if it does not exist.

        Args:
            folder: the output folder.

        Raises:
            UserError: it contains something else, or another process uses it.
            OSError: it cannot be created or written.
        """
        self._folder = os.path.join(folder, FOLDER)
        lock = os.path.join(self._folder, _LOCK)
        make_folder(folder, 0o700)
        if os.listdir(folder) and not os.path.exists(lock):
            raise UserError(f"--out {folder}: expected a new or empty folder, or an earlier result")
        make_folder(self._folder)
        make_folder(os.path.join(self._folder, _LEFT))
        self._lock = open(lock, "a", encoding="ascii")  # noqa: SIM115 - as long as this object
        give_to_user(lock)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"--out {folder}: another grade.py writes to this folder; wait until it ends, or "
                "choose another folder"
            ) from None

    def load(self, name: str) -> Optional[Record]:
        """Return the result of a submission; None if there is none that can be read."""
        path = os.path.join(self._folder, f"{name}.json")
        with suppress(OSError):
            if not os.path.exists(path):
                os.replace(os.path.join(self._folder, _LEFT, f"{name}.json"), path)
        with suppress(OSError, ValueError, KeyError, TypeError):
            return _read(path)
        return None

    def save(self, record: Record) -> None:
        """Write the result of a submission; it is complete at any time.

        Raises:
            OSError: it cannot be written.
        """
        drives = {name: _drive_to_json(drive) for name, drive in record.drives.items()}
        students = [student._asdict() for student in record.grade.students]
        grade = {**record.grade._asdict(), "students": students, "plans": []}
        values = {**grade, "time": record.time, "drives": drives}
        text = json.dumps(values)
        text = f'{text[:-1]}{_HASH}{hash_of(text.encode())}"}}'
        write_text(os.path.join(self._folder, f"{record.grade.name}.json"), text)

    def set_aside(self, names: Iterable[str]) -> None:
        """Move the results of all other submissions than `names` to the folder left/."""
        keep = {f"{name}.json" for name in names}
        for each in os.listdir(self._folder):
            if each.endswith(".json") and each not in keep:
                target = os.path.join(self._folder, _LEFT, each)
                os.replace(os.path.join(self._folder, each), target)


def load_all(folder: str) -> List[Record]:
    """Return the results in an output folder of grade.py, in the order of their names.

    Raises:
        UserError: a file cannot be read, or is something else.
    """
    try:
        names = sorted(each for each in os.listdir(f"{folder}/{FOLDER}") if each.endswith(".json"))
        return [_read(os.path.join(folder, FOLDER, each)) for each in names]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder}: not the output of grade.py ({error})") from None


def load_newest(folders: Sequence[str]) -> Dict[str, Record]:
    """Return the results in several output folders by name; of several results, the newest.

    Print which submissions have several results.

    Raises:
        UserError: a file cannot be read, or there is no result.
    """
    records: Dict[str, Record] = {}
    for each in (record for folder in folders for record in load_all(folder)):
        name = each.grade.name
        if name in records:
            print(f"{name}: several results; the newest is used", file=sys.stderr)
        records[name] = max(records.get(name, each), each, key=lambda record: record.time)
    if not records:
        raise UserError(f"{', '.join(folders)}: expected at least one result")
    return records


def _read(path: str) -> Record:
    """Return a stored result.

    Raises:
        OSError, ValueError: the file cannot be read, or has been changed.
        KeyError, TypeError: another version of this package has written it.
    """
    with open(path, encoding="ascii") as file:
        text, _, digest = file.read().rpartition(_HASH)
    text += "}"
    if digest != f'{hash_of(text.encode())}"}}':
        raise ValueError(f"{path} has been changed, or is not complete")
    values = json.loads(text)
    time = values.pop("time")
    drives = {name: _drive_from_json(value) for name, value in values.pop("drives").items()}
    is_judged = not values["fault"] and not values["error"]
    changes = {
        "students": tuple(Student(**student) for student in values["students"]),
        "plans": tuple(each.grade for each in drives.values() if each.grade and is_judged),
        "notes": tuple(values["notes"]),
    }
    return Record(Grade(**{**values, **changes}), drives, time)


def _drive_to_json(drive: StoredDrive) -> Dict[str, Any]:
    grade = drive.grade and plan_to_json(drive.grade)
    return {**drive._asdict(), "key": drive.key._asdict(), "grade": grade}


def _drive_from_json(value: Dict[str, Any]) -> StoredDrive:
    grade = value["grade"] and plan_from_json(value["grade"])
    return StoredDrive(**{**value, "key": Key(**value["key"]), "grade": grade})


def recorded_to_json(recorded: Recorded) -> Dict[str, Any]:
    """Return a recording as a JSON object, without the plan, the car and the map."""
    values = recorded._asdict()
    for name in ("plan", "car", "grid"):
        del values[name]
    return {**values, "stamps": recorded.stamps.tolist(), "poses": recorded.poses.tolist()}


def recorded_from_json(
    values: Dict[str, Any], plan: Any, car: Car, grid: Optional[Grid]
) -> Recorded:
    """Return the recording that `recorded_to_json` has converted."""
    changes = {
        "start": values["start"] and Pose(*values["start"]),
        "sent": tuple(Sent(*each) for each in values["sent"]),
        "stamps": np.array(values["stamps"], np.int64),
        "poses": np.array(values["poses"], float).reshape(-1, 3),
        "collisions": tuple(Pose(*each) for each in values["collisions"]),
        "actions": tuple(values["actions"]),
        "published": tuple((topic, kind) for topic, kind in values["published"]),
    }
    return Recorded(plan=plan, car=car, grid=grid, **{**values, **changes})


def hash_of(*parts: object) -> str:
    """Return a hash of bytes, texts and other values by their representation."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(b"%d:" % len(data) + data)
    return digest.hexdigest()


def hash_of_folder(folder: str, left_out: Set[str] = frozenset()) -> str:  # type: ignore
    """Return a hash of the paths, contents and executable bits of all files in a folder.

    Byte code and the subfolders `left_out` do not count.
    """
    parts: List[object] = []
    for path, folders, names in os.walk(folder):
        folders[:] = sorted(set(folders) - left_out - {"__pycache__"})
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


def describe_error(error: OSError, out: str) -> str:
    """Return the text of an error, with the place where it happened; `out` is the output folder."""
    if isinstance(error, shutil.Error):  # a list: the source, the copy, and the error of each file
        return str(error.args[0][0][2])
    folders = filter(None, (out, tempfile.gettempdir()))
    return (
        f"{error}" if error.filename else f"{error}; files are written to {' and '.join(folders)}"
    )


def make_folder(path: str, mode: int = 0o755) -> None:
    """Create a folder and those above it, if they do not exist, as the user who called sudo."""
    path = os.path.abspath(path)
    if not os.path.isdir(path):
        make_folder(os.path.dirname(path))
        os.mkdir(path, mode)
        give_to_user(path)


def write_text(path: str, text: str) -> None:
    """Write a file of the user who called sudo; another process sees the old or the new one."""
    part = f"{path}.part"
    with open(part, "w", encoding="utf-8", newline="") as file:
        file.write(text)
    give_to_user(part)
    os.replace(part, path)
