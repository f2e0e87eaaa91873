"""What the doctor reads about processes."""

import os
import subprocess
from contextlib import contextmanager

from mushr_ros_intro.doctor.processes import left_parameters, masters

URI = "http://localhost:12345/"
PARAMETERS = {"plan_file": "a.txt", "loop": True, "car": {"name": "ideal"}}


@contextmanager
def process(*arguments, uri=URI[:-1]):
    """Run a program that does nothing; yield its process id."""
    command = ["sh", "-c", "echo runs; read line", "node.py", *arguments]
    environment = {**os.environ, "ROS_MASTER_URI": uri}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, env=environment) as running:
        # Before its first output, it may have the command line of this process.
        assert running.stdout.readline()
        yield running.pid
        running.communicate()


def test_parameters_that_are_not_in_the_command_line():
    with process("_plan_file:=b.txt", "chatter:=/news", "_car/name:=nano") as pid:
        assert left_parameters(pid, URI, PARAMETERS) == ({"loop": True}, {})
        assert left_parameters(pid, "http://localhost:1", PARAMETERS) == ({}, {})


def test_an_argument_without_an_underscore_sets_no_parameter():
    with process("plan_file:=b.txt", "_loop:=true", "car:=nano", "/tf:=/a") as pid:
        left, mistyped = left_parameters(pid, URI, PARAMETERS)
    assert left == {"plan_file": "a.txt", "car": {"name": "ideal"}}
    assert mistyped == {"plan_file": "b.txt", "car": "nano"}


def test_masters(tmp_path):
    """Wherever they run: roscore -p, and those of roslaunch."""
    (tmp_path / "rosmaster").write_text("echo runs; read line\n")
    command = ["sh", str(tmp_path / "rosmaster"), "--core", "-p", "1234", "-w", "3"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as running:
        assert running.stdout.readline()
        assert "http://localhost:1234" in masters()
        running.communicate()
    assert "http://localhost:1234" not in masters()


def test_nodes_that_another_program_starts_have_its_parameters():
    with process("_plan_file:=b.txt", "__name:=path_publisher") as pid:
        assert left_parameters(pid, URI, PARAMETERS) == ({}, {})


def test_a_process_that_has_ended():
    with process() as pid:
        pass
    assert left_parameters(pid, URI, PARAMETERS) == ({}, {})
