"""The doctor on a machine without a running system: packages, network settings, arguments."""

import os
import subprocess
import sys

import pytest

from mushr_ros_intro.doctor.network import advertised_findings, network_findings
from support.paths import PACKAGE

SOURCE = os.path.join(PACKAGE, "src")
sys.path.append(SOURCE)

import doctor  # noqa: E402


@pytest.fixture
def findings(monkeypatch, tmp_path):
    """Return a function for the findings on a package; those on this one are tested once, below."""
    (tmp_path / "package.xml").write_text("<package><name>student</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}:{os.environ['ROS_PACKAGE_PATH']}")
    monkeypatch.setattr(doctor, "PACKAGE", "student")
    return lambda: list(map(str, doctor.package_findings("student")))


def test_a_package_without_a_program(tmp_path, monkeypatch, findings):
    (finding,) = findings()
    path = f"{tmp_path}/src/path_publisher.py"
    assert finding.startswith(f"there is no program in the package {tmp_path}. Save your node as ")
    assert finding.endswith(f"Save your node as {path}, and type: chmod +x {path}")
    built = tmp_path / "lib" / "student"  # of a workspace in which catkin has built a program
    built.mkdir(parents=True)
    with monkeypatch.context() as patch:
        patch.setattr(doctor, "find_in_workspaces", lambda *_, **__: [str(built)])
        assert len(findings()) == 1
        (built / "drive").touch()
        assert findings() == []
    deep = tmp_path / "src" / "nodes" / "drive.py"  # rosrun searches all folders
    deep.parent.mkdir(parents=True)
    deep.write_text("#!/usr/bin/python3\n")
    assert findings() == [f"{deep} is not executable. Type: chmod +x {deep}"]
    deep.chmod(0o755)
    assert findings() == []


def test_two_programs_of_the_same_name(tmp_path, findings):
    """rosrun asks which one to start; a link is the same program."""
    one, two = tmp_path / "scripts" / "drive.py", tmp_path / "src" / "drive.py"
    for path in (one, two):
        path.parent.mkdir()
        path.write_text("#!/usr/bin/python3\n")
        path.chmod(0o755)
    (finding,) = findings()
    assert finding.startswith(f"the package has several programs of the same name: {one}, {two}. R")
    two.unlink()
    two.symlink_to(one)
    assert findings() == []


def test_packages_that_ros_does_not_find(monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", "")
    own, students = map(str, doctor.package_findings("student"))
    assert own.startswith("ROS does not find the package mushr_ros_intro")
    assert "Type: source " in own and own.rstrip("'").endswith("devel/setup.bash")
    assert students.startswith("ROS does not find the package student")
    assert "catkin_make" in students


def test_a_misspelt_package():
    """There is no finding on this package."""
    (finding,) = map(str, doctor.package_findings("mushr_ros_into"))
    assert finding.endswith(
        "; did you mean mushr_ros_intro. Correct the name, or make and source its workspace"
    )


def apply(settings, monkeypatch):
    """Set the variables that advertise a machine."""
    for name in ("ROS_HOSTNAME", "ROS_IP"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({}, None),
        ({"ROS_HOSTNAME": "localhost"}, None),
        ({"ROS_IP": "127.0.0.1"}, None),
        ({"ROS_HOSTNAME": "localhost", "ROS_IP": "192.0.2.1"}, None),  # ROS_IP has no effect
        ({"ROS_IP": "192.0.2.1"}, "ROS_IP is '192.0.2.1', which is not an address of this machine"),
        ({"ROS_HOSTNAME": "192.0.2.1"}, "ROS_HOSTNAME is '192.0.2.1', which is not an address"),
        ({"ROS_HOSTNAME": "http://robot"}, "ROS_HOSTNAME is 'http://robot', which cannot be"),
        ({"ROS_HOSTNAME": ""}, "ROS_HOSTNAME is '', which cannot be resolved"),
    ],
)
def test_network_settings(settings, words, monkeypatch):
    apply(settings, monkeypatch)
    found = [str(each) for each in network_findings()]
    assert len(found) == bool(words)
    for finding in found:
        assert finding.startswith(words)
        assert "export ROS_HOSTNAME=localhost" in finding


@pytest.mark.parametrize(
    "master, settings, words",
    [
        ("192.0.2.1", {"ROS_HOSTNAME": "localhost"}, "they advertise the name 'localhost'"),
        ("192.0.2.1", {"ROS_IP": "127.0.0.1"}, "they advertise the name '127.0.0.1'"),
        ("192.0.2.1", {"ROS_IP": "198.51.100.7"}, None),
        ("localhost", {"ROS_HOSTNAME": "localhost"}, None),
        ("nosuch.invalid", {"ROS_HOSTNAME": "localhost"}, None),  # is reported as such
    ],
)
def test_a_name_that_the_machine_of_the_master_cannot_reach(master, settings, words, monkeypatch):
    apply(settings, monkeypatch)
    found = [str(each) for each in advertised_findings(f"http://{master}:11311")]
    assert len(found) == bool(words)
    for finding in found:
        assert f"the master is on another machine, {master}" in finding and words in finding
        assert "unset ROS_HOSTNAME; export ROS_IP=" in finding


def test_an_empty_package_with_the_name_of_this_one(tmp_path, monkeypatch):
    """As in a student's workspace, where the tools are in mushr_sim."""
    folder = tmp_path / "mushr_ros_intro"
    (folder / "src").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>mushr_ros_intro</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    monkeypatch.setattr(doctor, "find_in_workspaces", lambda *_, **__: [])
    (finding,) = map(str, doctor.package_findings(""))
    assert finding.startswith(f"there is no program in the package {folder}")


def test_a_terminal_without_the_workspace():
    run = subprocess.run(
        ["/usr/bin/python3", os.path.join(SOURCE, "doctor.py")],
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
    "module, python, is_sourced, words",
    [
        ("rosgraph", "/home/me/.pyenv/bin/python3", True, "Type: /usr/bin/python3 "),
        ("rosgraph", "/usr/bin/python3", True, "Type: sudo apt-get install python3-rosgraph"),
        ("std_msgs.msg", "/usr/bin/python3", True, "sudo apt-get install python3-std-msgs"),
        ("rosgraph", "/usr/bin/python3", False, "Type: source "),
        ("ackermann_msgs.msg", "/usr/bin/python3", True, "Type: source "),
    ],
)
def test_modules_that_are_not_found(module, python, is_sourced, words):
    fault = doctor.import_fault(module, python, is_sourced)
    assert fault.startswith(f"{python} does not find the module {module}: ")
    assert words in fault


def test_the_packages_of_noetic(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "noetic")
    for has_folder, prefix in ((True, "ros-noetic"), (False, "python3")):
        monkeypatch.setattr("os.path.isdir", lambda path, has=has_folder: has)
        fault = doctor.import_fault("std_msgs.msg", "/usr/bin/python3", True)
        assert fault.endswith(f"sudo apt-get install {prefix}-std-msgs")
        fault = doctor.import_fault("rospkg", "/usr/bin/python3", True)
        assert fault.endswith("sudo apt-get install python3-rospkg")


def test_wrong_arguments(monkeypatch, capsys):
    monkeypatch.setattr("signal.signal", lambda *_: None)  # SIGPIPE would end pytest
    monkeypatch.setattr(sys, "argv", ["doctor.py", "--car", "a car"])
    with pytest.raises(SystemExit) as end:
        doctor.main()
    assert end.value.code == 2
    assert "'a car'; expected the name of a car" in capsys.readouterr().err
