"""Run a node: initialisation, errors, signals, and the exit status."""

import inspect
import os
import signal
import sys
import textwrap
import threading
import time
import traceback
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Callable, ContextManager, List, NoReturn, Optional, Tuple, Type

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock
from rospy.client import load_command_line_node_params
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameter, Parameters, Table, Values, text
from mushr_ros_intro.ros import rospy_fixes
from mushr_ros_intro.ros.commands import as_typed
from mushr_ros_intro.ros.connections import is_alive, wait_until_connected
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER

SHUTDOWN_TIMEOUT = 14.0
"""Timeout for the end of a node [s]; roslaunch waits 15 s, a call to the master may take 5 s."""

SIGNAL_PERIOD = 0.1
"""Longest time until a signal is noticed [s]; mostly, it is noticed at once."""

_ends: "SimpleQueue[Tuple[str, Optional[int]]]" = SimpleQueue()
"""The reason for the end of the node, and the exit status if it is known."""

Log = Callable[..., None]


def main(
    name: str, node_class: Type[Any], *arguments: Any, is_replaceable: bool = True, **options: Any
) -> NoReturn:
    """Run a node, and end the process.

    The exit status is the number that `run` returns, or 0 if it returns None or is interrupted. It
    is 1 if the node failed, after the reason was logged.

    The node runs in its own thread, and the main thread waits for its end.

    Args:
        name: the node's name, unless the command line sets another.
        node_class: makes an object from the values of its PARAMETERS, a table, which are read
            before the node registers: the master then ends a node of the same name, which must not
            happen if a parameter is not valid. The method `run` returns when the node is done, and
            may raise rospy.ROSInterruptException if the node is shut down.
        arguments: more arguments of the class.
        is_replaceable: whether this node ends a running one of the same name, as is usual in ROS.
            Otherwise it ends itself.
        options: for rospy.init_node.
    """
    check_arguments(node_class)
    if not is_replaceable:
        _refuse_a_second_one(name)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: _ends.put((f"signal {number}", None)))
    values = init_node(name, node_class.PARAMETERS, disable_signals=True, **options)
    rospy.on_shutdown(lambda: _ends.put(("shut down", None)))
    run = partial(_run, lambda: node_class(values, *arguments))
    threading.Thread(target=run, daemon=True).start()
    reason, status = _wait_for_end()
    # In a thread, because rospy's shutdown may wait for ever for a lock that the node holds.
    threading.Thread(target=rospy.signal_shutdown, args=[reason], daemon=True).start()
    deadline = time.monotonic() + SHUTDOWN_TIMEOUT
    with suppress(Empty):
        while status is None:
            _, status = _ends.get(timeout=max(0.0, deadline - time.monotonic()))
    while not rospy.is_shutdown() and time.monotonic() < deadline:
        time.sleep(POLL_PERIOD)
    if status is None or not rospy.is_shutdown():
        print(f"{name}: the node did not end within {SHUTDOWN_TIMEOUT:g} s", file=sys.stderr)
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # not sys.exit, which waits for threads of rospy that may sleep for a minute


def _wait_for_end() -> Tuple[str, Optional[int]]:
    """Return what ends the node; the main thread alone runs Python's handlers of signals."""
    while True:
        with suppress(Empty):  # for a signal that came in another thread, or just before the wait
            return _ends.get(timeout=SIGNAL_PERIOD)


def full_name(name: str) -> str:
    """Return the name and namespace that this node is going to have."""
    name = rosgraph.names.load_mappings(sys.argv).get("__name", name)
    return str(rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(argv=sys.argv), name))


def _refuse_a_second_one(name: str) -> None:
    """Raise SystemExit if a node with the name that this one is going to have runs already."""
    name = full_name(name)
    with suppress(OSError):  # the master does not answer, which init_node reports
        if is_alive(name):
            expected = "end it first, or start this one with __name:=NAME"
            sys.exit(f"{name} is running already; {expected}")


def end_with_error(error: UserError) -> None:
    """End the node with exit status 1, from any thread."""
    _ends.put(("failed", _fail(str(error))))


def _run(start: Callable[[], Any]) -> None:
    """Run the node that `start` returns; if it fails, log the reason."""
    status = 1
    try:
        status = start().run() or 0
    except rospy.ROSInterruptException:
        status = 0
    except UserError as error:
        _fail(str(error))
    except (TimeoutError, ConnectionError) as error:
        _fail(f"the master does not answer: {error}")
    except Exception:
        # Topics that are closed during a shutdown raise various errors in rospy. It closes them
        # before is_shutdown() is true.
        if not rospy.core.is_shutdown_requested():
            rospy.logfatal("%s: %s", rospy.get_name(), traceback.format_exc())
        else:
            status = 0
    finally:
        _ends.put(("done", status))


def _fail(reason: str) -> int:
    """Log the reason of a failure, and return the exit status."""
    rospy.logfatal("%s: %s", rospy.get_name(), reason)
    return 1


