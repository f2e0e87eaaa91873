"""Check which builds of a submission are its own fault."""

from types import SimpleNamespace

import pytest

from mushr_ros_intro.classroom import grader
from mushr_ros_intro.replay.own_process import ReplayError


@pytest.fixture
def build(tmp_path):
    """Return a function that builds a package with a command of the shell, without a sandbox."""
    folder = str(tmp_path)
    submission = SimpleNamespace(folder=folder, packages=(folder,))

    def run(command):
        sandbox = SimpleNamespace(folder=folder, enter=bool, end_processes=bool)
        sandbox.wrap = lambda *arguments, **options: ["sh", "-c", command]
        return grader._build_here(submission, SimpleNamespace(sandbox=sandbox, ros={}))

    return run


def test_a_build_that_is_right(build):
    assert build("echo Errors: 0") == ""


def test_a_build_that_fails(build):
    fault = build("echo first; echo CMake Error; echo '  no such file'; echo last; false")
    assert fault.startswith("the package does not build: CMake Error no such file\nfirst\n")


def test_a_build_that_computes_for_ever(build):
    """Its limit of processor time kills it."""
    fault = build("sh -c 'kill -KILL $$'; false")
    assert fault == "the package does not build: Killed\nKilled"


def test_a_build_that_waits_for_ever(build, monkeypatch):
    """This cannot be told from a busy machine, so the submission is not graded."""
    monkeypatch.setattr(grader, "TIMEOUT", 0.1)
    with pytest.raises(ReplayError, match="the build of the package did not end within 0.1 s"):
        build("exec sleep 300")
