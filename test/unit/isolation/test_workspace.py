"""Check the copies of the user's workspaces, and the environment of nodes."""

import os
import stat

import pytest

from mushr_ros_intro.isolation.workspace import copy_workspaces, environment_of

XML = "<package><name>{}</name></package>"
VARIABLES = ("CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH", "ROS_PACKAGE_PATH")


@pytest.fixture
def readable():
    """Let all users read what the test writes, also if the user's umask is 077."""
    umask = os.umask(0o022)
    yield
    os.umask(umask)


def write(path, text="", mode=0o644):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(mode)


def test_copies(tmp_path, monkeypatch, readable):
    """All that a node needs is in the copies, and readable; all else is not."""
    home, copies = tmp_path / "home", tmp_path / "copies"
    package, devel = home / "ws" / "src" / "course", home / "ws" / "devel"
    write(package / "package.xml", XML.format("course"))
    write(package / "setup.py")
    write(package / "src" / "course" / "__init__.py")
    write(package / "scripts" / "node", "#!/bin/sh", 0o4700 | 0o044)
    write(package / "solution.py", mode=0o600)
    write(package / "plans" / "hidden.txt")
    write(package / ".git" / "config")
    (package / "nowhere").symlink_to("/nowhere")
    write(devel / ".catkin")
    write(devel / "lib" / "mushr_ros_intro" / "path_publisher.py")
    modules = devel / "lib" / "python3" / "dist-packages"
    write(modules / "course_msgs" / "__init__.py")
    text = "set(course_SOURCE_PREFIX {0})\nset(course_DEVEL_PREFIX {1})\nset(other {0}_2)\n"
    config = "share/course/courseConfig.cmake"
    write(devel / config, text.format(package, devel))
    library = home / "mushr_ros_intro"
    write(library / "package.xml", XML.format("mushr_ros_intro"))
    write(library / "setup.py")
    write(library / "src" / "path_publisher.py")
    write(library / "src" / "mushr_ros_intro" / "__init__.py")
    (home / "ws" / "src" / "mushr_ros_intro").symlink_to(library)
    home.chmod(0o700)
    copies.mkdir()

    values = (f"{devel}:/usr", f"{devel}/lib", f"{modules}:/usr/lib/x", f"{home}/ws/src:/usr/share")
    for name, value in zip(VARIABLES, values):
        monkeypatch.setenv(name, value)
    ros = copy_workspaces(str(copies), "/place", [str(package / "plans")])

    found = {
        os.path.join(*path.relative_to(copies).parts[1:]): path
        for path in copies.rglob("*")
        if path.is_file()
    }
    assert set(found) == {
        *(".catkin", config, "lib/python3/dist-packages/course_msgs/__init__.py"),
        *("package.xml", "setup.py", "src/course/__init__.py", "scripts/node"),
    }
    for path in copies.rglob("*"):
        mode = stat.S_IMODE(path.stat().st_mode)
        runs = path.is_dir() or path.name == "node"
        assert mode == (0o755 if runs else 0o644), path
    number = {name: path.relative_to(copies).parts[0] for name, path in found.items()}
    built, source = f"/place/{number['.catkin']}", f"/place/{number['package.xml']}"
    assert found[config].read_text() == text.format(source, built).replace(
        f"{source}_2", f"{package}_2"
    )
    assert {name: ros[name] for name in VARIABLES} == {
        "CMAKE_PREFIX_PATH": f"{built}:/usr",
        "LD_LIBRARY_PATH": f"{built}/lib",
        "PYTHONPATH": f"{source}/src:{built}/lib/python3/dist-packages:/usr/lib/x",
        "ROS_PACKAGE_PATH": f"{source}:/usr/share",
    }


def test_no_workspace(tmp_path, monkeypatch):
    """As with Debian's packages of this package."""
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert copy_workspaces(str(tmp_path), "/place", [])["ROS_PACKAGE_PATH"] == ""


def test_environment(monkeypatch):
    """Nothing of the user's own, but what ROS needs, also on Noetic."""
    monkeypatch.setenv("ROS_LOG_DIR", "/home/me")
    monkeypatch.setenv("SECRET", "1")
    environment = environment_of({"LD_LIBRARY_PATH": "/opt/ros/noetic/lib"})
    assert environment["LD_LIBRARY_PATH"] == "/opt/ros/noetic/lib"
    assert not {"ROS_LOG_DIR", "SECRET", "HOME"} & set(environment)
