"""Find programs of a package that cannot be started, or that are not nodes."""

import ast
import difflib
import glob
import importlib.util
import os
import pkgutil
import re
import shlex
from contextlib import suppress
from typing import Any, Callable, Iterator, List, Sequence, Tuple

from mushr_ros_intro.doctor.facts import Finding
from mushr_ros_intro.program_file import (
    apt_package,
    faults_of,
    hiding_faults,
    is_of_system,
    name_faults,
    origin_of,
)

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
        faults = [*name_faults(nodes, package), *faults_of(path, starts=not others)]
        faults += faults_of(others[0]) if others else ()
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
    found = [Finding(*each) for path in paths for each in faults_of(path)]
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
        tree = ast.parse(text)
    except (OSError, SyntaxError, ValueError):
        return  # see faults_of
    if text.startswith(b"#!"):
        yield from (Finding(*each) for each in hiding_faults(path))
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
    if not _has_own(path, top) and origin_of(top) is None:
        install = "install the module; for one of ROS, type: sudo apt-get install "
        install += apt_package(top)
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


def _has_own(path: str, module: str) -> bool:
    """Return whether a module is beside the program that imports it."""
    return any(map(os.path.exists, (f"{os.path.dirname(path)}/{module}{e}" for e in ("", ".py"))))


def _is_of_system(path: str, module: str) -> bool:
    """Return whether a module that a program imports is one of Python or ROS, or has messages."""
    top = module.split(".")[0]
    is_own = top == "mushr_ros_intro" or _has_own(path, top)  # can call init_node
    return module.endswith((".msg", ".srv")) or (is_of_system(top) and not is_own)
