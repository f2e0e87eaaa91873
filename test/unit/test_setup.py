"""Parts of scripts/setup that can be tested without an installation."""

import os
import socket
import subprocess

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
    function = f"sed -n '/^{name}()/,/^}}/p' '{CHECKOUT}/scripts/setup'"
    command = ["bash", "-euc", f'eval "$({function})"; {script}']
    return subprocess.check_output(command, input=given, text=True)


def test_the_progress_of_apt_get():
    assert run_function("show_progress", 'say() { echo "$*"; }; show_progress', APT) == SHOWN


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
        umask 077
        build
        stat -c %a "$workspace" "$workspace/message"
        umask"""
    assert run_function("build", script) == "755\n644\n0077\n"
