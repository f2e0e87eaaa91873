"""Exceptions of the package, and what all messages to users need."""

from enum import Enum

DEFAULT_MASTER = "http://localhost:11311"
"""The address of the master if ROS_MASTER_URI is not set."""


class UserError(ValueError):
    """Bad input. The message is complete: it says where, what, and what was expected."""


class CallFault(Enum):
    """Why a call to the master or to a node failed; the text is for a call to the master."""

    MALFORMED = f"expected is an address such as {DEFAULT_MASTER}"
    UNKNOWN_HOST = "its host name cannot be resolved"
    REFUSED = "no master runs there"
    NO_RESPONSE = "the master there does not respond"
    NOT_ROS = "the program there is not a ROS master"


class CallError(RuntimeError):
    """A call to the master or to a node failed."""

    def __init__(self, message: str, fault: CallFault = CallFault.REFUSED) -> None:
        super().__init__(message)
        self.fault = fault


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, such as 2 rows."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
