"""Find the submissions of a class, copy them to a workspace, and check them.

Nothing is written outside of the workspace, and no file of a submission is run or imported.
"""

import errno
import os
import re
import shutil
import sys
import zipfile
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import yaml

from mushr_ros_intro.classroom.grades import Student, short_name
from mushr_ros_intro.classroom.submission_check import check_submission
from mushr_ros_intro.classroom.submission_files import Files, SubmissionError
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.workspace import is_junk
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.replay.reference import Exercise

MAX_CLASS = 100_000, 10_000_000_000
"""Limits for a zip with the submissions of a whole class: files, bytes."""

_METADATA = "submission_metadata.yml"
_EXPECTED = "expected a package folder, a .zip, a .py, or a folder of these"
_ARCHIVES = (".7z", ".bz2", ".gz", ".rar", ".tar", ".tgz", ".xz")
_DOCUMENT = re.compile(r"(?P<who>.+?)\.(cpp|docx?|ipynb|odt|pdf|py\.txt|rtf)", re.IGNORECASE)
_CANVAS = re.compile(r"(?P<who>.+?)(?P<late>_LATE)?_(?P<id>\d+)_(?P<upload>\d+)_(?P<file>[^.].*)")


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
    command: Tuple[str, ...]
    """The path of the node; empty if there is a fault."""
    packages: Tuple[str, ...]
    """The folders with a package.xml, for ROS_PACKAGE_PATH; empty if there is a fault."""
    needs_build: bool
    """Whether a CMakeLists.txt has commands that the node may need, such as for messages."""


class _Source(NamedTuple):
    """What was handed in as one submission."""

    name: str
    files: Tuple[Tuple[str, str], ...]
    """The path of each folder or file, and the name that it was handed in with."""
    students: Tuple[Student, ...] = ()
    fault: str = ""
    notes: Tuple[str, ...] = ()


