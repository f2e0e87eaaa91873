"""Copy or unpack the files of one submission, within limits and without leaving its folder."""

import os
import re
import stat
import zipfile
from functools import partial
from typing import IO, List, Sequence, Tuple

from mushr_ros_intro.isolation.workspace import is_junk

MAX_FILES = 2_000
"""A submission with more files is refused."""

MAX_SIZE = 50_000_000
"""A submission with more data is refused [bytes]."""


class SubmissionError(Exception):
    """A submission cannot be run. The message is complete: it includes the remedy."""


class Files:
    """The files of one submission in its folder of the workspace."""

    def __init__(self, folder: str, limits: Tuple[int, int] = (MAX_FILES, MAX_SIZE)) -> None:
        """Begin without files.

        Args:
            folder: the folder, as a real path; it need not exist.
            limits: on the number of files, and on their size [bytes].
        """
        self.folder = folder
        self.notes: List[str] = []
        """What differs from the files that were handed in."""
        self._limits = limits
        self._count = self._size = 0

    def places(self) -> List[str]:
        """Return the relative paths of all files, and make all folders readable."""
        found = []
        for folder, _, names in os.walk(self.folder):
            os.chmod(folder, 0o755)
            paths = (os.path.join(folder, each) for each in names)
            found += [os.path.relpath(each, self.folder) for each in paths if os.path.isfile(each)]
        return sorted(found)

    def add(self, path: str, place: str) -> None:
        """Copy a folder or a file, or unpack a zip.

        Args:
            path: what to copy.
            place: its relative path in the folder; the content of a folder goes to the top for "".

        Raises:
            SubmissionError: it is damaged, not safe, or too large.
            OSError: it cannot be copied.
        """
        if os.path.isdir(path):
            self._add_folder(path, place)
        elif path.lower().endswith(".zip"):
            self.add_zip(path, place)
        else:
            with open(path, "rb") as file:
                self._write(file, place, 0)

    def add_zip(self, path: str, place: str) -> None:
        """Unpack a zip.

        Args:
            path: the zip.
            place: the relative path of a folder for its files; "" is the top.

        Raises:
            SubmissionError: the zip is damaged, not safe, or too large.
            OSError: it cannot be read, or its files cannot be written.
        """
        try:
            with zipfile.ZipFile(path) as archive:
                self._unpack(archive, place)
        except SubmissionError:
            raise
        except Exception as problem:  # zipfile raises errors of many classes
            if isinstance(problem, OSError) and problem.errno:
                raise
            text = f"The zip cannot be read ({problem}). Make it again, with the usual method."
            raise SubmissionError(text) from None

    def _unpack(self, archive: zipfile.ZipFile, top: str) -> None:
        """Unpack an open zip."""
        links = []
        for info in archive.infolist():
            name = info.filename.replace("\\", "/")
            parts = [each for each in name.split("/") if each not in ("", ".")]
            if name.startswith("/") or re.match("[A-Za-z]:/", name) or ".." in parts:
                text = f"The zip has the entry {info.filename!r}; expected a relative path"
                raise SubmissionError(f"{text} without '..'. Make a zip of the package folder.")
            if name.endswith("/") or any(map(is_junk, parts)):
                continue
            self._count_one()
            mode = info.external_attr >> 16 if info.create_system == 3 else 0
            place = os.path.join(top, *parts)
            with archive.open(info) as file:
                if stat.S_ISLNK(mode):
                    links.append((place, file.read(4096).decode()))
                elif stat.S_IFMT(mode) in (0, stat.S_IFREG):
                    self._write(file, place, mode)
                else:
                    self.notes.append(f"{place!r} is left out: it is not a regular file")
        self._add_links(links)

    def _add_folder(self, source: str, top: str) -> None:
        links = []
        for folder, folders, names in os.walk(source, onerror=_fail):
            folders[:] = [each for each in folders if not is_junk(each)]
            for name in sorted(each for each in folders + names if not is_junk(each)):
                path = os.path.join(folder, name)
                place = os.path.normpath(os.path.join(top, os.path.relpath(path, source)))
                mode = os.lstat(path).st_mode
                if stat.S_ISDIR(mode):
                    continue
                self._count_one()
                if stat.S_ISLNK(mode):
                    links.append((place, os.readlink(path)))
                elif stat.S_ISREG(mode):
                    with open(path, "rb") as file:
                        self._write(file, place, mode)
                else:
                    self.notes.append(f"{place!r} is left out: it is not a regular file")
        self._add_links(links)

    def _count_one(self) -> None:
        self._count += 1
        if self._count > self._limits[0]:
            text = f"There are more than {self._limits[0]} files. Hand in only the package."
            raise SubmissionError(text)

    def _write(self, file: IO[bytes], place: str, mode: int) -> None:
        """Write a file; of its permissions, keep whether it is executable."""
        path = os.path.join(self.folder, place)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as copy:
            for chunk in iter(partial(file.read, 65536), b""):
                self._size += len(chunk)
                if self._size > self._limits[1]:
                    text = f"The files have more than {self._limits[1] // 1_000_000} MB."
                    raise SubmissionError(f"{text} Hand in only the package.")
                copy.write(chunk)
        os.chmod(path, 0o755 if mode & 0o100 else 0o644)

    def _add_links(self, links: Sequence[Tuple[str, str]]) -> None:
        """Create links when all files exist; leave out those that leave the folder.

        Every new link points to an existing file or folder that is not a link. So no path
        through links leaves the folder, whatever the order of the links.
        """
        for place, text in links:
            path = os.path.join(self.folder, place)
            target = os.path.realpath(os.path.join(os.path.dirname(path), text))
            if os.path.commonpath([target, self.folder]) != self.folder:
                self.notes.append(f"the link {place!r} is left out: it leaves the submission")
            elif os.path.exists(target) and not os.path.lexists(path):
                os.makedirs(os.path.dirname(path), exist_ok=True)
                os.symlink(os.path.relpath(target, os.path.realpath(os.path.dirname(path))), path)


def _fail(error: OSError) -> None:
    """Raise an error that os.walk would hide."""
    raise error
