"""Test how a node starts, fails, is interrupted, and ends."""

import contextlib
import os
import signal
import tempfile

import pytest
import rosgraph

from support.helpers import ForkedProcess, free_port, node, wait_for

PREAMBLE = """
import linecache, os, signal, sys, threading, time, xmlrpc.client
import rospy
from std_msgs.msg import String
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.ros import node, xmlrpc_client

class Made:
    PARAMETERS = ()

    def __init__(self, values):
        rospy.on_shutdown(lambda: print("stops", flush=True))

"""

PROGRAMS = {
    # A node that calls the master again and again.
    "calls": """
    xmlrpc_client.LimitedTransport.timeout = 0.5  # [s] instead of 5 s

    def run(self):
        print("calls", flush=True)
        while not rospy.is_shutdown():
            rospy.get_param("/nothing", None)
""",
    # A node that publishes all the time, also on a topic that is closed as it is shut down.
    "publishes": """
    def run(self):
        publisher = rospy.Publisher("/text", String, queue_size=1, latch=True)
        failed = threading.Event()
        rospy.core.add_preshutdown_hook(lambda _: failed.wait(10.0))  # the topic is closed already
        print("publishes", flush=True)
        try:
            while not rospy.is_shutdown():
                publisher.publish("text")
        finally:
            failed.set()
""",
    "waits": """
    def run(self):
        print("waits", flush=True)
        rospy.spin()
""",
    # A node with a thread that does not end, such as rospy's while it waits for another connection.
    "threads": """
    def run(self):
        threading.Thread(target=time.sleep, args=[300.0], daemon=False).start()
        print("threads", flush=True)
        rospy.spin()
""",
    "logs": """
    def run(self):
        rospy.loginfo("logs")
        rospy.spin()
        rospy.loginfo("the last line")
""",
}

ENDS = {
    "returns": ("        pass", 0, ""),
    "returns a status": ("        return 3", 3, ""),
    "is interrupted in another thread": (
        # The sleep lets the main thread wait; it does not see this signal.
        "        time.sleep(0.1)\n"
        "        signal.pthread_kill(threading.get_ident(), signal.SIGINT)\n"
        "        rospy.spin()",
        0,
        "",
    ),
    "raises a UserError": ("        raise UserError('plan.txt:1:1: wrong')", 1, "wrong"),
    "raises another error": ("        {}['key']", 1, "KeyError: 'key'"),
    "loses the master": ("        raise TimeoutError('no answer')", 1, "master does not answer"),
    "ends with an error": (
        "        node.end_with_error(UserError('gone'))\n        rospy.spin()",
        1,
        "gone",
    ),
}


@contextlib.contextmanager
def running_master():
    """Start a master; yield its process and its address."""
    port = free_port()
    uri = f"http://localhost:{port}"
    with ForkedProcess("rosmaster", "--core", "-p", str(port), ROS_MASTER_URI=uri) as process:
        wait_for(rosgraph.Master("/test_node", uri).is_online, "the master")
        yield process, uri


@pytest.fixture(scope="module")
def master():
    """Start a master; return its address."""
    with running_master() as (_, uri):
        yield uri


@contextlib.contextmanager
def start(run, master, options="", **environment):
    """Run a node with a method run; yield its process. `options` are more arguments of main."""
    with tempfile.NamedTemporaryFile("w", suffix=".py") as file:
        file.write(f"{PREAMBLE}{run}\nnode.main('made', Made{options})")
        file.flush()
        with ForkedProcess(file.name, ROS_MASTER_URI=master, **environment) as process:
            yield process


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_signal_ends_a_node(master, name):
    """It also unregisters the node, or the master would shut down another at its address."""
    seen = rosgraph.Master("/test_node", master)
    number = signal.SIGINT if name in ("calls", "waits") else signal.SIGTERM
    with start(PROGRAMS[name], master) as process:
        wait_for(lambda: name in process.output, name)
        assert "/made" in str(seen.getSystemState())
        process.send_signal(number)
        assert process.wait() == 0, process.output
    assert "stops" in process.output and "Traceback" not in process.output
    assert "/made" not in str(seen.getSystemState())
    with pytest.raises(rosgraph.MasterError, match="unknown node"):
        seen.lookupNode("/made")


def test_the_master_ends_a_node(master):
    with start(PROGRAMS["waits"], master) as process:
        wait_for(lambda: "waits" in process.output, "the node")
        with start(PROGRAMS["waits"], master) as namesake:
            assert process.wait() == 0, process.output
            namesake.end()
    assert "stops" in process.output and "Traceback" not in process.output


