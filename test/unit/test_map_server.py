"""Check that map_server.py finds ROS's own map_server if it is installed."""

import os
import subprocess

from support.paths import PACKAGE

SOURCES = os.path.join(PACKAGE, "src")
FIND = "import map_server; print(map_server.find_real_map_server())"


def find(folder):
    """Return the path of the real map_server that the node finds with packages in `folder`."""
    environment = dict(os.environ)
    for name, first in (("ROS_PACKAGE_PATH", str(folder)), ("PYTHONPATH", SOURCES)):
        environment[name] = f"{first}:{os.environ.get(name, '')}"
    command = ["/usr/bin/python3", "-c", FIND]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
    return done.stdout.decode().strip()


def test_not_installed(tmp_path):
    assert find(tmp_path) == "None"


def test_installed(tmp_path):
    package = tmp_path / "map_server"
    package.mkdir()
    (package / "package.xml").write_text(
        "<package><name>map_server</name><version>1.0.0</version><description>a stand-in"
        "</description><maintainer email='a@b.c'>a</maintainer><license>BSD</license></package>"
    )
    (package / "map_server").write_text("#!/bin/sh\n")
    (package / "map_server").chmod(0o755)
    assert find(tmp_path) == str(package / "map_server")
