"""Find programs of a package that cannot be started, or that are not nodes."""

import ast
import difflib
import glob
import importlib.util
import os
import pkgutil
import re
import shlex
import sys
from contextlib import suppress
from typing import Any, Callable, Iterator, List, Optional, Sequence, Tuple

from mushr_ros_intro.doctor.facts import Finding
from mushr_ros_intro.program_file import encoding_faults, name_faults, start_faults

_USES_ROSPY = re.compile(rb"\brospy\.(Publisher|Subscriber|Rate|spin)\(")


def program_findings(
    package: str, part: str = "", find_node: Callable[[str], Sequence[str]] = lambda _: ()
) -> List[Finding]:
    """Return what keeps the programs in a folder of a package from being started.

    setup.py and files that cannot be read are left out.

    Args:
        package: the path of the package.
        part: the folder, relative to the package.
        find_node: returns the files that rosrun finds for the name of a program. catkin may have
            installed a program that starts the one in the folder.
    """
    folder = os.path.normpath(os.path.join(package, part))
    paths = sorted(filter(os.path.isfile, glob.glob(os.path.join(glob.escape(folder), "*"))))
    found: List[Finding] = []
    for path in paths:
        nodes = find_node(os.path.basename(path))
        others = [each for each in nodes if not os.path.samefile(each, path)]
        faults = (*name_faults(nodes, package), *start_faults(others[0] if others else path))
        found += [*(Finding(*each) for each in faults), *_source_findings(path)]
    return list(dict.fromkeys(found))


def no_program(package: str) -> List[Finding]:
    """Return why rosrun finds no program in a package; nothing if a file in it is executable.

    Args:
        package: the path of the package, in which rosrun searches all folders.
    """
    paths = sorted(
        filter(os.path.isfile, glob.glob(f"{glob.escape(package)}/**/*", recursive=True))
    )
    if any(os.access(each, os.X_OK) for each in paths):
        return []
    found = [Finding(*each) for path in paths for each in start_faults(path)]
    path = os.path.join(package, "src", "path_publisher.py")
    remedy = f"Save your node as {path}, and type: chmod +x {shlex.quote(path)}"
    return found or [Finding(f"there is no program in the package {package}", remedy)]


def _source_findings(path: str) -> Iterator[Finding]:
    """Yield what is wrong with the source of a Python file, without running it."""
    if not path.endswith(".py"):
        return
    try:
        with open(path, "rb") as file:
            text = file.read()
        faults = [Finding(*each) for each in encoding_faults(path, text)]
        yield from faults
        if faults:
            return
        tree = compile(text, path, "exec", ast.PyCF_ONLY_AST, dont_inherit=True)
    except SyntaxError as error:
        problem = f"{path} has a syntax error in line {error.lineno}: {error.msg}"
        yield Finding(problem.rstrip("?"), "Correct this line, or the one before it")
        return
    except (OSError, ValueError):
        return
    imports = list(_imports(tree))
    for module, names, line in imports:
        fault, remedy = _import_fault(path, module, names)
        if fault:
            yield Finding(f"{path} imports {module} in line {line}, but {fault}", remedy)
    is_node = text.startswith(b"#!") and _USES_ROSPY.search(text)
    # A module of the user may call init_node.
    has_own = not all(_is_of_system(path, module) for module, _, _ in imports)
    if is_node and not has_own and not re.search(rb"\binit_node\(", text):
        yield Finding(
            f"{path} uses rospy, but does not call rospy.init_node, so it is not a node",
            'Before the first Publisher or Subscriber, add: rospy.init_node("NAME")',
        )


def _imports(tree: Any) -> Iterator[Tuple[str, Sequence[str], int]]:
    """Yield the module, the names from it, and the line of what a file always imports."""
    for each in tree.body:
        if isinstance(each, ast.Import):
            yield from ((alias.name, (), each.lineno) for alias in each.names)
        elif isinstance(each, ast.ImportFrom) and each.module and not each.level:
            names = [alias.name for alias in each.names if alias.name != "*"]
            yield each.module, names, each.lineno


def _import_fault(path: str, module: str, names: Sequence[str]) -> Tuple[str, str]:
    """Return why a program cannot import names from a module, and what to do; empty if it can.

    Modules of the user are not imported, because this runs their code.
    """
    top = module.split(".")[0]
    if _origin(path, top) is None:
        package = f"python3-{top.replace('_', '-')}"
        install = f"install the module; for one of ROS, type: sudo apt-get install {package}"
        known = [each.name for each in pkgutil.iter_modules()]
        return "Python does not find this module", _correction(top, known, f", or {install}")
    if not _is_of_system(path, module):
        return "", ""
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        return f"Python reports: {error}", _correction(module, [])
    except Exception:  # the module is there; whether it works in the node is not known
        return "", ""
    for name in names:
        if not hasattr(found, name) and not _has_submodule(found, name):
            return f"it does not contain {name}", _correction(name, dir(found))
    return "", ""


def _correction(name: str, known: Sequence[str], otherwise: str = "") -> str:
    """Return a remedy: a similar name, or `otherwise`."""
    close = difflib.get_close_matches(name, known, 1, 0.8)
    return f"Did you mean {close[0]}?" if close else f"Correct the name{otherwise}"


def _has_submodule(package: Any, name: str) -> bool:
    with suppress(ImportError):
        return importlib.util.find_spec(f"{package.__name__}.{name}") is not None
    return False


def _origin(path: str, module: str) -> Optional[str]:
    """Return the file of a module that a program imports; None if Python does not find it."""
    folder = os.path.dirname(path)
    for own in (f"{folder}/{module}.py", f"{folder}/{module}"):
        if os.path.exists(own):
            return own
    with suppress(ValueError, ImportError):
        found = importlib.util.find_spec(module)
        return (found.origin or "") if found else None
    return ""


def _is_of_system(path: str, module: str) -> bool:
    """Return whether a module that a program imports is one of Python or ROS, or has messages."""
    origin = _origin(path, module.split(".")[0]) or ""
    this = f"{os.sep}mushr_ros_intro{os.sep}__init__.py"  # has a function that calls init_node
    is_own = this in origin or origin.startswith(os.path.dirname(path))
    folders = (sys.prefix, "/usr", "/opt", "built-in", "frozen")
    return module.endswith((".msg", ".srv")) or (origin.startswith(folders) and not is_own)
