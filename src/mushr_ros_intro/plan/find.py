"""Find and read plan files."""

import os

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import find_file
from mushr_ros_intro.plan.model import Fault, Plan, PlanError
from mushr_ros_intro.plan.parse import parse_plan

MAX_FILE_SIZE = 100_000_000
"""Larger plan files are refused [bytes]; a plan of a million rows has twelve million."""


def find_plan(name: str, plans_folder: str) -> str:
    """Return the path of the plan file that a user means by `name`; see `find_file`.

    Raises:
        PlanError: there is no such file; the message lists the plans in `plans_folder`.
    """
    try:
        return find_file(name, plans_folder, ".txt")
    except UserError as error:
        raise PlanError([Fault(name or "''", 1, 1, str(error))]) from None


def read_plan(path: str) -> Plan:
    """Read the plan file at `path`.

    Raises:
        PlanError: the file cannot be read, or is not a plan; it lists every fault of the file.
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise ValueError("this is not a regular file")  # reading a FIFO may take forever
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_SIZE + 1)
        if len(data) > MAX_FILE_SIZE:
            raise ValueError(f"it has more than {MAX_FILE_SIZE} bytes")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        text = f"the file cannot be read ({reason}); expected a plan file"
        raise PlanError([Fault(path, 1, 1, text)]) from None
    return parse_plan(data, path)
