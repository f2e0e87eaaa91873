"""Find files of this package and of the user."""

import os

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.wording import similar


def package_folder(name: str) -> str:
    """Return the path of a folder of this package, without symbolic links.

    The folder is found relative to this file, in the source or after an installation. rospkg could
    find another package of the same name: that of a student who follows the tutorial.
    """
    library = os.path.dirname(os.path.realpath(__file__))
    package = os.path.join(library, "..", "..")  # the parent folder of src
    if not os.path.exists(os.path.join(package, "package.xml")):
        # PREFIX/lib/python3/dist-packages/mushr_ros_intro
        package = os.path.join(library, "..", "..", "..", "..", "share", "mushr_ros_intro")
    return os.path.realpath(os.path.join(package, name))


def user_path(path: str) -> str:
    """Return the absolute path that a user means by `path`.

    A relative path starts at the user's directory. roslaunch starts nodes in ROS_HOME, but leaves
    PWD as it was in the user's shell.
    """
    return os.path.abspath(os.path.join(os.environ.get("PWD", "."), os.path.expanduser(path)))


def find_file(name: str, folder: str, ending: str) -> str:
    """Return the path of the file that a user means by `name`.

    A name without a folder, with or without the ending, is a file in the user's directory (see
    `user_path`), else in `folder`. Any other name is a path, relative to the user's directory.
    Both can also be relative to the current directory.

    Raises:
        UserError: there is no such file, or it cannot be reached; the message names the closest
            one in `folder`, the folders searched, and all files in `folder`.
    """
    candidates = [user_path(name), os.path.abspath(name)]
    is_there = os.path.exists
    if os.sep not in name:
        candidates[1:1] = [user_path(name + ending), *(f"{folder}/{name}{e}" for e in ("", ending))]
        is_there = os.path.isfile
    for candidate in candidates:
        if is_there(candidate):
            return candidate
    others = [each for each in sorted(os.listdir(folder)) if os.path.splitext(each)[0] == name]
    problem = "no such file"
    if others:
        problem += f" with the ending {ending}, only {', '.join(others)}"
    for candidate in candidates:
        try:
            os.stat(candidate)
            problem = "not a file"
        except PermissionError:
            problem = "permission denied"
        except (OSError, ValueError):  # a name with a null character
            pass
    known = sorted(entry[: -len(ending)] for entry in os.listdir(folder) if entry.endswith(ending))
    close = similar(os.path.basename(name).replace(ending, ""), known)
    searched = dict.fromkeys(os.path.dirname(candidate) for candidate in candidates)
    raise UserError(
        f"{name}: {problem}{close} "
        f"(searched: {', '.join(searched)}); expected a path, or one of {', '.join(known)}"
    )
