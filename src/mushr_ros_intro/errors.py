"""The error for bad input, and the programs that print it."""

import signal
import sys
from typing import Callable


class UserError(ValueError):
    """Bad input. The message is complete: it says where, what, and what was expected."""


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Run a program; return its exit status. After a UserError, this is 2, and it is printed."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly if the output is cut off
    try:
        return run()
    except UserError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 128 + signal.SIGINT  # as in a shell
