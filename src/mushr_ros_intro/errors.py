"""Exceptions of the package, and what all messages to users need."""


class UserError(ValueError):
    """Bad input. The message is complete: it says where, what, and what was expected."""


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, such as 2 rows."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
