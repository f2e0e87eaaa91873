"""Check the structure of the library: its floors, and the modules that import ROS.

docs/design.md shows the same floors.
"""

import ast
import functools
import glob
import os
import re

from support.paths import CHECKOUT

PACKAGE = "mushr_ros_intro"
LIBRARY = os.path.join(CHECKOUT, "src", PACKAGE)

FLOORS = (
    {"browser"},
    {"classroom"},
    {"comparison"},
    {"replay", "drive", "monitor", "authoring", "doctor"},
    {"simulator", "isolation"},
    {"preview", "ros"},
    {"car"},
    {"world", "plan"},
    {""},
)
"""The folders of the library, from the top; "" stands for the modules outside all folders.

A module may only import modules of its own folder, and of folders on lower floors.
"""

WITHOUT_ROS = {"preview", "car", "world", "plan", ""}
"""Folders of which no module may import ROS."""

IN_LIBRARY = re.compile(rf"{PACKAGE}(\.\w+)+")
ROS = re.compile(r"(ros[a-z]*|genpy|tf|tf2_\w+|\w+_msgs|std_srvs|mushr_sim)(\.|$)")


@functools.lru_cache(maxsize=None)
def modules():
    """Return the folder and the name of each module, and the names that it imports."""
    found = []
    for path in sorted(glob.glob(os.path.join(LIBRARY, "**", "*.py"), recursive=True)):
        folder, name = os.path.split(os.path.relpath(path, LIBRARY))
        with open(path, encoding="utf-8") as file:
            names = tuple(imported(file.read()))
        found.append((folder, name[: -len(".py")], names))
    return found


def imported(source):
    """Return the names of all modules that a module imports, also in its functions.

    A text that is the name of a module counts, too, because it may be imported later.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "a relative import"
            yield from (f"{node.module}.{each.name}" for each in node.names)
        elif isinstance(node, ast.Constant) and IN_LIBRARY.fullmatch(str(node.value)):
            yield node.value


def folder_of(name):
    """Return the folder of a name in this library, None for a name in another one."""
    package, first, *_ = f"{name}.".split(".")
    if package != PACKAGE:
        return None
    return first if os.path.isdir(os.path.join(LIBRARY, first)) else ""


def climbs(folder, imports):
    """Return what a module imports from folders that are not below its own."""
    floors = {each: number for number, floor in enumerate(FLOORS) for each in floor}
    names = {name: folder_of(name) for name in imports}
    return [
        name
        for name, other in names.items()
        if other not in (None, folder) and floors[other] <= floors[folder]
    ]


def test_every_folder_has_a_floor():
    folders = {folder for folder, _, _ in modules()}
    assert folders == set().union(*FLOORS), "expected each folder in FLOORS and docs/design.md"


def test_no_module_imports_from_its_own_floor_or_from_above():
    found = {f"{folder}/{name}": climbs(folder, names) for folder, name, names in modules()}
    wrong = {name: names for name, names in found.items() if names}
    assert wrong == {}, "expected imports from the same folder or lower floors: docs/design.md"


def test_no_module_of_the_lower_folders_imports_ros():
    """What can be true without ROS is testable without ROS."""
    found = {
        f"{folder}/{name}"
        for folder, name, names in modules()
        if folder in WITHOUT_ROS and any(map(ROS.match, names))
    }
    assert found == set(), "expected no ROS in the folders of WITHOUT_ROS"


def test_every_module_has_a_name_of_its_own():
    names = [name for _, name, _ in modules() if name != "__init__"]
    wrong = {name for name in names if names.count(name) > 1}
    assert wrong == set(), "expected names that no module of another folder has"


def test_the_unit_tests_are_in_the_folders_of_the_library():
    tests = glob.glob(os.path.join(CHECKOUT, "test", "unit", "*", "test_*.py"))
    folders = {os.path.basename(os.path.dirname(path)) for path in tests}
    wrong = folders - {folder for folder, _, _ in modules()}
    assert wrong == set(), "expected the names of the folders of src/mushr_ros_intro"
