"""Run a node: initialisation, errors, signals, and the exit status."""

import inspect
import os
import signal
import sys
import textwrap
import threading
import time
import traceback
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any, Callable, ContextManager, Iterator, List, NoReturn, Optional, Tuple

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock
from rospy.client import load_command_line_node_params
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Description, Parameters
from mushr_ros_intro.ros import rospy_fixes
from mushr_ros_intro.ros.connections import is_alive, wait_until_connected
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER

SHUTDOWN_TIMEOUT = 14.0
"""Timeout for the end of a node [s]; roslaunch waits 15 s, a call to the master may take 5 s."""

_ends: "SimpleQueue[Tuple[str, Optional[int]]]" = SimpleQueue()
"""The reason for the end of the node, and the exit status if it is known."""


_declarations: Optional[Parameters] = None
"""What the node declares, while its parameters are described or checked before it registers."""


class _DeclaredError(Exception):
    """The end of the declarations of a node that has not registered."""


def main(
    name: str, node_class: Callable[[], Any], is_replaceable: bool = True, **options: Any
) -> NoReturn:
    """Run a node, and end the process.

    The exit status is the number that `run` returns, or 0 if it returns None or is interrupted. It
    is 1 if the node failed, after the reason was logged.

    The node runs in its own thread, and the main thread waits for its end.

    Args:
        name: the node's name, unless the command line sets another.
        node_class: returns an object with a method `run`. `run` returns when the node is done, and
            may raise rospy.ROSInterruptException if the node is shut down. The object begins with a
            block `parameters`, which is also executed before the node registers: the master then
            ends a node of the same name, which must not happen if a parameter is not valid.
        is_replaceable: whether this node ends a running one of the same name, as is usual in ROS.
            Otherwise it ends itself.
        options: for rospy.init_node.
    """
    check_arguments(node_class)
    if not is_replaceable:
        _refuse_a_second_one(name)
    _handle_signals()
    init_node(name, node_class, disable_signals=True, **options)
    rospy.on_shutdown(lambda: _ends.put(("shut down", None)))
    threading.Thread(target=_run, args=[node_class], daemon=True).start()
    reason, status = _ends.get()
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


def _handle_signals() -> None:
    """End the node at SIGINT and SIGTERM.

    A thread reads the number of the signal. Python runs a handler in the main thread only, which
    does not notice a signal that comes just before it waits, or in another thread.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def read() -> None:
        (number,) = os.read(reader, 1)
        _ends.put((f"signal {number}", None))

    threading.Thread(target=read, daemon=True).start()


def _full_name(name: str) -> str:
    """Return the name and namespace that this node is going to have."""
    name = rosgraph.names.load_mappings(sys.argv).get("__name", name)
    return str(rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(argv=sys.argv), name))


def _refuse_a_second_one(name: str) -> None:
    """Raise SystemExit if a node with the name that this one is going to have runs already."""
    name = _full_name(name)
    with suppress(OSError):  # the master does not answer, which init_node reports
        if is_alive(name):
            expected = "end it first, or start this one with __name:=NAME"
            sys.exit(f"{name} is running already; {expected}")


def end_with_error(error: UserError) -> None:
    """End the node with exit status 1, from any thread."""
    _ends.put(("failed", _fail(str(error))))


def _run(node_class: Callable[[], Any]) -> None:
    """Run a node; if it fails, log the reason."""
    status = 1
    try:
        status = node_class().run() or 0
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


def init_node(name: str, node_class: Optional[Callable[[], Any]] = None, **options: Any) -> None:
    """Initialise a node with working logs, timeouts for calls to the master, and a running clock.

    Args:
        name: the node's name, unless the command line sets another.
        node_class: see `main`; None: do not check the parameters.
        options: for rospy.init_node.

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
    try:
        if not rosgraph.is_master_online():  # rospy prints a traceback or waits for ever
            sys.exit(no_master)
    except (ValueError, OSError):
        sys.exit(f"{name}: ROS_MASTER_URI is '{uri}'; expected an address such as {DEFAULT_MASTER}")
    if node_class:
        _check_parameters(_full_name(name), node_class)
    try:
        rospy.init_node(name, **options)
    except (TimeoutError, ConnectionError):
        sys.exit(no_master)
    rospy_fixes.end_at_once()
    if not rospy.rostime.is_wallclock():
        # rospy may not connect its own subscription to /clock; a second subscription repairs this.
        clock = rospy.Subscriber("/clock", Clock)
        wait_until_connected(clock, "publishers")
        clock.unregister()


