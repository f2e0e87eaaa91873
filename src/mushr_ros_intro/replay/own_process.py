"""Call a function in a process of its own, in which ROS can be initialised."""

import contextlib
import ctypes
import multiprocessing
import multiprocessing.popen_forkserver  # threads that first import it together may fail
import os
import resource
import signal
import sys
import traceback
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any, Callable, Tuple, TypeVar

from mushr_ros_intro.errors import UserError

T = TypeVar("T")

INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
"""Signals that interrupt grading."""

MAX_MEMORY = 2_000_000_000
"""Limit on the memory of a replay's own process, which receives what a node sends [bytes]."""

_PR_SET_PDEATHSIG = 1
"""See prctl(2): the signal to this process if the parent process dies."""


class ReplayError(UserError):
    """A replay has no verdict."""


class KilledError(ReplayError):
    """The process of a replay was killed, or has run out of memory."""


def prepared_processes() -> multiprocessing.context.ForkServerContext:
    """Return the context of processes that are forks of one prepared process.

    They have the modules already, and no state of another replay.
    """
    # The namespace of the simulated car, which rospy reads when the prepared process imports it.
    os.environ["ROS_NAMESPACE"] = "/car"
    context = multiprocessing.get_context("forkserver")
    # The list is a copy, because another thread may import a module.
    modules = [name for name in list(sys.modules) if name.startswith("mushr_ros_intro.")]
    context.set_forkserver_preload(modules)
    return context


def in_own_process(function: Callable[..., T], *arguments: Any, seconds: float) -> T:
    """Call a function in a new process, which ends together with this one; return its result.

    Args:
        function: the function; it may start processes of a submission in a sandbox.
        arguments: of the function.
        seconds: timeout [s of wall-clock time].

    Raises:
        KilledError: the process died.
        ReplayError: the function failed, or did not return in time.
    """
    context = prepared_processes()
    receiver, sender = context.Pipe(duplex=False)
    call = (function, arguments, sender)
    process = context.Process(target=_call_and_send, args=call, daemon=True)
    error = f"its process did not end within {seconds:g} s"
    resource_tracker.ensure_running()  # otherwise, `start` begins with this, which unblocks signals
    try:
        # An interrupt now would end the prepared process while it starts, with a traceback.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, INTERRUPTS)
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        sender.close()
        if receiver.poll(seconds):
            result, error = receiver.recv()
            if not error:
                return result
    except EOFError:
        reason = "its process was killed, or has run out of memory (try --jobs 1)"
        raise KilledError(f"the replay failed: {reason}") from None
    finally:
        if process.pid:
            process.kill()
            process.join()
    raise ReplayError(f"the replay failed: {error}")


def _call_and_send(
    function: Callable[..., Any], arguments: Tuple[Any, ...], sender: Connection
) -> None:
    """Call a function; send its result, and the description of an error or an empty text."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
    # The parent process ends this one. SIG_IGN, and the mask, would also hold for the node.
    signal.signal(signal.SIGINT, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, INTERRUPTS)
    with open(os.devnull, "r+b") as null:
        for number in (0, 1, 2):
            os.dup2(null.fileno(), number)
    result, fault = None, ""
    try:
        result = function(*arguments)
    except (UserError, OSError) as error:
        fault = str(error)
    except MemoryError:
        os._exit(1)
    except Exception:
        fault = traceback.format_exc()
    with contextlib.suppress(OSError):  # the parent process has died
        sender.send((result, fault))
    os._exit(0)  # without waiting for the threads of rospy