def test_a_node_that_must_not_be_replaced(master):
    """Otherwise, two browser views end each other. It may be suspended."""
    options = ", is_replaceable=False"
    with start(PROGRAMS["waits"], master, options, ROS_NAMESPACE="/car2") as process:
        wait_for(lambda: "waits" in process.output, "the node")
        for number in (signal.SIGCONT, signal.SIGSTOP):
            process.send_signal(number)
            with start(PROGRAMS["waits"], master, options, ROS_NAMESPACE="/car2") as namesake:
                assert namesake.wait() == 1, namesake.output
            expected = "/car2/made is running already; end it first, or start this one with "
            assert namesake.output == expected + "__name:=NAME\n"
        process.send_signal(signal.SIGCONT)
        assert process.running


@pytest.mark.parametrize("name", ENDS)
def test_exit_status(master, name):
    run, status, message = ENDS[name]
    with start(f"    def run(self):\n{run}", master) as process:
        assert process.wait() == status, process.output
    assert message in process.output and "stops" in process.output
    assert ("Traceback" in process.output) == (name == "raises another error")


def test_nodes_that_do_not_end_are_ended(master):
    """One sleeps; one does what rospy does if the master ends while a node registers a topic."""
    sleep = "time.sleep(60.0)"
    locked = "rospy.topics.get_topic_manager().lock.acquire()\n        rospy.spin()"
    run = """
    def run(self):
        node.SHUTDOWN_TIMEOUT = 1.0
        print('runs', flush=True)
        """
    with running_master() as (_, uri), contextlib.ExitStack() as stack:
        programs = ((run + sleep, master), (run + locked, uri))
        started = [stack.enter_context(start(*each)) for each in programs]
        for process in started:
            wait_for(lambda p=process: "runs" in p.output, "the node")
            process.send_signal(signal.SIGINT)
        for process in started:
            assert process.wait() == 1, process.output
            assert "made: the node did not end within 1 s" in process.output


NO_MASTER = "no master answers at ROS_MASTER_URI=http://localhost:1; expected one there"


@pytest.mark.parametrize(
    "name, address, message",
    [
        ("path_publisher.py", "http://localhost:1", NO_MASTER),
        ("car_sim.py", "localhost:11311", "ROS_MASTER_URI is 'localhost:11311'; expected an addr"),
        ("map_server.py", "ftp://localhost:1", "ROS_MASTER_URI is 'ftp://localhost:1'; expected a"),
        ("keyboard_teleop.py", "http://localhost:1", NO_MASTER),
    ],
)
def test_without_a_master_a_node_fails(name, address, message):
    with node(name, "_plan_file:=circle", ROS_MASTER_URI=address) as process:
        assert process.wait() == 1, process.output
    assert "Traceback" not in process.output
    assert process.output.startswith(f"{name[:-3]}: {message}")


def test_a_node_logs_if_its_home_cannot_be_written(master, tmp_path):
    (tmp_path / "file").write_text("in the way")
    folders = {"ROS_HOME": str(tmp_path / "file" / "ros"), "TMPDIR": str(tmp_path)}
    with start(PROGRAMS["logs"], master, **folders, ROS_LOG_DIR="") as process:
        wait_for(lambda: "logs" in process.output, "a line on the terminal")
        process.send_signal(signal.SIGINT)
        assert process.wait() == 0, process.output
    assert os.listdir(tmp_path / f"ros_log_{os.getuid()}")


def test_a_node_leaves_the_link_to_the_latest_log_to_roslaunch(master, tmp_path):
    (tmp_path / "latest").symlink_to("elsewhere")
    environment = {"ROS_MASTER_URI": master, "ROS_LOG_DIR": str(tmp_path)}
    with node("map_server.py", f"__log:={tmp_path}/run/a.log", **environment) as process:
        assert process.wait() == 1
    assert "parameter ~map_file is not set" in process.output
    assert os.readlink(str(tmp_path / "latest")) == "elsewhere"


def test_a_silent_master_ends_a_node():
    with running_master() as (silent, uri), start(PROGRAMS["calls"], uri) as process:
        wait_for(lambda: "calls" in process.output, "the node")
        silent.send_signal(signal.SIGSTOP)
        assert process.wait() == 1, process.output
        silent.send_signal(signal.SIGCONT)
    assert "the master does not answer" in process.output
    assert "Traceback" not in process.output
