"""Check that what is written in several places agrees, and that every node can be started."""

import glob
import os
import re
import stat
import xml.etree.ElementTree as ElementTree

import pytest
import yaml
from roslaunch.rlutil import check_roslaunch

from support import paths
from support.helpers import Process

PACKAGE = paths.CHECKOUT


def read(name):
    with open(os.path.join(PACKAGE, name), encoding="utf-8") as file:
        return file.read()


def executables(folder):
    paths = glob.glob(os.path.join(PACKAGE, folder, "*.py"), recursive=True)
    return {os.path.basename(p): p for p in paths if os.stat(p).st_mode & stat.S_IXUSR}


def test_every_node_is_installed():
    installed = set(re.findall(r"src/(\w+\.py)", read("CMakeLists.txt")))
    assert installed == set(executables("src"))


def test_every_executable_names_the_interpreter_that_knows_ros():
    for name, path in {**executables("src"), **executables("test/**")}.items():
        with open(path, "rb") as file:
            assert file.readline() == b"#!/usr/bin/python3\n", name


def test_every_node_says_where_there_is_no_master():
    for name in executables("src"):
        assert "rospy.init_node(" not in read(f"src/{name}"), f"{name}: startup.init_node says so"


def found_by_ros(folder="."):
    """Return the names of all programs and launch files that ROS finds in a folder of the package.

    ROS searches a package with all its subfolders.
    """
    names = []
    for place, folders, files in os.walk(os.path.join(PACKAGE, folder)):
        folders[:] = [name for name in folders if name != "build" and not name.startswith(".")]
        for name in files:
            is_program = os.stat(os.path.join(place, name)).st_mode & stat.S_IXUSR
            if is_program or name.endswith((".launch", ".test")):
                names.append(name)
    return sorted(names)


def test_ros_finds_every_program_and_launch_file_once():
    """ROS refuses a name that it finds twice."""
    names = found_by_ros()
    assert sorted(set(names)) == names


def test_ros_finds_no_test_and_no_example():
    """Tab completion after `rosrun mushr_ros_intro` must not lead to them."""
    assert found_by_ros("examples") == []
    assert found_by_ros("test/fixtures") == []


def test_launch_files_clear_the_parameters_of_earlier_runs():
    launch = glob.glob(os.path.join(PACKAGE, "launch", "*.launch"))
    launch += glob.glob(os.path.join(PACKAGE, "underlay", "*", "launch", "*.launch"))
    for path in launch:
        for node in ElementTree.parse(path).iter("node"):
            if node.find("param") is not None or node.find("rosparam") is not None:
                is_ours = node.get("type").endswith(".py")
                assert not is_ours or node.get("clear_params") == "true", (path, node.get("name"))


@pytest.mark.parametrize("path", sorted(glob.glob(os.path.join(PACKAGE, "launch", "*.launch"))))
def test_launch_files_are_valid(path):
    """The nodes and files that it names are there, and package.xml names their packages."""
    assert not check_roslaunch(path, ignore_unset_args=True)


@pytest.mark.parametrize("path", sorted(glob.glob(os.path.join(PACKAGE, "src", "*.py"))))
def test_programs_start(path):
    """The first line, the execute permission and the imports are right, as a user starts them.

    The other tests start the nodes in forks of a server, which need none of that.
    """
    process = Process(path, ROS_MASTER_URI="http://localhost:1")
    assert process.wait() in (1, 2), process.output
    assert re.search("no master|usage", process.output), process.output
    assert "Traceback" not in process.output


def test_versions_agree():
    version = ElementTree.fromstring(read("package.xml")).findtext("version")
    assert re.search(rf"^{re.escape(version)} \(", read("CHANGELOG.rst"), re.MULTILINE)
    assert read("debian/changelog").startswith(f"mushr-ros-intro ({version})")


def test_the_debian_packages_need_what_setup_installs():
    (names,) = re.findall(r'^runtime_packages="([^"]*)"', read("scripts/packages"), re.MULTILINE)
    assert set(names.split()) <= set(re.findall(r"[\w+-]+", read("debian/control")))


def test_sources_are_ascii():
    """Python files are read in the locale's encoding by catkin's relays."""
    for pattern in ("src/**/*.py", "test/**/*.py"):
        for path in glob.glob(os.path.join(PACKAGE, pattern), recursive=True):
            with open(path, "rb") as file:
                assert file.read().isascii(), path


def test_the_workflow_runs_a_script_that_is_there():
    (job,) = yaml.safe_load(read(".github/workflows/test.yml"))["jobs"].values()
    (command,) = (step["run"] for step in job["steps"] if "run" in step)
    assert command == "scripts/test --all"
    assert os.access(os.path.join(PACKAGE, command.split()[0]), os.X_OK)
    assert job["container"] == "debian:${{ matrix.debian }}"
    assert job["strategy"]["matrix"]["debian"] == [11, 12, 13]


def test_the_workflow_publishes_the_targets_of_the_dockerfile():
    (job,) = yaml.safe_load(read(".github/workflows/image.yml"))["jobs"].values()
    targets = re.findall(r"^FROM \S+ AS (\w+)$", read("Dockerfile"), re.MULTILINE)
    assert set(job["strategy"]["matrix"]["target"]) == {"full", "slim"} < set(targets)
    assert targets[-1] == "full"  # the default


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/design.md"])
def test_every_file_that_the_pages_for_contributors_name_is_there(page):
    named = re.findall(r"`([\w./]+/[\w./]*)`", read(page))
    assert len(named) > 10
    folders = (PACKAGE, os.path.join(PACKAGE, "src", "mushr_ros_intro"))
    for name in named:
        is_there = any(os.path.exists(os.path.join(folder, name)) for folder in folders)
        assert re.search("NAME|MODULE", name) or is_there, name
