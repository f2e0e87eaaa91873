"""How a node starts where it cannot log, and where there is no master; and that it ends."""

import os
import signal
import socket
import sys
import threading
from unittest import mock

import pytest
import rosgraph.xmlrpc
import rospy
from rosgraph.xmlrpc import ThreadingXMLRPCServer, XmlRpcNode

from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.ros.node import _find_log_folder, init_node
from support.helpers import Process, module, node, wait_for

IN_A_CALL = """
import time, xmlrpc.client, rospy
from mushr_ros_intro.ros.node import init_node

init_node("made")
request = xmlrpc.client.Transport.single_request

def slow_request(*arguments, **options):
    xmlrpc.client.Transport.single_request = request
    print("calls the master", flush=True)
    time.sleep(1.0)
    return request(*arguments, **options)

xmlrpc.client.Transport.single_request = slow_request
rospy.get_param("/nothing", None)
rospy.spin()
"""
"""A node that makes one call to the master that takes its time."""

PUBLISHES = """
import time, rospy
from mushr_ros_intro.ros.node import init_node
from std_msgs.msg import String

init_node("made")
publisher = rospy.Publisher("/text", String, queue_size=1, latch=True)
rospy.core.add_preshutdown_hook(lambda _: time.sleep(0.3))
print("publishes", flush=True)
while not rospy.is_shutdown():
    publisher.publish("text")
"""
"""A node that publishes all the time, also on a topic that is closed as it is shut down."""

INTERRUPTED = """
import linecache, os, signal, sys, time, rospy
from mushr_ros_intro.ros.node import init_node
from std_msgs.msg import String

def interrupt(frame, event, _):
    where = frame.f_code.co_filename
    if event == "line" and "topics" in where:
        if linecache.getline(where, frame.f_lineno).strip() == sys.argv[1]:
            sys.settrace(None)
            os.kill(os.getpid(), signal.SIGINT)
    return interrupt

init_node("made")
publisher = rospy.Publisher("/text", String, queue_size=1)
rospy.Subscriber("/text", String)
while not publisher.get_num_connections():
    time.sleep(0.01)
sys.settrace(interrupt)
publisher.publish("text")
print(rospy.is_shutdown())
"""
"""A node that a signal interrupts before it comes to a given line of rospy's."""

REGISTERS = """
import time, rospy
from mushr_ros_intro.ros.node import init_node

init_node("made")
with rospy.topics.get_topic_manager().lock:
    print("registers", flush=True)
    while not rospy.is_shutdown():
        time.sleep(0.01)
"""
"""What rospy does where the master ends as a node tells it of a topic."""

LOGS = """
import rospy
from mushr_ros_intro.ros.node import init_node

init_node("made")
rospy.loginfo("a line")
print("has logged", flush=True)
rospy.spin()
rospy.loginfo("the last line")
"""
"""A node that also logs when it has signed off."""

PROGRAMS = {"calls the master": IN_A_CALL, "publishes": PUBLISHES, "registers": REGISTERS}


@pytest.fixture(scope="module")
def master():
    """Start a master; return where it is."""
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    uri = f"http://localhost:{port}"
    with Process("rosmaster", "--core", "-p", str(port), ROS_MASTER_URI=uri):
        made = rosgraph.Master("/test_startup", uri)
        wait_for(made.is_online, "the master")
        yield uri


