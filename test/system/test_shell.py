"""Check that the documented commands work in scripts/shell, with any settings of the user."""

import fcntl
import glob
import os
import shutil
import signal
import subprocess

import pytest

from support.helpers import PATIENCE, Process, wait_for
from support.paths import CHECKOUT
from support.scripts import add_programs, needs_workspace

pytestmark = needs_workspace

ANY_INTERFACE = 'import socket; s = socket.socket(); s.bind(("", 0)); print(s.getsockname()[0])'
"""Prepares a server on every network interface, and prints its address."""


@pytest.fixture
def shell(tmp_path):
    """Return a function that runs the script in the home of a user with a .bashrc."""
    add_programs(tmp_path / "bin", ("cmake", "python3"))
    add_programs(tmp_path / "tools", ("my_tool",), "echo my tool")
    (tmp_path / ".bashrc").write_text(
        "export PATH=~/bin:~/tools:$PATH PYTHONHOME=/nonsense PYTHONPATH=/nonsense\n"
        "export ROS_HOSTNAME=nonsense.example ROS_IP=192.0.2.1 ROS_NAMESPACE=/nonsense\n"
        "export ROS_MASTER_URI=http://192.0.2.2:11311 ROS_PACKAGE_PATH=/nonsense\n"
        "alias hello='echo hello'\n"
        "PS1='my prompt> '\n"
    )

    def run(*command, typed="", checkout=CHECKOUT):
        """Return the output lines of the shell."""
        done = subprocess.run(
            [f"{checkout}/scripts/shell", *command],
            cwd=str(tmp_path),
            env={"HOME": str(tmp_path), "PATH": f"{tmp_path}/bin:/usr/bin:/bin"},
            input=typed,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            start_new_session=True,
        )
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        if not command:
            assert lines.pop(0) == f"setup: here, mushr_ros_intro is the package in {CHECKOUT}"
        return lines

    return run


TYPED = {
    "roscd mushr_ros_intro && readlink -f scripts && cd ~-": f"{CHECKOUT}/scripts",
    "realpath $(roslaunch --files mushr_ros_intro sim.launch)": f"{CHECKOUT}/launch/sim.launch",
    "rosrun mushr_ros_intro check_plan.py circle | sed -n 2p": "no faults",
    "which python3 && python3 -c 'import rospy, ackermann_msgs'": "/usr/bin/python3",
    "which cmake": "/usr/bin/cmake",
    "which catkin_make >/dev/null && which catkin_create_pkg >/dev/null && echo yes": "yes",
    "echo $ROS_HOSTNAME $ROS_MASTER_URI": "localhost http://localhost:11311",
    "echo ${ROS_IP-1} ${ROS_NAMESPACE-2} ${ROS_HOME-3} ${TMPDIR-4}": "1 2 3 4",
    # scripts/dev/loopback.c is for programs with roscpp only.
    f"python3 -c '{ANY_INTERFACE}'": "0.0.0.0",
    "complete -p rosrun roslaunch roscd rostest >/dev/null && echo yes": "yes",
    "hello": "hello",
    "my_tool": "my tool",
    'echo "$PS1"': "(mushr_ros_intro) my prompt> ",
}
"""Lines, and what they print."""


def test_what_a_user_types(shell):
    assert shell(typed="\n".join(TYPED) + "\n") == [*TYPED.values()]


def test_completion(shell):
    """Tab completes the nodes, and nothing of the examples."""
    typed = "COMP_WORDS=(rosrun mushr_ros_intro '') COMP_CWORD=2\n_roscomplete_exe\n"
    (line,) = shell(typed=typed + 'echo "${COMPREPLY[@]}"\n')
    found = line.split()
    nodes = {os.path.basename(path) for path in glob.glob(f"{CHECKOUT}/src/*.py")}
    assert nodes <= set(found) and len(set(found)) == len(found)
    assert "drive_plan.py" not in found


def test_one_command(shell):
    assert shell("bash", "-c", 'echo "$0 $ROS_HOSTNAME"', "two words") == ["two words localhost"]


@pytest.mark.parametrize(
    "name",
    [
        "dev/benchmark",
        "dev/build_deb",
        "dev/lint",
        "dev/screenshot",
        "run",
        "setup",
        "shell",
        "test",
    ],
)
def test_help(name):
    """No script starts with an option that it does not know, such as --help."""
    script = f"{CHECKOUT}/scripts/{name}"
    done = subprocess.run([script, "--help"], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2 and f"usage: scripts/{name}" in done.stderr and not done.stdout


def test_the_workspace_around_the_checkout(shell, tmp_path):
    """As in the tutorial: ~/catkin_ws/src contains the checkout and the user's own package."""
    workspace = tmp_path / "catkin_ws"
    (workspace / "src").mkdir(parents=True)
    (workspace / "src" / "mushr_ros_intro").symlink_to(CHECKOUT)
    (workspace / "devel").mkdir()
    # catkin's file, too, uses arguments that are not its own.
    setup = "export MINE=yes ARGUMENTS=$#\ngreet() { echo greeting; }\n"
    (workspace / "devel" / "setup.bash").write_text(setup)
    checkout = workspace / "src" / "mushr_ros_intro"
    assert shell("printenv", "MINE", "ARGUMENTS", checkout=checkout) == ["yes", "0"]
    assert shell(typed="echo $MINE\ngreet\n", checkout=checkout) == ["yes", "greeting"]


def waits_for_another_script(workspace, *command):
    """Check that a script waits while another one works in a workspace."""
    workspace.mkdir(parents=True)
    folder = os.open(workspace, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        with Process(*command) as second:
            wait_for(lambda: "waiting for another script" in second.output, "a message")
            second.send_signal(signal.SIGINT)
            assert second.wait() == 130
    finally:
        os.close(folder)


def test_only_one_script_builds(tmp_path):
    """In a new checkout, and in a new workspace of the tutorial, the second script waits."""
    checkout = tmp_path / "checkout"
    shutil.copytree(CHECKOUT, checkout, ignore=shutil.ignore_patterns("build", ".git"))
    workspace = checkout / "build" / ".workspace"
    waits_for_another_script(workspace, f"{checkout}/scripts/setup")
    assert os.listdir(workspace) == []
    tutorial = tmp_path / "catkin_ws"
    waits_for_another_script(tutorial, f"{CHECKOUT}/scripts/shell", "--tutorial", str(tutorial))
    assert os.listdir(tutorial / "src" / "mushr") == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of files")
def test_root_leaves_no_files_in_the_checkout_of_another_user(tmp_path):
    checkout = tmp_path / "checkout"
    shutil.copytree(f"{CHECKOUT}/scripts", checkout / "scripts")
    (checkout / "build").mkdir()
    subprocess.run(["chown", "-R", "1234:1235", str(checkout)], check=True)
    (checkout / "build" / ".workspace").touch()  # where the build would be, so that it fails
    (checkout / "build" / "link").symlink_to("/etc/passwd")
    failed = subprocess.run([f"{checkout}/scripts/setup"], timeout=PATIENCE)
    assert failed.returncode == 1
    for path in (*checkout.glob("**/*"), checkout):
        assert (path.lstat().st_uid, path.lstat().st_gid) == (1234, 1235), path
    assert os.stat("/etc/passwd").st_uid == 0
