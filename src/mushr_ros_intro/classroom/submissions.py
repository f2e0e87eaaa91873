"""Find the submissions of a class, copy them to a workspace, and check them.

Nothing is written outside of the workspace, and no file of a submission is run or imported.
"""

import errno
import os
import re
import shutil
import sys
import zipfile
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import yaml

from mushr_ros_intro.classroom.grades import Student, short_name
from mushr_ros_intro.classroom.submission_check import check_submission
from mushr_ros_intro.classroom.submission_files import Files, SubmissionError
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.workspace import is_junk

MAX_CLASS = 100_000, 10_000_000_000
"""Limits for a zip with the submissions of a whole class: files, bytes."""

_METADATA = "submission_metadata.yml"
_EXPECTED = "expected a package folder, a .zip, a .py, or a folder of these"
_CANVAS = re.compile(
    r"(?P<who>.+?)(?P<late>_LATE)?_(?P<id>\d+|(?<=anon_)[^\W_]+)_(?P<upload>\d+)_(?P<file>[^.].*)"
)


class Submission(NamedTuple):
    """One submission, ready to run or with the reason why it is not."""

    name: str
    """Unique; only letters, digits, and . _ -"""
    students: Tuple[Student, ...]
    """The authors; empty if they are not known. An original name counts as one if characters of it
    have been replaced."""
    fault: str
    """Why it cannot be run, and the remedy; empty if it can be run."""
    notes: Tuple[str, ...]
    """What differs from the files that were handed in, such as "made executable"."""
    folder: str
    """The folder with its files."""
    command: Tuple[str, ...] = ()
    """The path of the node; empty if there is a fault."""
    packages: Tuple[str, ...] = ()
    """The folders with a package.xml, for ROS_PACKAGE_PATH; empty if there is a fault."""
    needs_build: bool = False
    """Whether a CMakeLists.txt has commands that the node may need, such as for messages."""


class _Source(NamedTuple):
    """What was handed in as one submission."""

    name: str
    files: Dict[str, str]
    """The path of each folder or file by the name that it was handed in with."""
    students: Tuple[Student, ...] = ()
    notes: Tuple[str, ...] = ()


def collect(
    paths: Sequence[str], workspace: str, node: str = "path_publisher.py"
) -> List[Submission]:
    """Copy or unpack each submission to WORKSPACE/NAME, and check it.

    Print which files of a class are no submissions.

    Args:
        paths: packages, zips, nodes; or one folder of these, or export of Gradescope or Canvas.
        workspace: an empty folder, outside of the paths. All users can read what is copied into
            it; the permissions of the folder itself stay the same.
        node: the name of the executable file of a submission.

    Raises:
        UserError: a path does not exist, cannot be read or contains no submission, two submissions
            have the same name, or the workspace cannot be written.
    """
    workspace = os.path.realpath(workspace)
    unpacked = os.path.join(workspace, ".unpacked")
    found: List[Submission] = []
    taken: Dict[str, str] = {}
    try:
        for path, entries in _places(paths).items():
            files = Files(unpacked, MAX_CLASS)
            sources = _among(path, entries, path) if entries else _sources(path, node, files)
            for source in sources:
                name, shown = short_name(source.name), f"{source.name!r} of {path}"
                other = taken.setdefault(name.lower(), shown)  # some file systems ignore case
                if other is not shown:
                    text = f"two submissions have the name {name} in the results: {other}, {shown}"
                    raise UserError(f"{text}; rename or remove one of these folders or files")
                files = Files(os.path.join(workspace, name))
                found.append(_submission(source, name, files, node))
    except OSError as error:
        raise UserError(f"{error.filename or workspace}: {error.strerror}") from None
    finally:
        shutil.rmtree(unpacked, ignore_errors=True)
    if not found:
        raise UserError(f"no submission in {', '.join(paths)}; {_EXPECTED}")
    return found


def _places(paths: Sequence[str]) -> Dict[str, List[str]]:
    """Return a single path without entries, or the folders of several paths with these as entries.

    So several paths, such as those of a pattern, count as a folder that has no other entries.

    Raises:
        OSError: a path does not exist.
    """
    if not paths[1:]:
        return {paths[0]: []}
    places: Dict[str, List[str]] = {}
    for path in paths:
        os.lstat(path)
        folder, entry = os.path.split(os.path.abspath(path))
        if not is_junk(entry):
            places.setdefault(folder, []).append(entry)
    return places


def _sources(path: str, node: str, unpacked: Files) -> List[_Source]:
    """Return the submissions in what the user typed.

    Args:
        path: what the user typed.
        node: the name of the executable file of a submission.
        unpacked: for the files of a zip with several submissions.

    Raises:
        UserError, OSError: the path contains something else, or cannot be read.
    """
    typed, name = path, os.path.basename(os.path.abspath(path))
    base, ending = os.path.splitext(name)
    if not os.path.isdir(path):
        os.stat(path)
        if not os.path.isfile(path) or ending.lower() not in (".zip", ".py"):
            raise UserError(f"{path} is not a submission; {_EXPECTED}")
        folder = _class_folder(path) if ending.lower() == ".zip" else None
        if folder is None:
            return [_Source(base, {name: path})]
        try:
            unpacked.add_zip(path, "")
        except SubmissionError as fault:
            raise UserError(f"{typed}: {fault}") from None
        path = os.path.join(unpacked.folder, folder)
    entries = sorted(each for each in os.listdir(path) if not is_junk(each))
    is_one = any(each in entries for each in ("package.xml", node, "src", "scripts"))
    if is_one and _METADATA not in entries:
        return [_Source(name, {name: path})]
    return _among(path, entries, typed)


