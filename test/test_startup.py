"""How a node starts where it cannot log, and where there is no master; and that it ends."""

import os
import threading
from unittest import mock

import pytest
import rosgraph.xmlrpc
import rospy
from rosgraph.xmlrpc import ThreadingXMLRPCServer, XmlRpcNode

from helpers import module, node, wait_for
from mushr_ros_intro.startup import _find_log_folder, init_node


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
    monkeypatch.setattr("mushr_ros_intro.startup.limit_calls", lambda: None)  # which stays
    monkeypatch.setattr("rosgraph.is_master_online", lambda: True)
    monkeypatch.setattr("rospy.init_node", mock.Mock(side_effect=TimeoutError))
    with pytest.raises(SystemExit, match="made: no master answers at ROS_MASTER_URI="):
        init_node("made")


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
    monkeypatch.setattr("mushr_ros_intro.startup.limit_calls", lambda: None)  # which stays
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
