"""Check that what is written in several places agrees, and that every node can be started."""

import glob
import os
import re
import stat
import xml.etree.ElementTree as ElementTree

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.rlutil import check_roslaunch
from roslaunch.xmlloader import XmlLoader

from support import paths
from support.helpers import ForkedProcess

PACKAGE = paths.CHECKOUT


def read(name):
    with open(os.path.join(PACKAGE, name), encoding="utf-8") as file:
        return file.read()


def parameters_of(launch_file, arguments):
    """Return the parameters that a launch file sets, by their names."""
    config = ROSLaunchConfig()
    XmlLoader().load(os.path.join(PACKAGE, launch_file), config, argv=arguments)
    return {name: each.value for name, each in config.params.items()}


def executables(folder):
    paths = glob.glob(os.path.join(PACKAGE, folder, "*.py"), recursive=True)
    return {os.path.basename(p): p for p in paths if os.stat(p).st_mode & stat.S_IXUSR}


def test_every_node_is_installed():
    installed = set(re.findall(r"src/(\w+\.py)", read("CMakeLists.txt")))
    assert installed == set(executables("src")), "expected CMakeLists.txt, and chmod +x"


def test_every_executable_names_the_interpreter_that_knows_ros():
    for name, path in executables("src").items():
        with open(path, "rb") as file:
            assert file.readline() == b"#!/usr/bin/python3\n", name


def test_every_node_says_where_there_is_no_master():
    for name in executables("src"):
        assert "rospy.init_node(" not in read(f"src/{name}"), f"{name}: node.main says so"


def found_by_ros(folder="."):
    """Return the names of all programs and launch files that ROS finds in a folder of the package.

    ROS searches a package with all its subfolders.
    """
    names = []
    for place, folders, files in os.walk(os.path.join(PACKAGE, folder)):
        others = ("build", "underlay")  # the packages in underlay/ have names of their own
        folders[:] = [name for name in folders if name not in others and name[0] != "."]
        for name in files:
            is_program = os.stat(os.path.join(place, name)).st_mode & stat.S_IXUSR
            if is_program or name.endswith((".launch", ".test")):
                names.append(name)
    return sorted(names)


def test_ros_finds_every_program_and_launch_file_once():
    """ROS refuses a name that it finds twice."""
    for folder in (".", *glob.glob(os.path.join(PACKAGE, "underlay", "*"))):
        names = found_by_ros(folder)
        assert sorted(set(names)) == names


def test_ros_finds_no_test_and_no_example():
    """Tab completion after `rosrun mushr_ros_intro` must not lead to them."""
    assert found_by_ros("examples") == []
    assert found_by_ros("test") == ["replay.test"]
    # rosrun names files that are not executable, too, as if the user had to change that.
    paths = glob.glob(f"{PACKAGE}/test/**", recursive=True)
    files = {os.path.basename(each) for each in paths if os.path.isfile(each)}
    assert not files & {name.replace(".py", "") for name in executables("src")}
    # Start files of courses, which `roslaunch mushr_sim` finds, too.
    assert all(name.endswith(".launch") for name in found_by_ros("underlay"))


def test_launch_files_clear_the_parameters_of_earlier_runs():
    launch = glob.glob(os.path.join(PACKAGE, "launch", "*.launch"))
    launch += glob.glob(os.path.join(PACKAGE, "underlay", "*", "launch", "*.launch"))
    for path in launch:
        for node in ElementTree.parse(path).iter("node"):
            if node.find("param") is not None or node.find("rosparam") is not None:
                is_ours = node.get("type").endswith(".py")
                assert not is_ours or node.get("clear_params") == "true", (path, node.get("name"))


@pytest.mark.parametrize(
    "path",
    [
        *sorted(glob.glob(os.path.join(PACKAGE, "launch", "*.launch"))),
        # It includes those of mushr_sim.
        os.path.join(PACKAGE, "underlay", "mushr_base", "launch", "teleop.launch"),
    ],
)
def test_launch_files_are_valid(path):
    """The nodes and files that it names are there, and package.xml names their packages.

    Courses check their own launch files, which include those of mushr_sim, in the same way.
    """
    assert not check_roslaunch(path, ignore_unset_args=True)


def test_courses_may_leave_the_start_pose_to_the_simulator():
    """UW's particle_filter_teleop_sim.launch passes NaN."""
    arguments = ["initial_x:=NaN", "initial_y:=-1.5", "initial_theta:=nan"]
    path = "underlay/mushr_sim/launch/teleop.launch"
    parameters = parameters_of(path, [*arguments, "headless:=true"])
    pose = [parameters[f"/car/car_sim/{name}"] for name in ("x", "y", "theta")]
    assert pose == [0, -1.5, 0]