def _among(folder: str, entries: Sequence[str], typed: str) -> List[_Source]:
    """Return the submissions among entries of a folder; `typed` is its name for messages."""
    if _METADATA in entries:
        return _gradescope(folder, entries, typed)
    return _class(folder, entries)


def _class_folder(path: str) -> Optional[str]:
    """Return the folder with the submissions in a zip; None if the zip is one submission."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except Exception:  # zipfile raises errors of many classes for damaged files
        return None
    names = [each for each in names if not any(map(is_junk, each.split("/")))]
    for name in names:
        if os.path.basename(name) == _METADATA and name.count("/") <= 1:
            return os.path.dirname(name)
    is_flat = not any("/" in each for each in names)  # a text that was handed in has no upload
    return "" if is_flat and any(map(_CANVAS.fullmatch, names)) else None


def _class(folder: str, entries: Sequence[str]) -> List[_Source]:
    """Return the submissions among entries of a folder; all files of a student in Canvas are one.

    Of the versions of a file in Canvas, the last upload counts.
    """
    found: Dict[str, _Source] = {}
    left_out = []
    for entry in sorted(entries, key=_upload):
        path, (base, ending) = os.path.join(folder, entry), os.path.splitext(entry)
        is_file = os.path.isfile(path)  # a FIFO, for example, is none
        canvas = _CANVAS.fullmatch(entry)
        if canvas and (is_file or os.path.isdir(path)):
            name = f"{canvas['who']}_{canvas['id']}"
            original = re.sub(r"-\d+(\.\w+)$", r"\1", canvas["file"])  # Canvas counts attempts
            files = {**found[name].files, original: path} if name in found else {original: path}
            students = (Student(canvas["who"], "", "", canvas["id"]),)
            late = ("handed in late, as Canvas says",) if canvas["late"] else ()
            found[name] = _Source(name, files, students, late)
        elif os.path.isdir(path):
            found[entry] = _Source(entry, {entry: path})
        elif is_file and ending.lower() in (".zip", ".py"):
            found[entry] = _Source(base, {entry: path})
        else:
            left_out.append(repr(entry))
    if left_out:
        text = f"{folder}: left out, not taken for submissions: {', '.join(left_out)}"
        print(f"{text}; {_EXPECTED}", file=sys.stderr)
    return [found[name] for name in sorted(found)]


def _upload(entry: str) -> int:
    """Return the number by which Canvas counts uploads; 0 if there is none."""
    canvas = _CANVAS.fullmatch(entry)
    return int(canvas["upload"]) if canvas else 0


class _Loader(yaml.SafeLoader):
    """Reads the tags of Ruby, such as !ruby/object:ActiveSupport::TimeWithZone, as null."""


_Loader.add_multi_constructor("!", lambda loader, suffix, node: None)


def _gradescope(folder: str, entries: Sequence[str], typed: str) -> List[_Source]:
    """Return the submissions in an export of Gradescope.

    Args:
        folder: the folder with the metadata.
        entries: what it contains.
        typed: the name of the export for messages.

    Raises:
        UserError: its metadata cannot be read.
    """
    try:
        with open(os.path.join(folder, _METADATA), "rb") as file:
            values: Any = yaml.load(file.read(), _Loader)
        students = {
            str(name): tuple(
                Student(*(str(each.get(key) or "") for key in (":name", ":sid", ":email")))
                for each in (value or {}).get(":submitters") or ()
            )
            for name, value in (values or {}).items()
        }
    except Exception as problem:  # PyYAML raises errors of many classes
        reason = " ".join(str(problem).split())
        text = f"{typed}: {_METADATA}: {reason}; expected the metadata of Gradescope"
        raise UserError(text) from None
    paths = {each: os.path.join(folder, each) for each in entries}
    return [
        _Source(name, {name: path}, students.get(name, ()))
        for name, path in paths.items()
        if os.path.isdir(path)
    ]


def _submission(source: _Source, name: str, files: Files, node: str) -> Submission:
    """Copy and check one submission.

    Raises:
        OSError: the workspace cannot be written.
    """
    os.makedirs(files.folder)
    files.notes.extend(source.notes)
    if not source.students and name != source.name:
        source = source._replace(students=(Student(source.name, "", ""),))
    try:
        _copy(source, files, node)
        checked = check_submission(files, node)
        return Submission(name, source.students, "", tuple(files.notes), files.folder, *checked)
    except SubmissionError as problem:
        fault = str(problem)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            raise
        fault = f"{error.filename!r} cannot be copied ({error.strerror})."
    shutil.rmtree(files.folder, ignore_errors=True)
    return Submission(name, source.students, fault, tuple(files.notes), files.folder)


def _copy(source: _Source, files: Files, node: str) -> None:
    """Copy or unpack the files of a submission.

    Raises:
        SubmissionError, OSError: a file is damaged, not safe, or too large, or cannot be copied.
    """
    for name, path in source.files.items():
        base, ending = os.path.splitext(name)
        place = base if ending.lower() == ".zip" else name
        if len(source.files) == 1:  # the file names of the class folder are of no importance
            if os.path.isdir(path) or ending.lower() == ".zip":
                place = ""
            elif ending.lower() == ".py":
                place = node
                if name != node:
                    files.notes.append(f"{name!r} is run as {node}")
        files.add(path, place)
    found = files.places()
    if node not in map(os.path.basename, found):
        for place in found:
            if place.lower().endswith(".zip"):
                files.add_zip(os.path.join(files.folder, place), os.path.splitext(place)[0])
