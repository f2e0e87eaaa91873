"""Check that the package runs from an install space alone, with no devel space sourced."""

import os
import signal
import subprocess

import pytest

from support.helpers import PATIENCE, free_port
from support.paths import CHECKOUT

NOETIC = "/opt/ros/noetic"


def shell(script, folder, **variables):
    """Return a process of bash that knows ROS, but neither the workspace nor the master in use."""
    source = f"source {NOETIC}/setup.bash; " if os.path.isdir(NOETIC) else ""
    environment = {
        "PATH": "/usr/bin:/bin",
        "HOME": str(folder),
        "ROS_HOME": str(folder / "ros"),
        "ROS_HOSTNAME": "localhost",
        "LD_PRELOAD": os.environ.get("LD_PRELOAD", ""),  # see scripts/loopback.c
        **variables,
    }
    return subprocess.Popen(
        ["bash", "-c", source + script],
        cwd=str(folder),
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def run(script, folder, **variables):
    """Return the output of a script that has to succeed."""
    process = shell(script, folder, **variables)
    try:
        output, _ = process.communicate(timeout=2 * PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError(f"no end: {process.communicate()[0]}") from None
    assert process.returncode == 0, output
    return output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the folder of a workspace of which only the install space is left."""
    folder = tmp_path_factory.mktemp("workspace")
    (folder / "src").mkdir()
    (folder / "src" / "mushr_ros_intro").symlink_to(CHECKOUT)
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


def test_roslaunch_drives(folder):
    (folder / "short.txt").write_text("1, 2, 0\n1.0, 0.1, 0.2\n")
    port = free_port()
    variables = {"ROS_MASTER_URI": f"http://localhost:{port}"}
    launch = f"source install/setup.bash; exec roslaunch -p {port} "
    simulation = shell(f"{launch} mushr_ros_intro sim.launch >sim.log", folder, **variables)
    try:
        plan = f"path_publisher.launch plan_file:={folder}/short.txt"
        output = run(f"{launch} --wait mushr_ros_intro {plan}", folder, **variables)
    finally:
        os.killpg(simulation.pid, signal.SIGINT)
        messages, _ = simulation.communicate(timeout=2 * PATIENCE)
    assert "difference" in output, output + messages
