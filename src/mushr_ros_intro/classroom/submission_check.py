"""Check whether the node of a submission can be run. No file of the submission is run."""

import filecmp
import os
import re
import shlex
from typing import List, Sequence, Tuple
from xml.etree import ElementTree

from mushr_ros_intro.classroom.submission_files import Files, SubmissionError
from mushr_ros_intro.isolation.workspace import search_path
from mushr_ros_intro.program_file import MAX_TEXT, faults_of, hiding_faults

_TESTS = {"test", "tests"}
"""Folders with tests of nodes; these may have the name of the node."""

_PURE_PYTHON = set(
    "add_rostest catkin_add_nosetests catkin_install_python catkin_metapackage catkin_package"
    " catkin_python_setup"
    " cmake_minimum_required cmake_policy else elseif endif find_package if include_directories"
    " install message option project roslaunch_add_file_check set".split()
)
"""The commands of a CMakeLists.txt that build nothing."""


def check_submission(files: Files, node: str) -> Tuple[Tuple[str, ...], Tuple[str, ...], bool]:
    """Find the node and the packages of a submission; make the node executable.

    Args:
        files: the files of the submission; notes are added to its notes.
        node: the name of the executable file.

    Returns:
        `command`, `packages` and `needs_build` of `Submission`.

    Raises:
        SubmissionError: the node cannot be run.
        OSError: a file cannot be read.
    """
    places = files.places()
    packages = _packages(places)
    place = _choose(files, places, packages, node)
    _check_packages(files.folder, packages)
    path = os.path.join(files.folder, place)
    has_package = any(_is_in(place, each) for each in packages)
    if not has_package:
        files.notes.append("there is no package.xml; the node is run without a package")
    if not os.stat(path).st_mode & 0o100:
        os.chmod(path, 0o755)  # uploads often lose the permission, so this is no fault
        if has_package:
            text = f"{place!r} is not executable. rosrun needs: chmod +x {shlex.quote(place)}"
            files.notes.append(text)
    for problem, remedy in faults_of(path, place=place, search_path=search_path()):
        raise SubmissionError(f"{problem}. {remedy}.")
    for problem, remedy in hiding_faults(path):
        files.notes.append(f"{problem}. {remedy}".replace(os.path.join(files.folder, ""), ""))
    folders = tuple(os.path.normpath(os.path.join(files.folder, each)) for each in packages)
    return (path,), folders, any(map(_needs_build, folders))


def _is_in(place: str, folder: str) -> bool:
    """Return whether a relative path is in a folder; "" is the top."""
    return not folder or place.startswith(folder + "/")


def _packages(places: Sequence[str]) -> List[str]:
    """Return the folders of the packages; ROS does not search for packages in packages."""
    found: List[str] = []
    for folder in sorted(
        os.path.dirname(p) for p in places if os.path.basename(p) == "package.xml"
    ):
        if not any(_is_in(folder, each) for each in found):
            found.append(folder)
    return found


def _is_test(place: str, packages: Sequence[str]) -> bool:
    """Return whether a file is in a folder for tests; a package itself can have such a name."""
    package = next((each for each in packages if _is_in(place, each)), "")
    return bool(_TESTS & {*os.path.relpath(place, package or ".").split("/")})


def _choose(files: Files, places: Sequence[str], packages: Sequence[str], node: str) -> str:
    """Return the place of the node.

    Raises:
        SubmissionError: there is none, or there are several.
    """
    named = [p for p in places if os.path.basename(p) == node and not _is_test(p, packages)]
    if not named:
        programs_first = sorted(places, key=lambda place: not place.endswith(".py"))
        found = f"found {_show(programs_first)}" if places else "there are no files"
        text = f"There is no {node}; {found}. Hand in a package with src/{node}"
        raise SubmissionError(f"{text}, a program in Python.")
    usual = {os.path.join(each, folder) for each in packages for folder in ("src", "scripts")}
    chosen = [each for each in named if os.path.dirname(each) in usual] if named[1:] else named
    chosen = chosen or named
    first, *others = (os.path.join(files.folder, each) for each in chosen)
    if all(filecmp.cmp(first, each, shallow=False) for each in others):
        chosen = chosen[:1]
    if len(chosen) != 1:
        text = f"There are several files {node}: {_show(chosen)}"
        raise SubmissionError(f"{text}. Keep one of them, in src/ or scripts/ of the package.")
    if named[1:]:
        left = [each for each in named if each not in chosen]
        files.notes.append(f"{chosen[0]!r} is run, not {_show(left)}")
    return chosen[0]


def _show(names: Sequence[str]) -> str:
    """Return the first few of some file names for a message."""
    return ", ".join(map(repr, names[:5])) + (", ..." if len(names) > 5 else "")


def _check_packages(folder: str, packages: Sequence[str]) -> None:
    """Check the package.xml files.

    Raises:
        SubmissionError: one is not valid, or has no name.
    """
    for package in packages:
        place = os.path.join(package, "package.xml")
        with open(os.path.join(folder, place), "rb") as file:
            data = file.read(MAX_TEXT + 1)
        # Entities of a DOCTYPE can fill the memory. Without zeros UTF-16 reads as ASCII.
        if len(data) > MAX_TEXT or b"<!DOCTYPE" in data.replace(b"\0", b""):
            text = f"{place!r} has more than 1 MB, or a DOCTYPE; expected a plain package.xml."
            raise SubmissionError(text)
        try:
            root = ElementTree.fromstring(data)
        except (ElementTree.ParseError, LookupError, ValueError) as error:
            raise SubmissionError(f"{place!r} is not valid XML: {error}. Correct it.") from None
        if root.tag != "package" or not (root.findtext("name") or "").strip():
            text = f"{place!r} has no name; expected <package> with <name>my_ros_intro</name>."
            raise SubmissionError(text)


def _needs_build(package: str) -> bool:
    """Return whether the CMakeLists.txt of a package, if any, builds anything."""
    path = os.path.join(package, "CMakeLists.txt")
    if not os.path.isfile(path):
        return False
    with open(path, encoding="utf-8", errors="replace") as file:
        text = file.read(MAX_TEXT)
    text = re.sub(r"#\[\[.*?\]\]", "", text, flags=re.DOTALL)
    commands = re.findall(r"^[ \t]*(\w+)[ \t]*\(", text, re.MULTILINE)
    return any(each.lower() not in _PURE_PYTHON for each in commands)
