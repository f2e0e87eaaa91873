"""The base class of all errors that a user can cause and mend."""


class UserError(ValueError):
    """Bad input. The message is complete: it says where, what, and what was expected."""
