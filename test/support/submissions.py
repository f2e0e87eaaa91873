"""Write submissions, and collect them."""

import os
import stat
import zipfile

import pytest

from mushr_ros_intro.classroom import submission_check
from mushr_ros_intro.classroom.submissions import collect

NODE = b"#!/usr/bin/python3\nprint('hello')\n"
XML = b"<package><name>intro</name></package>"
PUBLISHER = "src/path_publisher.py"
PACKAGE = {"package.xml": XML, PUBLISHER: NODE}
LINK = stat.S_IFLNK | 0o777


@pytest.fixture
def unchecked(monkeypatch):
    """Compile no node, and look for no hidden module; see test_submission_check."""
    for name in ("faults_of", "hiding_faults"):
        monkeypatch.setattr(submission_check, name, lambda *_, **__: ())


def inside(folder, files=PACKAGE):
    return {f"{folder}/{name}": content for name, content in files.items()}


def fill(folder, files, node_mode=0o755):
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        path.chmod(node_mode if content.startswith(b"#!") else 0o600)
    return str(folder)


def zipped(path, files, system=3, mode=0o755, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name)
            info.create_system = system
            info.external_attr = (mode if mode == LINK else stat.S_IFREG | mode) << 16
            archive.writestr(info, content, compression)
            info.external_attr *= bool(mode)  # after writestr, which sets its own value for 0
    return str(path)


def zip_bytes(folder, files=PACKAGE, **how):
    path = folder / "inner.zip"
    zipped(path, files, **how)
    return path.read_bytes()


def collected(top, *paths):
    """Collect paths in the folder `top` to top/workspace, and return the submissions.

    Check that nothing is written outside of the workspace, and that the result agrees in itself.
    """
    workspace = top / "workspace"
    workspace.mkdir(exist_ok=True)

    def listing():
        return [path for path in sorted(top.rglob("*")) if workspace not in path.parents]

    before = listing()
    found = collect([str(top / each) for each in paths], str(workspace))
    assert listing() == before
    assert not (workspace / ".unpacked").exists()
    for each in found:
        assert bool(each.fault) != bool(each.command)
        folder = str(workspace / each.name) + os.sep
        assert all((path + os.sep).startswith(folder) for path in each.command + each.packages)
    return found


def only(top, path):
    """Collect a path that is one submission, and return this submission."""
    found = collected(top, path)
    assert len(found) == 1
    return found[0]
