"""Check that the package runs from an install space, without a devel space."""

import os

import pytest

from support.helpers import PATIENCE, Process, free_port, wait_for
from support.paths import CHECKOUT

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
