"""Find and read plan files."""

import os
import stat
from typing import Sequence

from mushr_ros_intro.plan.model import Fault, Plan, PlanError
from mushr_ros_intro.plan.parse import parse_plan

MAX_FILE_SIZE = 100_000_000
"""A plan file is refused beyond this size [bytes]; a plan of a million rows has twelve million."""


def find_plan(name: str, plans: str, folders: Sequence[str]) -> str:
    """Find the file that a user means by `name`.

    A bare name is looked up in the folder `plans` first, with or without ``.txt``; anything else
    is a path, tried as it is and, where it is relative, in each of `folders`.

    Returns:
        The path of a file that exists.

    Raises:
        PlanError: nothing of that name is there; the message lists the plans that are.
    """
    candidates = []
    if name and os.sep not in name:
        candidates += [os.path.join(plans, name), os.path.join(plans, name + ".txt")]
    candidates += [os.path.join(folder, os.path.expanduser(name)) for folder in folders]
    for candidate in candidates:
        if name and os.path.isfile(candidate):
            return candidate
    for candidate in candidates:
        if name and os.path.exists(candidate):
            return candidate  # not a file, which read_plan says better
    try:
        known = sorted(entry[:-4] for entry in os.listdir(plans) if entry.endswith(".txt"))
    except OSError:
        known = []
    raise PlanError(
        [
            Fault(
                name or "''",
                1,
                1,
                "no such plan file; expected the path of a file, or the name of one in "
                f"{plans}: {', '.join(known) or '(there are none)'}",
            )
        ]
    )


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is no plan; it names every fault of the file.
    """
    return parse_plan(read_bytes(path), path)


def read_bytes(path: str) -> bytes:
    """Return what stands in the plan file at `path`.

    Raises:
        PlanError: it cannot be read, or is too large for a plan.
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
            return file.read(MAX_FILE_SIZE + 1)
    except PlanError:
        raise
    except FileNotFoundError:
        raise refuse("no such file; expected a plan file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(f"the file cannot be read ({reason}); expected a plan file") from None
