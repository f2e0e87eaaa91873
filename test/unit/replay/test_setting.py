"""Find the node of a replay."""

import math
import os
import subprocess

import pytest
import yaml

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.replay.setting import find_executable, parameter_words


@pytest.fixture
def node(tmp_path, monkeypatch):
    """Return the path of a node in a package that ROS finds."""
    (tmp_path / "package.xml").write_text("<package><name>student</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}:{os.environ['ROS_PACKAGE_PATH']}")
    path = tmp_path / "drive.py"
    path.write_bytes(b"#!/usr/bin/python3\nimport rospy\r\n")
    path.chmod(0o755)
    return path


def test_a_node_is_found(node):
    assert find_executable("student", "drive.py") == str(node)


def test_a_first_line_with_a_windows_line_end(node):
    node.write_bytes(b"#!/usr/bin/env python3\r\nimport rospy\r\n")
    with pytest.raises(
        UserError, match=r"has Windows line ends .* Type: sed -i 's/\\r\$//' /.*/dr"
    ):
        find_executable("student", "drive.py")


def test_a_first_line_that_starts_another_program(node):
    node.write_bytes(b"#!/bin/bash\nimport rospy\n")
    with pytest.raises(UserError, match="'/bin/bash', which is not Python. Make its first line: #"):
        find_executable("student", "drive.py")


def test_a_byte_order_mark(node):
    node.write_bytes(b"\xef\xbb\xbf" + node.read_bytes())
    with pytest.raises(UserError, match="begins with a byte order mark") as error:
        find_executable("student", "drive.py")
    subprocess.run(str(error.value).split("Type: ")[1], shell=True, check=True)
    assert find_executable("student", "drive.py") == str(node)


def test_another_encoding(node):
    """Python would start neither the first nor the second one."""
    long = b"#!/usr/bin/python3\n" + b"# long\n" * 20_000
    for text, line in ((b"#!/usr/bin/python3\n# \xfc\n", 2), (long + b"# \xfc\n", 20_002)):
        node.write_bytes(text)
        with pytest.raises(UserError, match=f"is not UTF-8 in line {line}. Save it as UTF-8"):
            find_executable("student", "drive.py")
    for text in (b"#!/usr/bin/python3\n# coding: latin-1\n# \xfc\n", long + "# \xfc\n".encode()):
        node.write_bytes(text)
        assert find_executable("student", "drive.py") == str(node)


def test_a_node_that_is_not_executable(node):
    node.chmod(0o644)
    with pytest.raises(UserError, match="It is not executable; type: chmod"):
        find_executable("student", "drive.py")
    deep = node.parent / "src" / "nodes" / "drive.py"
    deep.parent.mkdir(parents=True)
    node.rename(deep)
    with pytest.raises(UserError, match=f"It is not executable; type: chmod .x {deep}"):
        find_executable("student", "drive.py")
    deep.unlink()
    deep.mkdir()  # a folder is executable
    with pytest.raises(UserError, match="there is no node 'drive.py' in the package 'student'$"):
        find_executable("student", "drive.py")


def test_two_nodes_of_the_same_name(node):
    """rosrun asks which one to start; a link is the same program."""
    other = node.parent / "scripts" / "drive.py"
    other.parent.mkdir()
    other.symlink_to(node)
    assert os.path.samefile(find_executable("student", "drive.py"), node)
    other.unlink()
    other.write_bytes(node.read_bytes())
    assert find_executable("student", "drive.py") == str(node)  # the other one is not executable
    other.chmod(0o755)
    with pytest.raises(UserError, match=f"of the same name: {node}, {other}. Rename or delete"):
        find_executable("student", "drive.py")


def test_parameters_of_a_file(tmp_path):
    path = tmp_path / "parameters.yaml"
    path.write_text("pid: {kp: 1, gains: [1, 2.5]}\nname: a b\n")
    words = ("_pid/kp:=1", "_pid/gains:=[1, 2.5]", "_name:=a b")
    assert parameter_words(str(path)) == words
    path.write_text("ki: 0.00001\nlimit: 1.0e+20\ninf: .inf\nlist: [0.00002, 1.0]\n")
    values = [yaml.safe_load(each.partition(":=")[2]) for each in parameter_words(str(path))]
    assert values == [1e-5, 1e20, math.inf, [2e-5, 1.0]]
    path.write_text("- 1")
    with pytest.raises(UserError, match="expected keys with the names of parameters"):
        parameter_words(str(path))
