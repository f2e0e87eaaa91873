"""What the doctor sees on a machine where nothing runs: files, paths, names, its command line."""

import os
import socket
import subprocess
import sys

import pytest

from support.paths import PACKAGE

SOURCE = os.path.join(PACKAGE, "src")
sys.path.append(SOURCE)

import doctor  # noqa: E402


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return the folder of a student's package that ROS knows."""
    folder = tmp_path / "student"
    (folder / "scripts").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>student</name></package>")
    known = os.environ["ROS_PACKAGE_PATH"]
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{folder}{os.pathsep}{known}")
    return folder


def said(findings):
    return [str(each) for each in findings]


def test_this_package_is_in_order():
    assert doctor.look_at_files(doctor.PACKAGE) == []


@pytest.mark.parametrize(
    "text, mode, words",
    [
        ("#!/usr/bin/python3\n", 0o644, "is not executable. Type: chmod +x "),
        ("#!/usr/bin/env no_such_python\n", 0o755, "by no_such_python, which is not there"),
        ("#!/no/such/python\n", 0o755, "by /no/such/python, which is not there"),
        ("#!/usr/bin/python3\r\n", 0o755, "line ends of Windows"),
        ("import rospy\nrospy.init_node('a')\n", 0o755, "does not say what runs it"),
    ],
)
def test_a_program_that_cannot_be_started(package, text, mode, words):
    path = package / "scripts" / "drive.py"
    path.write_bytes(text.encode())
    path.chmod(mode)
    (finding,) = said(doctor.look_at_files("student"))
    assert finding.startswith(f"{path} ")
    assert words in finding


def test_what_is_no_program_is_left_alone(package):
    (package / "scripts" / "module.py").write_text("import math\n")
    (package / "scripts" / "notes.txt").write_text("#1 init_node()\n")
    (package / "setup.py").write_text("if __name__ == '__main__':\n    pass\n")
    program = package / "scripts" / "good.py"
    program.write_text("#!/usr/bin/python3\n")
    program.chmod(0o755)
    assert doctor.look_at_files("student") == []


def test_packages_that_ros_does_not_know(monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", "")
    one, other = said(doctor.look_at_files("student"))
    assert "ROS does not know the package mushr_ros_intro" in one
    assert "Type: source " in one
    assert one.rstrip("'").endswith("devel/setup.bash")
    assert "ROS does not know the package student" in other


def test_network_names_that_are_not_of_this_machine(monkeypatch):
    def fail(*_):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setenv("ROS_HOSTNAME", "nosuch.invalid")
    monkeypatch.setattr(socket, "getaddrinfo", fail)
    (finding,) = said(doctor.look_at_network())
    assert "ROS_HOSTNAME [nosuch.invalid] cannot be resolved" in finding
    monkeypatch.undo()
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    assert doctor.look_at_network() == []
    monkeypatch.setattr("rosgraph.network.get_local_addresses", lambda: ["192.0.2.2"])
    assert doctor.look_at_network() == []


def test_a_terminal_without_the_workspace():
    run = subprocess.run(
        [sys.executable, os.path.join(SOURCE, "doctor.py")],
        env={"PATH": "/usr/bin:/bin"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert run.returncode == 1, run.stdout
    assert "ackermann_msgs: the workspace is not sourced in this terminal" in run.stdout
    assert ". Type: source " in run.stdout
    assert run.stdout.count("\n") == 1


@pytest.mark.parametrize(
    "name, python, is_sourced, words",
    [
        ("rosgraph", "/home/me/.pyenv/bin/python3", True, "Type: /usr/bin/python3 "),
        ("roswtf", "/usr/bin/python3", True, "Type: sudo apt-get install python3-roswtf"),
        ("rosgraph", "/usr/bin/python3", False, "Type: source "),
        ("ackermann_msgs.msg", "/usr/bin/python3", True, "Type: source "),
    ],
)
def test_modules_that_are_not_found(name, python, is_sourced, words):
    said = doctor.import_fault(name, python, is_sourced)
    assert said.startswith(f"{python} does not find {name}: ")
    assert words in said


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--bogus"], "unrecognized arguments: --bogus"),
        (["--car", "a car"], "'a car'; expected the name of a car"),
    ],
)
def test_a_wrong_call(arguments, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["doctor.py", *arguments])
    with pytest.raises(SystemExit) as end:
        doctor.main()
    assert end.value.code == 2
    assert words in capsys.readouterr().err
