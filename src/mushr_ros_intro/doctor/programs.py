"""Find programs of a package that cannot be started."""

import difflib
import glob
import os
import pkgutil
import shlex
from typing import Callable, Iterator, List, Sequence

from mushr_ros_intro.doctor.facts import Finding
from mushr_ros_intro.program_file import (
    apt_package,
    faults_of,
    hiding_faults,
    imports_of,
    is_of_system,
    name_faults,
    origin_of,
)


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
    """Yield what is wrong with the imports of a program, without running it."""
    if os.access(path, os.X_OK):
        yield from (Finding(*each) for each in hiding_faults(path))
    for module, line in imports_of(path) if path.endswith(".py") else ():
        top = module.split(".")[0]
        # A module of the user is not searched further, because this would run its package.
        wanted = module if is_of_system(top) else top
        beside = os.path.join(os.path.dirname(path), top)
        if (
            os.path.exists(beside)
            or os.path.exists(f"{beside}.py")
            or origin_of(wanted) is not None
        ):
            continue
        close = difflib.get_close_matches(
            top, (each.name for each in pkgutil.iter_modules()), 1, 0.8
        )
        remedy = f"Did you mean {close[0]}?" if close and wanted == top else "Correct the name"
        if not close:
            remedy += ", or install the module; for one of ROS, type: sudo apt-get install "
            remedy += apt_package(top)
        problem = f"{path} imports {module} in line {line}, but Python does not find this module"
        yield Finding(problem, remedy)