def test_arguments_of_mushrs_launch_files():
    """Courses include these files with MuSHR's arguments; an unknown one would be an error."""
    for name, arguments in {
        "mushr_base/launch/teleop.launch": ["car_name:=nine", "racecar_version:=racecar-uw-nano"],
        "mushr_base/launch/includes/racecar_state.launch": ["tf_prefix:=car", "use_mocap:=false"],
        "mushr_sim/launch/multi_teleop.launch": ["car1_name:=nine", "car2_name:=ten"],
    }.items():
        path = os.path.join(PACKAGE, "underlay", name)
        with open(path) as file:
            declared = re.findall(r'<arg name="(\w+)" default', file.read())
        assert {each.partition(":=")[0] for each in arguments} <= {*declared}
        found = parameters_of(f"underlay/{name}", arguments)
        assert ("/nine/car_sim/wheelbase" in found or not found) and name
        assert ("/ten/car_sim/y" in found) == ("car2_name:=ten" in arguments)


def test_a_click_places_its_own_car():
    for car, topic in (("car", "/clicked_point"), ("car2", "/car2/clicked_point")):
        config = ROSLaunchConfig()
        arguments = [f"car_name:={car}", "map:=none"]
        XmlLoader().load(os.path.join(PACKAGE, "launch/sim.launch"), config, argv=arguments)
        (node,) = (each for each in config.nodes if each.name == "car_sim")
        assert [to for name, to in node.remap_args if name.endswith("clicked_point")] == [topic]


def test_the_port_of_the_page_in_mushrs_launch_files():
    arguments = ["web:=true", "web_port:=9091"]
    found = parameters_of("underlay/mushr_sim/launch/teleop.launch", arguments)
    assert found["/web_view/port"] == 9091


def test_package_xml_names_what_the_code_needs():
    """The packages of ROS that it imports, and whose commands its messages advise."""
    needed = set()
    for path in glob.glob(os.path.join(PACKAGE, "src", "**", "*.py"), recursive=True):
        with open(path) as file:
            text = file.read()
        needed.update(re.findall(r"^\s*(?:import|from) (\w+)", text, re.M))
        needed.update(re.findall(r"\b(rosbag|rosnode|rosparam|rosservice|rostopic) [a-z]", text))
    needed &= {*rospkg.RosPack().list()} - {"catkin", "mushr_ros_intro", "mushr_sim", "vesc_msgs"}
    root = ElementTree.fromstring(read("package.xml"))
    assert len(needed) > 10 and needed <= {each.text for each in root.iter("exec_depend")}


PROGRAMS = [
    path
    for name, path in sorted(executables("src").items())
    if "node.main(" not in read(f"src/{name}")
]


@pytest.mark.parametrize("path", PROGRAMS)
def test_programs_start(path):
    """Their imports are right, and --help needs no master and shows an example.

    unit/ros/test_help.py imports the nodes, and reads their help.
    """
    process = ForkedProcess(path, "--help", ROS_MASTER_URI="http://localhost:1")
    assert process.wait() == 0, process.output
    assert re.search("^Example: ", process.output, re.M), process.output


def test_the_view_of_another_car(monkeypatch):
    """Its topics are those of this car; only the map is that of all cars."""
    monkeypatch.syspath_prepend(f"{PACKAGE}/src")
    import view

    text = view.view_of("car2", read("rviz/default.rviz"))
    topics = set(re.findall(r"^ *Topic: (/.*)", text, re.M))
    assert len(topics) > 5 and {each for each in topics if "/car2/" not in each} == {"/map"}
    assert "car/" not in text.replace("car2/", "")


def test_versions_agree():
    version = ElementTree.fromstring(read("package.xml")).findtext("version")
    assert re.search(rf"^{re.escape(version)} \(", read("CHANGELOG.rst"), re.MULTILINE)
    assert read("debian/changelog").startswith(f"mushr-ros-intro ({version})")


def test_the_debian_packages_need_what_setup_installs():
    (names,) = re.findall(
        r'^runtime_packages="([^"]*)"', read("scripts/dev/packages"), re.MULTILINE
    )
    assert set(names.split()) <= set(re.findall(r"[\w+-]+", read("debian/control")))


def test_sources_are_ascii():
    """Python files are read in the locale's encoding by catkin's relays."""
    for pattern in ("src/**/*.py", "test/**/*.py"):
        for path in glob.glob(os.path.join(PACKAGE, pattern), recursive=True):
            with open(path, "rb") as file:
                assert file.read().isascii(), path


def test_every_promise_has_its_tests():
    lines = read("test/promises.txt").splitlines()
    named = [line.strip() for line in lines if "::" in line]
    assert len(named) > 20
    for path, test in (each.split("::") for each in named):
        assert f"def {test}(" in read(f"test/{path}"), f"{path} has no test {test}"
    # Each promise has a line with a test.
    for promise, *tests in (block.split("\n") for block in "\n".join(lines).split("\n\n")[1:]):
        assert promise[0] != " " and tests, promise
