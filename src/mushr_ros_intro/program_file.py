"""Find why a program cannot be started: its first line, its text, its permissions."""

import ast
import codecs
import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import warnings
from contextlib import suppress
from functools import lru_cache
from typing import FrozenSet, Iterator, List, Optional, Sequence, Tuple

Fault = Tuple[str, str]
"""What is wrong, and what to do."""

MAX_TEXT = 1_000_000
"""The size of the largest program that is checked [bytes]: to parse it takes much memory."""

_REMEDY = "Make its first line: #!/usr/bin/python3"

_OF_DEBIAN = ("catkin_pkg", "numpy", "rospkg", "yaml")
"""Modules that are not in the packages of ROS's own distributions, such as ros-noetic-rospy."""

_IMPORT_TIMEOUT = 20.0
"""For an interpreter to import modules [s]."""

COMPILE_TIME = 20
"""Limit on the compilation of a program [s of processor time]."""

# In its own process: some sources crash the compiler of Python 3.9, and need much memory.
COMPILE = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_CPU, 2 * [int(sys.argv[1])])
try:
    compile(sys.stdin.buffer.read(), "", "exec")
except SyntaxError as error:
    print(json.dumps([error.lineno or 1, error.msg, (error.text or "").strip()[:80]]))
except (LookupError, ValueError) as error:
    print(json.dumps([1, str(error), ""]))
"""


def faults_of(
    path: str, starts: bool = True, place: str = "", search_path: Optional[str] = None
) -> Iterator[Fault]:
    """Yield why a program, or a module in Python, cannot be used; nothing about another file.

    A program is a file with a shebang line, or a Python file that starts a node or has a main part.

    Args:
        path: the file.
        starts: whether the file is started itself, if it is a program.
        place: the name in messages of a file that must be a program in Python 3 and is not trusted:
            nothing that it names is run.
        search_path: the PATH of the program; None: that of this process.
    """
    try:
        with open(path, "rb") as file:
            text = file.read(MAX_TEXT + 1)
    except OSError:
        return
    name, typed = repr(place) if place else path, shlex.quote(place or path)
    is_python, line = path.endswith(".py") or bool(place), text.split(b"\n", 1)[0]
    if len(text) > MAX_TEXT:
        if place:
            yield f"{name} has more than 1 MB", "Hand in a program in Python"
        return
    if path.endswith(".py.txt") and line.startswith(b"#!"):
        words = shlex.join(["mv", path, path[: -len(".txt")]])
        yield f"{name} has the ending .txt, perhaps from an editor", f"Type: {words}"
        return
    has_main = is_python and re.search(rb"__main__|\binit_node\(", text)
    mark = line.startswith((codecs.BOM_UTF8, codecs.BOM_UTF16_BE, codecs.BOM_UTF16_LE))
    is_program = place or has_main or text.lstrip().startswith((b"#!", codecs.BOM_UTF8 + b"#!"))
    is_program = starts and is_program and os.path.basename(path) != "setup.py"
    if is_program and mark:
        problem = f"{name} begins with a byte order mark, so its first line does not work"
        sed = rf"Type: sed -i '1s/^\xef\xbb\xbf//' {typed}"
        yield problem, sed if line.startswith(codecs.BOM_UTF8) else "Save it as UTF-8"
    elif is_program:
        yield from _first_line_faults(name, typed, text, is_python, search_path, not place)
    if (is_python or b"python" in line) and (place or not _compiles(text)):
        yield from _text_faults(name, text)
    # grade.py has made a submission executable; if it cannot run, the machine refuses it (noexec).
    if is_program and not place and not os.access(path, os.X_OK):
        yield f"{name} is not executable", f"Type: chmod +x {typed}"


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


def hiding_faults(path: str) -> Iterator[Fault]:
    """Yield which files beside a program in Python replace a module of Python or ROS for it.

    A program finds modules in its own folder first, also those that other modules import.
    """
    modules = {module.split(".")[0] for module, _ in imports_of(path)} | _modules_of_rospy()
    for name in sorted(modules):
        file = os.path.join(os.path.dirname(path), name)
        for end in (".py", "/__init__.py"):
            if os.path.isfile(file + end) and is_of_system(name):
                problem = f"{file}{end} hides the module {name} of Python or ROS, which the node"
                yield f"{problem} needs", "Give it another name"


def imports_of(path: str) -> List[Tuple[str, int]]:
    """Return each module that a Python file always imports, and the line; none if it is not valid.

    Relative imports are left out.
    """
    found = []
    with suppress(OSError, SyntaxError, ValueError), open(path, "rb") as file:
        for each in ast.parse(file.read(MAX_TEXT)).body:
            if isinstance(each, ast.Import):
                found += [(alias.name, each.lineno) for alias in each.names]
            elif isinstance(each, ast.ImportFrom) and each.module and not each.level:
                found.append((each.module, each.lineno))
    return found


def apt_package(module: str) -> str:
    """Return the name of the package that contains a module of ROS on this machine."""
    is_from_ros = os.path.isdir("/opt/ros") and module not in _OF_DEBIAN
    prefix = f"ros-{os.environ.get('ROS_DISTRO')}" if is_from_ros else "python3"
    return f"{prefix}-{module.replace('_', '-')}"


def is_of_system(module: str) -> bool:
    """Return whether a module that this process finds is one of Python or ROS."""
    places = (sys.prefix, sys.base_prefix, "/usr", "/opt", "built-in", "frozen")
    return (origin_of(module) or "").startswith(places)


def origin_of(module: str) -> Optional[str]:
    """Return the file of a module; "" if it is not known, None if there is no such module."""
    with suppress(ValueError, ImportError):
        found = importlib.util.find_spec(module)
        return (found.origin or "") if found else None
    return ""


@lru_cache
def _modules_of_rospy() -> FrozenSet[str]:
    """Return the modules that are loaded if a program imports rospy."""
    command = [sys.executable, "-c", "import rospy, sys; print(*sys.modules)"]
    with suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(command, capture_output=True, cwd="/", timeout=_IMPORT_TIMEOUT)
        return frozenset(done.stdout.decode().split())
    return frozenset()


def _compiles(text: bytes) -> bool:
    """Return whether a program can be compiled; a process for each takes a second in all."""
    with suppress(SyntaxError, LookupError, ValueError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(compile(text, "", "exec")) and not _line_not_in_utf8(text)
    return False


def _text_faults(name: str, text: bytes) -> Iterator[Fault]:
    """Yield why the text of a program is not Python that this machine's Python 3 can compile."""
    if number := _line_not_in_utf8(text):
        yield f"{name} is not UTF-8 in line {number}", "Save it as UTF-8"
        return
    # Not the interpreter of the first line: that could be a program of a submission.
    command = [sys.executable, "-I", "-S", "-W", "ignore", "-c", COMPILE, str(COMPILE_TIME)]
    done = subprocess.run(command, input=text, capture_output=True)
    if done.stdout:
        number, message, line = json.loads(done.stdout)
        shown = f": {line!r}" if line else ""
        problem = f"{name} has a syntax error in line {number}: {message.rstrip('?')}{shown}"
        yield problem, "Correct this line, or the one before it"
    elif done.returncode:
        yield f"{name} is too complex to compile", "Expected a program in Python"


