"""Find and read plan files."""

import os
import stat

from mushr_ros_intro.parameters import user_path
from mushr_ros_intro.plan.model import Fault, Plan, PlanError
from mushr_ros_intro.plan.parse import parse_plan

MAX_FILE_SIZE = 100_000_000
"""Larger plan files are refused [bytes]; a plan of a million rows has twelve million."""


def find_plan(name: str, plans_folder: str) -> str:
    """Return the path of the plan file that a user means by `name`.

    A name without a folder is looked up in `plans_folder` first, with or without ``.txt``. Any
    other name is a path; a relative one starts at the user's directory (see `user_path`), or at
    the current one.

    Raises:
        PlanError: there is no such file; the message lists the plans in `plans_folder`.
    """
    candidates = [user_path(name), os.path.abspath(name)] if name else []
    if name and os.sep not in name:
        candidates = [
            os.path.join(plans_folder, name),
            os.path.join(plans_folder, name + ".txt"),
            *candidates,
        ]
    for exists in (os.path.isfile, os.path.exists):  # read_plan explains what is not a file
        for candidate in candidates:
            if exists(candidate):
                return candidate
    try:
        known = sorted(entry[:-4] for entry in os.listdir(plans_folder) if entry.endswith(".txt"))
    except OSError:
        known = []
    text = (
        "no such plan file; expected the path of a file, or the name of one in "
        f"{plans_folder}: {', '.join(known) or '(there are none)'}"
    )
    raise PlanError([Fault(name or "''", 1, 1, text)])


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is not a plan; it lists every fault of the file.
    """

    def refuse(text: str) -> PlanError:
        return PlanError([Fault(path, 1, 1, text)])

    try:
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            raise refuse("this is a directory; expected a plan file")
        if not stat.S_ISREG(status.st_mode):
            raise refuse("this is not a regular file; expected a plan file")
        if status.st_size > MAX_FILE_SIZE:
            raise refuse(
                f"the file has {status.st_size} bytes; "
                f"expected a plan file of at most {MAX_FILE_SIZE}"
            )
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
    except PlanError:
        raise
    except FileNotFoundError:
        raise refuse("no such file; expected a plan file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(f"the file cannot be read ({reason}); expected a plan file") from None
    return parse_plan(data, path)
