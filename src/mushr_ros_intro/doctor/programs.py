"""Find programs of a package that cannot be started."""

import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache
from typing import Callable, List, Optional, Sequence

from mushr_ros_intro.doctor.facts import Finding

_SHEBANG_REMEDY = "Make its first line: #!/usr/bin/python3"

_IMPORT_TIMEOUT = 20.0
"""For an interpreter to import rospy [s]."""


def program_findings(
    folder: str, find_node: Callable[[str], Sequence[str]] = lambda _: ()
) -> List[Finding]:
    """Return what keeps the programs in a folder from being started.

    A program is a file with a shebang line, or a Python file that starts a node or has a main
    part. setup.py and files that cannot be read are left out.

    Args:
        folder: the path of the folder.
        find_node: returns the files that rosrun finds for the name of a program. catkin may have
            installed a program that starts the one in the folder.
    """
    paths = sorted(filter(os.path.isfile, glob.glob(os.path.join(glob.escape(folder), "*"))))
    found = []
    for path in paths:
        nodes = [
            each for each in find_node(os.path.basename(path)) if not os.path.samefile(each, path)
        ]
        found += [_program_finding(nodes[0] if nodes else path), _syntax_finding(path)]
    return [each for each in found if each]


def _syntax_finding(path: str) -> Optional[Finding]:
    with suppress(OSError, ValueError), open(path, "rb") as file:
        try:
            compile(file.read() if path.endswith(".py") else b"", path, "exec", dont_inherit=True)
        except SyntaxError as error:
            problem = f"{path} has a syntax error in line {error.lineno}: {error.msg}"
            return Finding(problem, "Correct this line, or the one before it")
    return None


def _program_finding(path: str) -> Optional[Finding]:
    """Return why a program cannot be started, None if it can or if the file is no program."""
    if os.path.basename(path) == "setup.py":
        return None
    try:
        with open(path, "rb") as file:
            text = file.read(100_000)  # a package may contain large recordings
    except OSError:
        return None
    if not text.startswith(b"#!"):
        if path.endswith(".py") and re.search(rb"__main__|\binit_node\(", text):
            return Finding(f"{path} does not start with a shebang line", _SHEBANG_REMEDY)
        return None
    line = text.split(b"\n")[0]
    if line.endswith(b"\r"):
        return Finding(
            f"{path} has Windows line endings, so the interpreter in its first line is not found",
            rf"Type: sed -i 's/\r$//' {shlex.quote(path)}",
        )
    interpreter = _interpreter(line)
    program = shutil.which(interpreter)
    problem = f"{path} names the interpreter '{interpreter}', which"
    if not program:
        return Finding(f"{problem} is not installed", _SHEBANG_REMEDY)
    if os.path.basename(program).startswith("python") and not _imports_rospy(program):
        problem += f" is {program} in this terminal and cannot import rospy"
        return Finding(problem, _SHEBANG_REMEDY)
    if not os.access(path, os.X_OK):
        return Finding(f"{path} is not executable", f"Type: chmod +x {shlex.quote(path)}")
    return None


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
