"""Check builds: an install space without a devel space, and ROS outside of /usr."""

import os
import shutil
import subprocess

import pytest

from support.helpers import PATIENCE, Process, free_port, wait_for
from support.paths import CHECKOUT
from support.scripts import add_programs, needs_workspace

pytestmark = pytest.mark.full

NOETIC = "/opt/ros/noetic"


def shell(script, folder, *variables):
    """Start bash with the environment of ROS, but without that of the workspace and the master."""
    source = f"source {NOETIC}/setup.bash; " if os.path.isdir(NOETIC) else ""
    return Process(
        *("env", "-i", "-C", str(folder), "PATH=/usr/bin:/bin", f"HOME={folder}"),
        "PYTHONUNBUFFERED=1",  # otherwise messages are in a buffer
        *(f"ROS_HOME={folder}/ros", "ROS_HOSTNAME=localhost"),
        f"LD_PRELOAD={os.environ.get('LD_PRELOAD', '')}",  # see scripts/dev/loopback.c
        *(*variables, "bash", "-c", source + script),
    )


def run(script, folder, *variables):
    """Run a script, and return its output; fail if the script fails."""
    with shell(script, folder, *variables) as process:
        assert process.wait(2 * PATIENCE) == 0, process.output
    return process.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Build and install the package; return a workspace that has only the install space."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "src").mkdir()
    (folder / "src" / "mushr_ros_intro").symlink_to(CHECKOUT)
    for name in ("mushr_sim", "mushr_utils"):
        (folder / "src" / name).symlink_to(f"{CHECKOUT}/underlay/{name}")
    if not any(os.path.isdir(f"{root}/share/ackermann_msgs") for root in (NOETIC, "/usr")):
        (folder / "src" / "ackermann_msgs").symlink_to(f"{CHECKOUT}/underlay/ackermann_msgs")
    options = "-DPYTHON_EXECUTABLE=/usr/bin/python3 -DCATKIN_ENABLE_TESTING=OFF"
    run(f"catkin_make {options} install && rm -r build devel src", folder)
    return folder


def test_modules_and_files_are_in_the_install_space(folder):
    command = (
        "import mushr_ros_intro.plan.parse, rospkg; print(mushr_ros_intro.plan.parse.__file__)"
    )
    output = run(f"source install/setup.bash; python3 -c '{command}'", folder)
    assert output.startswith(f"{folder}/install/lib/")
    output = run("source install/setup.bash; rospack find mushr_ros_intro", folder)
    assert output == f"{folder}/install/share/mushr_ros_intro\n"


def test_the_stand_ins_have_their_files(folder):
    assert run("find -L install -type l", folder) == ""  # prints links without a target
    maps = folder / "install/share/mushr_sim/maps"
    assert [each.name for each in sorted(maps.iterdir())] == ["sandbox.png", "sandbox.yaml"]
    assert (folder / "install/share/mushr_utils/rviz/default.rviz").is_file()


def test_roslaunch_drives(folder):
    (folder / "short.txt").write_text("1, 2, 0\n1.0, 0.1, 0.2\n")
    port = free_port()
    uri = f"ROS_MASTER_URI=http://localhost:{port}"
    launch = f"source install/setup.bash; exec roslaunch -p {port} "
    with shell(f"{launch} mushr_ros_intro sim.launch", folder, uri) as simulation:
        wait_for(lambda: "ready: the car" in simulation.output, "the car", 2 * PATIENCE)
        plan = f"path_publisher.launch plan_file:={folder}/short.txt"
        run(f"{launch} mushr_ros_intro {plan}", folder, uri)
        wait_for(lambda: "difference" in simulation.output, "the result of drive_monitor")


SETUP_OF_NOETIC = """
rosdep() { true; }
export CMAKE_PREFIX_PATH=/opt/ros/noetic:/opt/ros/other
export PYTHONPATH=/opt/ros/noetic/lib/python3/dist-packages ROS_PACKAGE_PATH=/usr/share
"""
IN_A_NEW_TERMINAL = """
exec env -i HOME=$HOME PATH=/usr/bin:/bin bash -euc '
source ~/catkin_ws/devel/setup.bash
catkin_make -C ~/catkin_ws
echo "prefix: $CMAKE_PREFIX_PATH"
rosrun mushr_sim check_plan.py circle'
"""
CATKIN = ("share/catkin", "lib/python3/dist-packages/catkin")
HIDES = ["bwrap", "--dev-bind", "/", "/", "--tmpfs", "/opt", "--tmpfs", f"/usr/{CATKIN[0]}"]


@needs_workspace
@pytest.mark.skipif(os.path.isdir(NOETIC), reason="ROS is in /opt/ros already")
@pytest.mark.skipif(subprocess.call([*HIDES, "true"]) != 0, reason="bwrap cannot hide catkin")
def test_a_workspace_with_catkin_in_opt(tmp_path):
    """CMake does not search /opt by itself, because it is on no PATH either."""
    prefix = tmp_path / "noetic"
    for name in CATKIN:
        shutil.copytree(f"/usr/{name}", prefix / name)
    (prefix / ".catkin").touch()
    (prefix / "setup.bash").write_text(SETUP_OF_NOETIC)
    add_programs(tmp_path / "bin", ("dpkg-query",), 'printf "%s:install ok installed " "$@"')
    checkout = tmp_path / "checkout"
    shutil.copytree(
        CHECKOUT, checkout, symlinks=True, ignore=shutil.ignore_patterns("build", ".git")
    )
    done = subprocess.run(
        [
            *(*HIDES, "--bind", str(prefix), NOETIC),
            *("--ro-bind", f"{tmp_path}/bin/dpkg-query", "/usr/bin/dpkg-query"),
            *(f"{checkout}/scripts/shell", "--tutorial"),
        ],
        env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"},
        input="echo $CMAKE_PREFIX_PATH\nrosrun mushr_sim check_plan.py circle\n",
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=10 * PATIENCE,
    )
    assert f"{tmp_path}/catkin_ws/devel:{NOETIC}\n" in done.stdout, done.stdout
    assert done.returncode == 0 and "no faults" in done.stdout, done.stdout
