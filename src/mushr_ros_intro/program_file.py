"""Find why a program cannot be started: its first line, its line ends, its permissions."""

import codecs
import os
import re
import shlex
import shutil
import subprocess
import sys
from functools import lru_cache
from typing import Iterator, Sequence, Tuple

Fault = Tuple[str, str]
"""What is wrong, and what to do."""

_REMEDY = "Make its first line: #!/usr/bin/python3"

_IMPORT_TIMEOUT = 20.0
"""For an interpreter to import rospy [s]."""


def start_faults(path: str) -> Iterator[Fault]:
    """Yield why a program cannot be started; nothing if the file is no program.

    A program is a file with a shebang line, or a Python file that starts a node or has a main part.
    """
    if os.path.basename(path) == "setup.py":
        return
    try:
        with open(path, "rb") as file:
            text = file.read(100_000)  # a package may contain large recordings
            text += file.read() if text.startswith(b"#!") else b""
    except OSError:
        return
    if text.startswith(codecs.BOM_UTF8):
        yield from encoding_faults(path, text)
    elif text.startswith(b"#!"):
        line = text.split(b"\n")[0]
        if path.endswith(".py.txt"):
            words = shlex.join(["mv", path, path[: -len(".txt")]])
            yield f"{path} has the ending .txt, perhaps from an editor", f"Type: {words}"
            return
        yield from _first_line_faults(path, line)
        if b"python" in line:
            yield from encoding_faults(path, text)
    elif path.endswith(".py") and re.search(rb"__main__|\binit_node\(", text):
        yield f"{path} does not start with a shebang line", _REMEDY
    else:
        return
    if not os.access(path, os.X_OK):
        yield f"{path} is not executable", f"Type: chmod +x {shlex.quote(path)}"


def name_faults(paths: Sequence[str], package: str) -> Iterator[Fault]:
    """Yield that several files have the name of a program, of which rosrun cannot choose one.

    Args:
        paths: the files with this name that ROS finds. One file may have several links.
        package: the folder of the package. catkin's programs outside start the one in it.
    """
    inside = os.path.join(package, "")
    files = sorted({os.path.realpath(each) for each in paths if each.startswith(inside)})
    if len(files) > 1:
        problem = f"the package has several programs of the same name: {', '.join(files)}"
        yield problem, "Rename or delete all but one, because ROS could start any of them"


def encoding_faults(path: str, text: bytes) -> Iterator[Fault]:
    """Yield the faults of a program in Python with a byte order mark, or that is not UTF-8."""
    if text.startswith(codecs.BOM_UTF8 + b"#!"):
        problem = f"{path} begins with a byte order mark, so its first line does not work"
        yield problem, rf"Type: sed -i '1s/^\xef\xbb\xbf//' {shlex.quote(path)}"
    if number := line_not_in_utf8(text):
        yield f"{path} is not UTF-8 in line {number}", "Save it as UTF-8"


def line_not_in_utf8(text: bytes) -> int:
    """Return the number of the first line of a program in Python that is not UTF-8.

    Return 0 if there is none, or if the program declares another encoding. `compile` accepts other
    bytes in comments, but Python does not start such a program.
    """
    if any(re.match(rb"\s*#.*coding[:=]", line) for line in text.split(b"\n", 2)[:2]):
        return 0
    try:
        text.decode()
    except UnicodeDecodeError as error:
        return text.count(b"\n", 0, error.start) + 1
    return 0


def _first_line_faults(path: str, line: bytes) -> Iterator[Fault]:
    """Yield why the first line of a program does not start it."""
    if line.endswith(b"\r"):
        yield (
            f"{path} has Windows line ends (CRLF), so its first line does not work",
            rf"Type: sed -i 's/\r$//' {shlex.quote(path)}",
        )
        return
    interpreter = _interpreter(line)
    program = shutil.which(interpreter)
    problem = f"{path} names the interpreter '{interpreter}', which"
    if not program:
        yield f"{problem} is not installed", _REMEDY
    elif not os.path.basename(program).startswith("python"):
        if path.endswith(".py"):
            yield f"{problem} is not Python", _REMEDY
    elif not _imports_rospy(program):
        yield f"{problem} is {program} in this terminal and cannot import rospy", _REMEDY


@lru_cache
def _imports_rospy(program: str) -> bool:
    if os.path.realpath(program) == os.path.realpath(sys.executable):
        return True  # this process has imported it
    try:
        command = [program, "-c", "import rospy"]
        pipe = subprocess.DEVNULL
        subprocess.run(
            command, stdin=pipe, stdout=pipe, stderr=pipe, timeout=_IMPORT_TIMEOUT, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return False
    return True


def _interpreter(line: bytes) -> str:
    """Return the interpreter that a shebang line names: a path, or a name that env looks for."""
    words = line[2:].decode(errors="replace").split()
    if words and words[0].endswith("/env") and shutil.which(words[0]):
        words = [each for each in words[1:] if not each.startswith("-")]
    return words[0] if words else ""