@pytest.mark.parametrize("home, is_good", [("ros", True), ("file/ros", False)])
def test_log_folder(tmp_path, monkeypatch, home, is_good):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ROS_HOME", str(tmp_path / home))
    monkeypatch.setenv("ROS_LOG_DIR", "")  # put back after the test, whatever it becomes
    monkeypatch.delenv("ROS_LOG_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    _find_log_folder()
    other = str(tmp_path / f"ros_log_{os.getuid()}")
    assert os.environ.get("ROS_LOG_DIR") == (None if is_good else other)
    assert os.path.isdir(str(tmp_path / "ros" / "log")) == is_good


@pytest.mark.parametrize("master", ["http://localhost:1", "localhost"])
@pytest.mark.parametrize("name", ["path_publisher.py", "car_sim.py", "keyboard_teleop.py"])
def test_without_a_master_a_node_says_so(name, master):
    with node(name, "_plan_file:=circle", ROS_MASTER_URI=master) as process:
        assert process.wait() == 1, process.output
    assert "Traceback" not in process.output
    said = f"{name[:-3]}: no master answers at ROS_MASTER_URI={master}; expected one there"
    assert process.output.startswith(said)


@pytest.mark.parametrize("where", ["__init__", "run"])
def test_where_the_master_is_silent_meanwhile_the_plan_is_given_up(monkeypatch, where):
    made = module("path_publisher.py")
    said = []
    for name in ("__init__", "run", "stop"):
        monkeypatch.setattr(made.PathPublisher, name, lambda _: None)
    monkeypatch.setattr(made.PathPublisher, where, mock.Mock(side_effect=TimeoutError("5 s")))
    monkeypatch.setattr(made, "init_node", lambda _: None)
    monkeypatch.setattr("rospy.logfatal", lambda text, *arguments: said.append(text % arguments))
    assert made.main() == 1
    assert said == ["/unnamed: the master does not answer, and the plan is given up: 5 s"]


def test_where_the_master_is_silent_meanwhile_no_node_starts(monkeypatch):
    monkeypatch.setattr("mushr_ros_intro.ros.node.limit_calls", lambda: None)  # these stay
    monkeypatch.setattr("mushr_ros_intro.ros.node._handle_signals", lambda: None)
    monkeypatch.setattr("rosgraph.is_master_online", lambda: True)
    monkeypatch.setattr("rospy.init_node", mock.Mock(side_effect=TimeoutError))
    with pytest.raises(SystemExit, match="made: no master answers at ROS_MASTER_URI="):
        init_node("made")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("says", PROGRAMS)
def test_a_signal_ends_a_node_whatever_it_does(master, number, says):
    with Process(sys.executable, "-c", PROGRAMS[says], ROS_MASTER_URI=master) as process:
        wait_for(lambda: says in process.output, says)
        assert "/made" in str(rosgraph.Master("/test_startup", master).getSystemState())
        process.send_signal(number)
        assert process.wait() == 0, process.output
    assert process.output == f"{says}\n"
    assert "/made" not in str(rosgraph.Master("/test_startup", master).getSystemState())


@pytest.mark.parametrize(
    "line", ["self.publock.acquire()", "b = self.buff", "b.tell()", "self.publock.release()"]
)
def test_a_signal_interrupts_a_publisher(master, line):
    """Where rospy would look for what it has just taken away."""
    with Process(sys.executable, "-c", INTERRUPTED, line, ROS_MASTER_URI=master) as process:
        assert process.wait() == 0, process.output
    assert process.output == "True\n"


def test_a_node_signs_off_wholly(master):
    """Whatever it logs; who comes next with its name has nobody shut down."""
    seen = rosgraph.Master("/test_startup", master)
    with Process(sys.executable, "-c", LOGS, ROS_MASTER_URI=master) as process:
        wait_for(lambda: "has logged" in process.output, "a line")
        assert seen.lookupNode("/made")
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0, process.output
    assert "the last line" in process.output and "Traceback" not in process.output
    with pytest.raises(rosgraph.MasterError, match="unknown node"):
        seen.lookupNode("/made")


def test_a_signal_ends_a_node_that_starts(monkeypatch):
    """Without a traceback; rospy says by an exception that it was interrupted."""
    monkeypatch.setattr("mushr_ros_intro.ros.node.limit_calls", lambda: None)  # these stay
    monkeypatch.setattr("mushr_ros_intro.ros.node._handle_signals", lambda: None)
    monkeypatch.setattr("rosgraph.is_master_online", lambda: True)
    monkeypatch.setattr("rospy.init_node", mock.Mock(side_effect=rospy.ROSInitException))
    with pytest.raises(rospy.ROSInitException):
        init_node("made")
    monkeypatch.setattr("rospy.is_shutdown", lambda: True)
    with pytest.raises(SystemExit) as ended:
        init_node("made")
    assert ended.value.code == 0


def test_a_node_that_is_shut_down_waits_for_no_connection(monkeypatch):
    monkeypatch.setattr("mushr_ros_intro.ros.connections.registered_nodes", lambda *_: ["/other"])
    monkeypatch.setattr("time.sleep", mock.Mock(side_effect=AssertionError("it waits")))
    monkeypatch.setattr("rospy.is_shutdown", lambda: True)
    assert not wait_until_connected(
        mock.Mock(**{"get_num_connections.return_value": 0}), "subscribers"
    )


def test_path_publisher_signs_off_before_it_ends(monkeypatch):
    """The master has it shut down, which another thread does."""
    made = module("path_publisher.py")
    for name in ("__init__", "stop"):
        monkeypatch.setattr(made.PathPublisher, name, lambda _: None)
    interrupted = mock.Mock(side_effect=rospy.ROSInterruptException)
    monkeypatch.setattr(made.PathPublisher, "run", interrupted)
    monkeypatch.setattr(made, "init_node", lambda _: None)
    monkeypatch.setattr("rospy.core.is_shutdown_requested", lambda: True)
    is_signed_off = threading.Event()
    monkeypatch.setattr("rospy.is_shutdown", is_signed_off.is_set)
    main = threading.Thread(target=made.main, daemon=True)
    main.start()
    main.join(0.3)
    assert main.is_alive()
    is_signed_off.set()
    main.join(5.0)
    assert not main.is_alive()


def test_the_server_of_a_node_ends_with_it(monkeypatch):
    monkeypatch.setattr(rosgraph.xmlrpc, "ThreadingXMLRPCServer", ThreadingXMLRPCServer)
    nodes = []
    monkeypatch.setattr("mushr_ros_intro.ros.node.limit_calls", lambda: None)  # these stay
    monkeypatch.setattr("mushr_ros_intro.ros.node._handle_signals", lambda: None)
    monkeypatch.setattr("mushr_ros_intro.ros.node._sign_off_wholly", lambda: None)
    monkeypatch.setattr("rosgraph.is_master_online", lambda: True)
    monkeypatch.setattr("rospy.init_node", lambda *_, **__: nodes.append(XmlRpcNode()))
    monkeypatch.setattr("rospy.rostime.is_wallclock", lambda: True)
    init_node("made")
    thread = threading.Thread(target=nodes[0].run, daemon=True)
    thread.start()
    wait_for(lambda: nodes[0].uri, "the server")
    nodes[0].shutdown("as rospy does")
    thread.join(10.0)
    assert not thread.is_alive()
