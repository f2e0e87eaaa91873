"""Find programs of a package that cannot be started, or that are not nodes."""

import ast
import glob
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache
from typing import Any, Callable, Iterator, List, Optional, Sequence, Tuple

from mushr_ros_intro.doctor.facts import Finding

_SHEBANG_REMEDY = "Make its first line: #!/usr/bin/python3"

_USES_ROSPY = re.compile(rb"\brospy\.(Publisher|Subscriber|Rate|spin)\(")

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
    found: List[Finding] = []
    for path in paths:
        nodes = [
            each for each in find_node(os.path.basename(path)) if not os.path.samefile(each, path)
        ]
        found += [*_start_findings(nodes[0] if nodes else path), *_source_findings(path)]
    return found


def _source_findings(path: str) -> Iterator[Finding]:
    """Yield what is wrong with the source of a Python file, without running it."""
    if not path.endswith(".py"):
        return
    try:
        with open(path, "rb") as file:
            text = file.read()
        tree = compile(text, path, "exec", ast.PyCF_ONLY_AST, dont_inherit=True)
    except SyntaxError as error:
        problem = f"{path} has a syntax error in line {error.lineno}: {error.msg}"
        yield Finding(problem, "Correct this line, or the one before it")
        return
    except (OSError, ValueError):
        return
    lines = dict(_imported_modules(tree))
    for name, line in lines.items():
        if _origin(name, path) is None:
            yield Finding(
                f"{path} imports {name} in line {line}, but Python does not find this module",
                f"Correct the name, or install the module; for one of ROS, type: sudo apt-get "
                f"install python3-{name.replace('_', '-')}",
            )
    is_node = text.startswith(b"#!") and _USES_ROSPY.search(text)
    # A module of the user may call init_node.
    has_own = not all(_is_of_system(_origin(name, path)) for name in lines)
    if is_node and not has_own and not re.search(rb"\binit_node\(", text):
        yield Finding(
            f"{path} uses rospy, but does not call rospy.init_node, so it is not a node",
            'Before the first Publisher or Subscriber, add: rospy.init_node("NAME")',
        )


def _imported_modules(tree: Any) -> Iterator[Tuple[str, int]]:
    """Yield the name and the line of each module that a file always imports."""
    for each in tree.body:
        if isinstance(each, ast.Import):
            yield from ((alias.name.split(".")[0], each.lineno) for alias in each.names)
        elif isinstance(each, ast.ImportFrom) and each.module and not each.level:
            yield each.module.split(".")[0], each.lineno


def _origin(name: str, path: str) -> Optional[str]:
    """Return the file of a module that a program imports; None if Python does not find it."""
    folder = os.path.dirname(path)
    for own in (f"{folder}/{name}.py", f"{folder}/{name}"):
        if os.path.exists(own):
            return own
    with suppress(ValueError, ImportError):
        found = importlib.util.find_spec(name)
        return (found.origin or "") if found else None
    return ""


def _is_of_system(origin: Optional[str]) -> bool:
    """Return whether a module is one of Python or of ROS; this package's own is none of them."""
    folders = (sys.prefix, "/usr", "/opt", "built-in", "frozen")
    is_own = origin and f"{os.sep}mushr_ros_intro{os.sep}__init__.py" in origin
    return bool(origin) and not is_own and str(origin).startswith(folders)


def _start_findings(path: str) -> Iterator[Finding]:
    """Yield why a program cannot be started; nothing if the file is no program."""
    if os.path.basename(path) == "setup.py":
        return
    try:
        with open(path, "rb") as file:
            text = file.read(100_000)  # a package may contain large recordings
    except OSError:
        return
    if text.startswith(b"#!"):
        yield from _shebang_findings(path, text.split(b"\n")[0])
    elif path.endswith(".py") and re.search(rb"__main__|\binit_node\(", text):
        yield Finding(f"{path} does not start with a shebang line", _SHEBANG_REMEDY)
    else:
        return
    if not os.access(path, os.X_OK):
        yield Finding(f"{path} is not executable", f"Type: chmod +x {shlex.quote(path)}")


def _shebang_findings(path: str, line: bytes) -> Iterator[Finding]:
    """Yield why the first line of a program does not start it."""
    if line.endswith(b"\r"):
        yield Finding(
            f"{path} has Windows line endings, so the interpreter in its first line is not found",
            rf"Type: sed -i 's/\r$//' {shlex.quote(path)}",
        )
        return
    interpreter = _interpreter(line)
    program = shutil.which(interpreter)
    problem = f"{path} names the interpreter '{interpreter}', which"
    if not program:
        yield Finding(f"{problem} is not installed", _SHEBANG_REMEDY)
    elif os.path.basename(program).startswith("python") and not _imports_rospy(program):
        problem += f" is {program} in this terminal and cannot import rospy"
        yield Finding(problem, _SHEBANG_REMEDY)


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