def _check_parameters(name: str, node_class: Callable[[], Any]) -> None:
    """Raise SystemExit if a parameter that the node `name` is going to have is not valid."""
    values: Any = {}
    with suppress(rosgraph.MasterException, OSError):  # none is set
        values = rosgraph.Master(name).getParam(name)
    warnings: List[str] = []
    try:
        read = _own_parameters(name, values)
        read = read.with_values(**load_command_line_node_params(sys.argv))
        read.declared.update(_declare(node_class, Description()).declared)
        warnings = read.unknown()
        _declare(node_class, read)
    except UserError as error:
        sys.exit("\n".join([*(f"[WARN] {each}" for each in warnings), f"[FATAL] {name}: {error}"]))


def check_arguments(node_class: Callable[[], Any], *known: str) -> None:
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
            print(f"{program}: {help_text(node_class)}")
            sys.exit()
        is_remapping = ":=" in each and not each.startswith("-")
        if not is_remapping and not each.startswith(known):
            expected = "_PARAMETER:=VALUE, FROM:=TO for a topic, or --help"
            print(f"{program}: unknown argument '{each}'; expected {expected}", file=sys.stderr)
            sys.exit(2)


def help_text(node_class: Callable[[], Any]) -> str:
    """Return the purpose, the topics and the parameters of a node.

    Args:
        node_class: see `main`. The first paragraph of its module's docstring is the purpose. The
            docstring of the class describes the topics, and ends with an example.
    """
    declared = _declare(node_class, Description()).declared
    # Not of sys.modules: catkin's wrapper runs a program with exec, as a part of its own module.
    function = node_class if inspect.isfunction(node_class) else vars(node_class)["__init__"]
    purpose = inspect.cleandoc(function.__globals__["__doc__"] or "").partition("\n\n")[0]
    topics = (inspect.getdoc(node_class) or "").replace("``", "").split("\n\n")[1:]
    how = "Parameters: _NAME:=VALUE on the command line, <param> in a launch file."
    paragraphs = [purpose, *(textwrap.fill(each, 100) for each in topics), how]
    lines = [each.text(name) for name, each in declared.items()]
    return "\n".join(["\n\n".join(paragraphs), *lines])


def _declare(node_class: Callable[[], Any], given: Parameters) -> Parameters:
    """Execute the declarations of a node with the parameters `given`, and return them."""
    global _declarations
    _declarations = given
    try:
        with suppress(_DeclaredError):
            node_class()
    finally:
        _declarations = None
    return given


@contextmanager
def parameters(name: str = "~") -> Iterator[Parameters]:
    """Give the parameters of this node to a block, which reads them and does nothing else.

    Those that the block does not read are logged, and those that rosrun did not set.

    Args:
        name: of the node; by default this one.

    Raises:
        UserError: an argument such as plan_file:=... has the name of a parameter of an earlier run.
    """
    if _declarations is not None:
        yield _declarations
        raise _DeclaredError
    values = rospy.get_param(name, {})
    read = _own_parameters(name, values)
    yield read
    for message in read.unknown():
        rospy.logwarn("%s", message)
    left = values.keys() - load_command_line_node_params(sys.argv)
    if left and not any(each.startswith("__log:=") for each in sys.argv):  # as roslaunch adds it
        shown = ", ".join(f"{each}: {values[each]}" for each in sorted(left))
        shown = textwrap.shorten(shown, 300, placeholder=" ...")
        remedy = f"to delete them, type: rosparam delete {rospy.get_name()}"
        rospy.loginfo("parameters of an earlier run, or of rosparam: %s; %s", shown, remedy)


def _own_parameters(name: str, values: Any) -> Parameters:
    """Return the parameters of a node from their values at the master; see `parameters`."""
    if not isinstance(values, dict):
        raise UserError(f"parameter {name} is {values!r}; expected the parameters of the node")
    for argument in sys.argv[1:]:
        if argument.partition(":=")[0] in values:
            raise UserError(f"'{argument}' sets no parameter; expected _{argument}")
    return Parameters(values)


def initial_pose_topic(car_name: str) -> str:
    """Return the topic on which sim.launch lets a car be placed."""
    return "/initialpose" if car_name == "car" else f"/{car_name}/initialpose"


def frame_prefix(read: Parameters) -> str:
    """Return the prefix of the frames of this node's car, by default the name of its namespace."""
    namespace = rospy.get_namespace().strip("/")
    default = f"{namespace}/" if namespace else ""
    return read.any_text("frame_prefix", default, "CAR_NAME/", "precedes the names of the frames")


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