def collect(
    paths: Sequence[str], workspace: str, node: str = "path_publisher.py"
) -> List[Submission]:
    """Copy or unpack each submission to WORKSPACE/NAME, and check it.

    Print which files of a class are no submissions.

    Args:
        paths: packages, zips, nodes, folders of these, exports of Gradescope and of Canvas.
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
    for path in paths:
        if os.path.commonpath([workspace, os.path.realpath(path)]) == os.path.realpath(path):
            raise UserError(f"the workspace {workspace} is in {path}; expected it outside")
        try:
            sources = _sources(path, node, Files(unpacked, MAX_CLASS))
            if not sources:
                raise UserError(f"{path} contains no submission; {_EXPECTED}")
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
    return found


def check_authors(plans: Iterable[Exercise], submissions: Iterable[str]) -> None:
    """Refuse a plan in a submission, whose author may have written it.

    The name figure_8 means figure_8.txt in the current directory, if there is one, and that
    directory may be the checkout of a submission.

    Args:
        plans: the plans.
        submissions: the paths of submissions, or of folders with submissions.

    Raises:
        UserError: a plan is in one of these folders, but not in the folder of this package's plans.
    """
    known = package_folder("plans")
    folders = [os.path.join(os.path.realpath(each), "") for each in submissions]
    for path in (os.path.realpath(plan.path) for plan in plans):
        if os.path.dirname(path) != known and path.startswith(tuple(folders)):
            raise UserError(
                f"{path}: this plan is in a submission, whose author may have written it; expected "
                f"the path of another plan, such as {known}/figure_8.txt"
            )


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
            return [_Source(base, ((path, name),))]
        try:
            unpacked.add_zip(path, "", strict=False)
        except SubmissionError as fault:
            raise UserError(f"{typed}: {fault}") from None
        path = os.path.join(unpacked.folder, folder)
    entries = sorted(each for each in os.listdir(path) if not is_junk(each))
    if _METADATA in entries:
        return _gradescope(path, entries, typed)
    if any(each in entries for each in ("package.xml", node, "src", "scripts")):
        return [_Source(name, ((path, name),))]
    return _class(path, entries)


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
    return "" if names and all("/" not in each and _CANVAS.match(each) for each in names) else None


def _class(folder: str, entries: Sequence[str]) -> List[_Source]:
    """Return the submissions in a folder; all files of a student in Canvas are one.

    A document counts as one if students hand in files, and it is not of one of the others: beside
    a package, it may be a report, and beside the folders of students, a text of the course.
    """
    found: Dict[str, _Source] = {}
    others = []
    for entry in entries:
        path, (base, ending) = os.path.join(folder, entry), os.path.splitext(entry)
        canvas = _CANVAS.fullmatch(entry)
        if os.path.islink(path):
            fault = f"{entry!r} is a symbolic link; expected the folder or the file itself."
            found[entry] = _Source(entry, (), fault=fault)
        elif not os.path.isdir(path) and not os.path.isfile(path):
            others.append(entry)  # such as a FIFO
        elif canvas:
            name = f"{canvas['who']}_{canvas['id']}"
            students = (Student(canvas["who"], "", "", canvas["id"]),)
            source = found.get(name, _Source(name, ()))._replace(students=students)
            original = re.sub(r"-\d+(\.\w+)$", r"\1", canvas["file"])  # Canvas counts attempts
            found[name] = _with_upload(source, path, original)
        elif os.path.isdir(path):
            found[entry] = _Source(entry, ((path, entry),))
        elif ending.lower() in (".zip", ".py"):
            found[entry] = _Source(base, ((path, entry),))
        elif ending.lower() in _ARCHIVES:
            fault = f"{entry!r} is not a zip. Hand in a .zip file of the package."
            found[entry] = _Source(base, (), fault=fault)
        else:
            others.append(entry)
    of_files = [each for each in found if each.lower().endswith((".py", ".zip", *_ARCHIVES))]
    names = {each.name for each in found.values()}
    left_out = []
    for entry in others:
        document = _DOCUMENT.fullmatch(entry)
        if document and len(of_files) > 1 and document["who"] not in names:
            fault = f"{entry!r} is not a node. Hand in a .py file, or a .zip file of the package."
            found[entry] = _Source(document["who"], (), fault=fault)
            names.add(document["who"])
        else:
            left_out.append(repr(entry))
    if left_out:
        text = f"{folder}: left out, not taken for submissions: {', '.join(left_out)}"
        print(f"{text}; {_EXPECTED}", file=sys.stderr)
    return list(found.values())


def _with_upload(source: _Source, path: str, name: str) -> _Source:
    """Return the submission of a student in Canvas with another file.

    Of several files with the same original name, the one that was uploaded last is used.
    """
    paths = {known: each for each, known in source.files}
    notes = source.notes
    if name in paths:
        # Canvas numbers the files in the order of their upload.
        older, path = sorted(
            (paths[name], path),
            key=lambda each: int(_CANVAS.sub(r"\g<upload>", os.path.basename(each))),
        )
        text = f"{os.path.basename(older)!r} is left out: {os.path.basename(path)!r} is newer"
        notes = (*notes, text)
    paths[name] = path
    return source._replace(files=tuple((paths[each], each) for each in paths), notes=notes)


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
    folders = {each for each, path in paths.items() if os.path.isdir(path)}
    found = []
    for name in sorted({*students, *folders}):
        known = students.get(name, ())
        if name in folders and not os.path.islink(paths[name]):
            found.append(_Source(name, ((paths[name], name),), known))
        else:
            fault = f"The export has no folder {name!r}. Download the submissions again."
            found.append(_Source(name, (), known, fault))
    return found


def _submission(source: _Source, name: str, files: Files, node: str) -> Submission:
    """Copy and check one submission.

    Raises:
        OSError: the workspace cannot be written.
    """
    os.makedirs(files.folder)
    files.notes.extend(source.notes)
    uploads = (_CANVAS.fullmatch(os.path.basename(path)) for path, _ in source.files)
    if any(upload["late"] for upload in uploads if upload):
        files.notes.append("handed in late, as Canvas says")
    if not source.students and name != source.name:
        source = source._replace(students=(Student(source.name, "", ""),))
    try:
        if source.fault:
            raise SubmissionError(source.fault)
        _copy(source, files, node)
        checked = check_submission(files, node)
        return Submission(name, source.students, "", tuple(files.notes), files.folder, *checked)
    except SubmissionError as problem:
        fault = str(problem)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):
            raise
        fault = f"{error.filename!r} cannot be copied ({error.strerror})."
    return Submission(name, source.students, fault, tuple(files.notes), files.folder, (), (), False)


def _copy(source: _Source, files: Files, node: str) -> None:
    """Copy or unpack the files of a submission.

    Raises:
        SubmissionError, OSError: a file is damaged, not safe, or too large, or cannot be copied.
    """
    try:
        for path, name in source.files:
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
    except (SubmissionError, OSError):
        shutil.rmtree(files.folder, ignore_errors=True)
        raise
