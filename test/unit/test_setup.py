"""Parts of scripts/setup that can be tested without an installation."""

import fcntl
import os
import shutil
import socket
import subprocess

import pytest

from support.paths import CHECKOUT

APT = """\
Reading package lists...
Need to get 1,234 kB of archives.
After this operation, 5,678 kB of additional disk space will be used.
dlstatus:1:4.2:Retrieving file 1 of 2
dlstatus:2:38.05:Retrieving file 2 of 2
dlstatus:2:39:Retrieving file 2 of 2
Fetched 1,234 kB in 1s (1,234 kB/s)
Need to get 0 B/1,234 kB of archives.
After this operation, 5,678 kB of additional disk space will be used.
pmstatus:rviz:0:Preparing rviz (amd64)
pmstatus:dpkg-exec:100.0000:Running dpkg
Setting up rviz ...
"""

SHOWN = """\
Need to get 1,234 kB of archives.
After this operation, 5,678 kB of additional disk space will be used.
downloading: 0 %
downloading: 30 %
installing: 0 %
installing: 100 %
"""


def test_grade_without_an_installation(tmp_path):
    """The exit status 1 would mean that a node has failed."""
    environment = {**os.environ, "TMPDIR": str(tmp_path / "missing")}
    command = [f"{CHECKOUT}/scripts/grade", "--help"]
    done = subprocess.run(command, env=environment, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 3 and b"missing" in done.stderr


def run_function(name, script, given=""):
    """Return the output of a script that calls a function of scripts/setup."""
    function = f"sed -n '/^{name}()/,/^[}})]/p' '{CHECKOUT}/scripts/setup'"
    command = ["bash", "-euc", f'eval "$({function})"; {script}']
    return subprocess.check_output(command, input=given, text=True)


def test_the_progress_of_apt_get():
    assert run_function("show_progress", 'say() { echo "$*"; }; show_progress', APT) == SHOWN


def test_another_program_that_installs_packages(tmp_path):
    (tmp_path / "lib" / "apt" / "lists").mkdir(parents=True)
    with open(tmp_path / "lib" / "apt" / "lists" / "lock", "w") as lock:
        assert run_function("apt_user", f"apt_user {tmp_path}") == ""
        fcntl.lockf(lock, fcntl.LOCK_EX)
        with open("/proc/self/comm") as name:
            expected = f"{name.read().strip()} (process {os.getpid()})\n"
        assert run_function("apt_user", f"apt_user {tmp_path}") == expected


BWRAP = "bwrap --dev-bind / /"


@pytest.mark.skipif(os.path.isdir("/opt/ros/noetic"), reason="ROS is in /opt/ros already")
@pytest.mark.skipif(subprocess.getoutput(f"{BWRAP} echo works") != "works", reason="bwrap fails")
@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('ID=ubuntu\nVERSION_ID="24.04"\nPRETTY_NAME="Ubuntu 24.04"', "Ubuntu 24.04"),
        ("", "an unknown system"),
    ],
)
def test_a_system_that_is_not_supported(tmp_path, text, expected):
    (tmp_path / "os-release").write_text(text)
    hidden = ["--ro-bind", f"{tmp_path}/os-release", os.path.realpath("/etc/os-release")]
    command = [*BWRAP.split(), *hidden, f"{CHECKOUT}/scripts/setup"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 1 and done.stdout.startswith(
        f"setup: this is {expected}, without ROS Noetic; supported: Debian 11, 12 and 13, and ROS"
    )


@pytest.mark.parametrize(
    ("name", "found"),
    [("debian:12:Debian", "yes"), ("ubuntu:22.04:Ubuntu", "yes"), ("ubuntu:24.04:Ubuntu", "no")],
)
def test_a_system_whose_packages_contain_ros(name, found):
    """Gradescope's images have Ubuntu 22.04."""
    assert run_function("has_ros", f"has_ros '{name}' && echo yes || echo no") == f"{found}\n"


@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
def test_a_checkout_of_git_for_windows(tmp_path):
    """It has Linux's line ends, and make_links restores the links that are text files there."""
    made, clone = tmp_path / "made", tmp_path / "clone"
    shutil.copytree(f"{CHECKOUT}/underlay", made / "underlay", symlinks=True)
    shutil.copy(f"{CHECKOUT}/.gitattributes", made)
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", made]
    for command in (["init", "-q"], ["add", "-f", "."], ["commit", "-q", "-m", "all"]):
        subprocess.check_call([*git, *command])
    windows = ["-c", "core.autocrlf=true", "-c", "core.symlinks=false"]
    subprocess.check_call(["git", "clone", "-q", *windows, made, clone])
    links = [each.relative_to(made) for each in made.rglob("*") if each.is_symlink()]
    assert links and not any((clone / each).is_symlink() for each in links)
    assert not any(b"\r" in each.read_bytes() for each in clone.rglob("*.launch"))
    run_function("make_links", f"checkout='{clone}'; make_links")
    for each in links:
        assert os.readlink(clone / each) == os.readlink(made / each)


def test_a_new_plan_causes_no_build(tmp_path):
    """Only what CMake reads and links does."""
    for name in ("plans", "underlay", "src", "scripts/dev"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("CMakeLists.txt", "package.xml", "setup.py", "scripts/dev/loopback.c"):
        (tmp_path / name).touch()
    script = f"checkout='{tmp_path}'; list_sources /nowhere; "
    before = run_function("list_sources", script)
    for name, is_same in {
        "plans/mine.txt": True,
        "src/node.py": False,
        "underlay/package.xml": False,
        "urdf": False,
    }.items():
        (tmp_path / name).touch()
        after = run_function("list_sources", script)
        assert (after == before) == is_same, name
        before = after


def test_free_port():
    """The given one, if it is free; otherwise none that the system gives to a node."""
    with socket.socket() as used:
        used.bind(("127.0.0.1", 0))
        used.listen()
        port = used.getsockname()[1]
        others = [int(run_function("free_port", f"free_port {each}")) for each in ("", port)]
    assert all(10_000 <= each < 32_000 for each in others)
    assert int(run_function("free_port", f"free_port {others[0]}")) == others[0]


def test_all_users_can_read_the_build(tmp_path):
    script = f"""
        scratch={tmp_path} workspace={tmp_path}/workspace
        list_sources() {{ echo files; }}
        compile() {{ touch "$workspace/message"; }}
        lock() {{ true; }}
        unlock() {{ true; }}
        umask 077
        build
        stat -c %a "$workspace" "$workspace/message"
        umask"""
    assert run_function("build", script) == "755\n644\n0077\n"
