"""Start a node so that what it says is seen."""

import atexit
import gc
import os
import signal
import sys
import tempfile
import threading
from contextlib import suppress
from queue import SimpleQueue
from types import FrameType
from typing import Any, Optional

import rosgraph
import rospkg
import rospy
import rospy.impl.paramserver
import rospy.topics
from rosgraph_msgs.msg import Clock

from mushr_ros_intro.ros.connections import (
    PATIENCE,
    CallError,
    ask,
    limit_calls,
    wait_until_connected,
)

_LOG_PARAMETER = "/rosout_disable_topics_generation"
"""The parameter to which rospy subscribes with a node's first line of the log."""

_SHUTDOWN = 2.0
"""How long a node that is interrupted waits until it has signed off [s]."""


class _Server(rosgraph.xmlrpc.ThreadingXMLRPCServer):
    """The node's server for the master and other nodes, which ends when it is closed.

    rospy closes its socket and no more, and the server then asks that socket for requests, in a
    thread that takes a whole core for half a second, until the process has ended.
    """

    def service_actions(self) -> None:
        """Raise an error where the socket is closed; rospy expects one when it shuts down."""
        super().service_actions()
        if self.socket.fileno() < 0:
            raise OSError("the server is closed")


_close = rospy.topics._PublisherImpl.close


def _close_but_keep(topic: Any) -> None:
    """Close a topic that the node publishes, and leave it its lock and its buffer.

    rospy takes them away; who was interrupted in publish by the signal that shut the node down
    looks for them then, and would end with an AttributeError.
    """
    lock, buffer = topic.publock, topic.buff
    _close(topic)
    topic.publock, topic.buff = lock, buffer


def init_node(name: str, **options: Any) -> None:
    """Start the node of this process as rospy.init_node does, and see to it that it has a time.

    No call to the master takes this process longer than connections.PATIENCE from then on.

    Args:
        name: the node's name, unless the command line gives it another.
        options: of rospy.init_node, but for disable_signals.

    Raises:
        SystemExit: no master answers, and it carries the message for the terminal; or a signal has
            ended the node.
    """
    # What has been imported stays: that the collector passes over it takes 0.05 s off a node's end.
    gc.freeze()
    limit_calls()
    no_master = (
        f"{name}: no master answers at ROS_MASTER_URI={rosgraph.get_master_uri()}; expected "
        "one there (roscore or roslaunch starts one on this machine)"
    )
    # rospy would end with a traceback, or where signals are disabled not at all.
    try:
        is_there = rosgraph.is_master_online()
    except ValueError:
        is_there = False
    if not is_there:
        sys.exit(no_master)
    _find_log_folder()
    rosgraph.xmlrpc.ThreadingXMLRPCServer = _Server
    rospy.topics._PublisherImpl.close = _close_but_keep
    _handle_signals()
    try:
        rospy.init_node(name, disable_signals=True, **options)
    except (TimeoutError, ConnectionError):
        sys.exit(no_master)
    except rospy.ROSInitException:
        if not rospy.is_shutdown():
            raise
        sys.exit(0)
    _sign_off_wholly()
    if not rospy.rostime.is_wallclock():
        # Connected with rospy's own subscription, without which there would be no time at all.
        clock = rospy.Subscriber("/clock", Clock)
        wait_until_connected(clock, "publishers")
        clock.unregister()


def _handle_signals() -> None:
    """Shut the node down at SIGINT and SIGTERM, in a thread of its own.

    rospy does so within the signal's handler. Where the signal interrupts a call to the master,
    that call waits for the handler, and the handler's own, to sign off, for that call: for ever.
    """
    asked: SimpleQueue[int] = SimpleQueue()  # which a handler may put into at any moment

    def shut_down() -> None:
        rospy.signal_shutdown(f"signal-{asked.get()}")

    worker = threading.Thread(target=shut_down, daemon=True)
    worker.start()

    def handle(number: int, _: Optional[FrameType]) -> None:
        asked.put(number)
        # As with rospy, nothing is done meanwhile: who publishes on a closed topic gets an error.
        worker.join(_SHUTDOWN)
        if worker.is_alive():
            # It needs a lock of the interrupted thread's, which may keep it until the node ends.
            rospy.core._shutdown_flag = True
            atexit.register(worker.join, _SHUTDOWN)

    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, handle)


def _sign_off_wholly() -> None:
    """Have the node unsubscribe, as it is shut down, from the parameter that its log looks at.

    rospy leaves that out, and the master keeps the name and where the node listened. It shuts down
    who listens there when the next node of that name comes: maybe another node by then.
    """
    arguments = (rospy.get_name(), "unsubscribeParam", rospy.get_node_uri(), _LOG_PARAMETER)
    asked = threading.Event()

    def unsubscribe() -> None:
        asked.wait()
        with suppress(CallError):
            ask(rosgraph.get_master_uri(), PATIENCE, *arguments)

    def begin() -> None:
        # What is logged from now on does not subscribe again.
        rospy.impl.paramserver.get_param_server_cache().set(_LOG_PARAMETER, False)
        asked.set()

    # Beside rospy's own signing off: where the master is silent each takes its time.
    thread = threading.Thread(target=unsubscribe, daemon=True)
    thread.start()
    rospy.on_shutdown(begin)
    rospy.core.add_preshutdown_hook(lambda _: thread.join(PATIENCE))


def _find_log_folder() -> None:
    """Have rospy log into the temporary folder where it cannot write into its own.

    Otherwise it would say nothing, not even on the terminal: where a home is read-only or full,
    nobody would hear why a node has ended.
    """
    folder = rospkg.get_log_dir()
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError:
        other = os.path.join(tempfile.gettempdir(), f"ros_log_{os.getuid()}")
        os.environ[rospkg.environment.ROS_LOG_DIR] = other