def _line_not_in_utf8(text: bytes) -> int:
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


def _first_line_faults(
    name: str,
    typed: str,
    text: bytes,
    is_python: bool,
    search_path: Optional[str],
    is_trusted: bool,
) -> Iterator[Fault]:
    """Yield why the first line of a program does not start it."""
    line = text.split(b"\n", 1)[0]
    if not line.startswith(b"#!"):
        if text.lstrip().startswith(b"#!"):
            yield f"{name} has blanks or empty lines before '#!'", "Delete what is before '#!'"
        else:
            yield f"{name} does not start with a shebang line", _REMEDY
        return
    if line.endswith(b"\r"):
        problem = f"{name} has Windows line ends (CRLF), so its first line does not work"
        yield problem, rf"Type: sed -i 's/\r$//' {typed}"
        return
    interpreter, program = _interpreter(line[2:].decode(errors="replace"), search_path)
    problem = f"{name} names the interpreter {interpreter!r}, which"
    names = [os.path.basename(each) for each in (program, os.path.realpath(program))]
    if not program:
        if is_trusted or not searches_python(line[2:], search_path):
            yield f"{problem} is not installed", _REMEDY
    elif not any(each.startswith("python") for each in names):
        if is_python:
            yield f"{problem} is not Python", _REMEDY
    elif not is_trusted:
        if not any(re.fullmatch(r"python3(\.\d+)?", each) for each in names):
            yield f"{problem} is not Python 3", _REMEDY
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


def searches_python(line: bytes, search_path: Optional[str]) -> bool:
    """Return whether a first line, after #!, names a `python` that a machine does not have.

    A replay runs such a program with Python 3: the line is that of the tutorial.
    """
    found = _interpreter(line.decode(errors="replace"), search_path)
    usual = ("python", "/usr/bin/python", "/bin/python")
    return found[0] in usual and not found[1] and b"/" in line


def _interpreter(line: str, search_path: Optional[str]) -> Tuple[str, str]:
    """Return the interpreter in a first line, and its path; "" if it does not exist."""
    # As in the kernel: after the first word all is one argument, also with spaces in it.
    name, argument = [*re.split(r"[ \t]+", line.strip(" \t"), maxsplit=1), ""][:2]
    exists = os.path.isabs(name) and os.path.isfile(name) and os.access(name, os.X_OK)
    if exists and os.path.basename(name) == "env":
        split = re.match(r"(?:-S|--split-string=?)(.*)", argument)
        words = [w for w in split[1].split() if w[0] != "-" and "=" not in w] if split else []
        argument = [*words, ""][0] if split else argument
        return argument, shutil.which(argument, path=search_path) or ""
    return name, name if exists else ""
