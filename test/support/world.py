"""A ROS system for one test module: a master in this process, and nodes of launch files."""

import contextlib
import os
import signal

import rosgraph
import rospy
import yaml
from roslaunch.config import ROSLaunchConfig
from roslaunch.core import local_machine, setup_env
from roslaunch.node_args import create_local_process_args
from roslaunch.xmlloader import XmlLoader

from mushr_ros_intro.replay.guarded_master import GuardedMaster
from support.helpers import ForkedProcess, Process
from support.paths import PACKAGE

LOCK_STEP = {"use_sim_time": True, "real_time_factor": 0}
"""Arguments of sim.launch."""


def serve_master():
    """Start a master in this process at a free port of the loopback interface, and use it."""
    os.environ["ROS_MASTER_URI"] = GuardedMaster().serve()  # nodes end at once with this master
    rosgraph.Master("/world").setParam("/run_id", "test")  # each roslaunch would set another one


def launch(file, parameters=(), watched=True, **arguments):
    """Start the nodes of a launch file of the package, as roslaunch does; return the processes.

    Python nodes of this package run in forks.

    Args:
        file: a name in launch/.
        parameters: pairs of names and values, which replace those of the launch file.
        watched: whether the monitor of all drives is started, too.
        arguments: of the launch file.
    """
    values = [f"{name}:={value}" for name, value in arguments.items()]
    config = ROSLaunchConfig()
    XmlLoader().load(f"{PACKAGE}/launch/{file}", config, argv=values)
    config.assign_machines()
    master = rosgraph.Master("/world")
    for name, parameter in config.params.items():
        master.setParam(name, parameter.value)
    for name, value in parameters:
        master.setParam(name, value)
    started = []
    for each in config.nodes:
        if each.type == "drive_monitor.py" and not watched:
            continue
        command = create_local_process_args(each, local_machine())
        environment = setup_env(each, local_machine(), os.environ["ROS_MASTER_URI"])
        kind = Process
        if each.package in ("mushr_ros_intro", "mushr_sim"):
            kind, command[0] = ForkedProcess, f"{PACKAGE}/src/{each.type}"
        started.append(kind(*command, **environment))
    return started


def load(name, namespace):
    """Set the parameters of a file in config/, as <rosparam> does."""
    with open(f"{PACKAGE}/config/{name}") as file:
        rosgraph.Master("/world").setParam(namespace, yaml.safe_load(file))


@contextlib.contextmanager
def running(start):
    """Run a master, then call `start`, which returns processes; make this process a node."""
    assert not rospy.core.is_initialized(), "one file per process; run several with scripts/test"
    serve_master()
    processes = []
    try:
        processes += start()
        rospy.init_node("test", disable_signals=True)
        yield
    finally:
        rospy.signal_shutdown("the tests are over")
        for each in processes:
            if isinstance(each, ForkedProcess) and each.running:
                each.send_signal(signal.SIGKILL)  # the master ends, too
            else:
                each.end()  # roslaunch has to end its nodes
