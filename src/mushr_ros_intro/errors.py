"""The error for bad input."""


class UserError(ValueError):
    """Bad input. The message is complete: it says where, what, and what was expected."""