def init_node(name: str, table: Optional[Table] = None, **options: Any) -> Values:
    """Initialise a node with working logs, timeouts for calls to the master, and a running clock.

    Those of its parameters that are not known are logged, and those that rosrun did not set.

    Args:
        name: the node's name, unless the command line sets another.
        table: the node's parameters; None: do not read them.
        options: for rospy.init_node.

    Returns:
        The values of the parameters.

    Raises:
        SystemExit: the master does not answer, or a parameter is not valid; the exception has a
            message for the user.
    """
    rospy_fixes.limit_calls()
    rospy_fixes.apply_before_init_node()
    uri = rosgraph.get_master_uri()
    no_master = (
        f"{name}: no master answers at ROS_MASTER_URI={uri}; expected "
        "one there (roscore or roslaunch starts one on this machine)"
    )
    values = Values()
    logs: List[Tuple[Log, str]] = []
    try:
        if not rosgraph.is_master_online():  # rospy prints a traceback or waits for ever
            sys.exit(no_master)
    except (ValueError, OSError):
        sys.exit(f"{name}: ROS_MASTER_URI is '{uri}'; expected an address such as {DEFAULT_MASTER}")
    try:
        if table is not None:
            values, logs = _read_parameters(full_name(name), table)
        rospy.init_node(name, **options)
    except (TimeoutError, ConnectionError):
        sys.exit(no_master)
    if not rospy.rostime.is_wallclock():
        # rospy may not connect its own subscription to /clock; a second subscription repairs this.
        clock = rospy.Subscriber("/clock", Clock)
        wait_until_connected(clock, "publishers")
        clock.unregister()
    for log, message in logs:
        log("%s", message)
    return values


def _read_parameters(name: str, table: Table) -> Tuple[Values, List[Tuple[Log, str]]]:
    """Return the values of the parameters that a node is going to have, and what to log.

    Raises:
        SystemExit: a parameter is not valid, or an argument such as plan_file:=... has the name of
            one.
    """
    given: Any = {}
    with suppress(rosgraph.MasterException):  # none is set
        given = rosgraph.Master(name).getParam(name)
    warnings: List[str] = []
    try:
        if not isinstance(given, dict):
            raise UserError(f"parameter {name} is {given!r}; expected the parameters of the node")
        known = {*given, *(each.name for each in table)}
        for argument in sys.argv[1:]:
            if argument.partition(":=")[0] in known:
                raise UserError(f"'{argument}' sets no parameter; expected _{argument}")
        typed = load_command_line_node_params(sys.argv)
        parameters = Parameters({**given, **typed})
        warnings = parameters.unknown(table)
        values = parameters.read(table)
    except UserError as error:
        sys.exit("\n".join([*(f"[WARN] {each}" for each in warnings), f"[FATAL] {name}: {error}"]))
    logs = [(rospy.logwarn, each) for each in warnings]
    left = given.keys() - typed
    if left and not any(each.startswith("__log:=") for each in sys.argv):  # as roslaunch adds it
        shown = ", ".join(f"{each}: {given[each]}" for each in sorted(left))
        shown = textwrap.shorten(shown, 300, placeholder=" ...")
        remedy = f"to delete them, type: rosparam delete {name}"
        message = f"parameters of an earlier run, or of rosparam: {shown}; {remedy}"
        logs.append((rospy.loginfo, message))
    return values, logs


def check_arguments(node_class: Type[Any], *known: str) -> None:
    """Answer --help, and refuse arguments that rospy would ignore, before the node registers.

    Args:
        node_class: see `main`; its docstring describes the topics.
        known: the beginnings of other arguments that the program accepts.

    Raises:
        SystemExit: there is such an argument.
    """
    program = os.path.basename(sys.argv[0])
    for each in sys.argv[1:]:
        if each in ("-h", "--help"):
            signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly if the output is cut off
            print(as_typed(f"{program}: {help_text(node_class)}"))
            sys.exit()
        is_remapping = ":=" in each and not each.startswith("-")
        if not is_remapping and not each.startswith(known):
            expected = "_PARAMETER:=VALUE, FROM:=TO for a topic, or --help"
            print(f"{program}: unknown argument '{each}'; expected {expected}", file=sys.stderr)
            sys.exit(2)


def help_text(node_class: Type[Any]) -> str:
    """Return the purpose, the topics and the parameters of a node.

    Args:
        node_class: see `main`. The first paragraph of its module's docstring is the purpose. The
            docstring of the class describes the topics, and ends with an example.
    """
    # Not of sys.modules: catkin's wrapper runs a program with exec, as a part of its own module.
    function = next(filter(inspect.isfunction, vars(node_class).values()))
    purpose = inspect.cleandoc(function.__globals__["__doc__"] or "").partition("\n\n")[0]
    topics = (inspect.getdoc(node_class) or "").replace("``", "").split("\n\n")[1:]
    how = "Parameters: _NAME:=VALUE on the command line, <param> in a launch file."
    paragraphs = [purpose, *(textwrap.fill(each, 100) for each in topics), how]
    return "\n".join(["\n\n".join(paragraphs), *(each.help() for each in node_class.PARAMETERS)])


def initial_pose_topic(car_name: str) -> str:
    """Return the topic on which sim.launch lets a car be placed."""
    return "/initialpose" if car_name == "car" else f"/{car_name}/initialpose"


def car_name(meaning: str) -> Parameter:
    """Declare the name of a car, without slashes."""
    read = text("car_name", "car", meaning)
    return read._replace(convert=lambda value: read.convert(value).strip("/"))


def init_pose_topic(meaning: str) -> Parameter:
    """Declare the topic of the initial pose; ~car_name precedes it in the table."""
    meaning += "; by default /initialpose, for another car than 'car' /CAR_NAME/initialpose"
    return text("init_pose_topic", lambda values: initial_pose_topic(values["car_name"]), meaning)


def offer_service(name: str, lock: ContextManager[Any], act: Callable[[], str]) -> None:
    """Offer a std_srvs/Trigger service.

    Args:
        name: of the service.
        lock: held while `act` runs.
        act: returns the message of the response, which is logged, too. A UserError that it raises
            becomes the message of a response without success.
    """

    def handle(_: TriggerRequest) -> TriggerResponse:
        try:
            with lock:
                message = act()
        except UserError as error:
            return TriggerResponse(False, str(error))
        rospy.loginfo("%s", message)
        return TriggerResponse(True, message)

    rospy.Service(name, Trigger, handle)
