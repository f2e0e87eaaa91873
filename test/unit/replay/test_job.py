"""Check what happens if the process of a replay, or the node, is killed."""

import os
import sys
from types import SimpleNamespace

import pytest
import yaml

from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.replay import job
from mushr_ros_intro.replay.job import Job, record
from mushr_ros_intro.replay.own_process import KilledError, ReplayError
from mushr_ros_intro.replay.setting import read_setting
from support.paths import PACKAGE
from support.recorded import PLAN, replay

RIGHT = replay()
KILLED = replay(outcome="the node was killed by signal SIGKILL; it printed nothing")
CRASHED = replay(outcome="the node was killed by signal SIGSEGV; it printed nothing")
DIED, FAILED = KilledError("its process ended"), ReplayError("no space left on device")


@pytest.mark.parametrize(
    ("results", "expected"),
    [
        ([RIGHT], RIGHT),
        ([DIED, RIGHT], RIGHT),
        ([DIED, DIED], DIED),
        ([KILLED, RIGHT], RIGHT),
        ([KILLED, KILLED], KILLED),
        ([KILLED, DIED], DIED),
        ([CRASHED], CRASHED),
        ([FAILED], FAILED),
    ],
)
def test_a_killed_replay_is_repeated_once(monkeypatch, results, expected):
    left = list(results)

    def run(*_, **__):
        result = left.pop(0)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(job, "in_own_process", run)
    replayed = Job("node", ("node",), PLAN, None)
    if isinstance(expected, Exception):
        with pytest.raises(type(expected)) as raised:
            record(replayed)
        assert raised.value is expected
    else:
        assert record(replayed) is expected
    assert left == []


@pytest.mark.parametrize(
    ("first_line", "mode", "expected"),
    [
        ("#!/usr/bin/python3\n", 0o755, ["/usr/bin/python3"]),
        ("#! /usr/bin/env python3\n", 0o755, ["/usr/bin/env", "python3"]),
        ("#!/usr/bin/python3 -u -B\n", 0o755, ["/usr/bin/python3", "-u -B"]),
        ("#!/usr/bin/env python3 \t\n", 0o755, ["/usr/bin/env", "python3"]),
        ("#!/usr/bin/env python3\r\n", 0o755, ["/usr/bin/env", "python3\r"]),
        ("#!/usr/bin/env python\n", 0o755, [sys.executable]),
        ("#!/bin/env -S python -u\n", 0o755, [sys.executable]),
        ("#!python\n", 0o755, ["python"]),
        ("#!/usr/bin/python3\n", 0o644, []),
        ("#!/bin/bash\n", 0o755, []),
        ("import rospy\n", 0o755, []),
    ],
)
def test_interpreter(tmp_path, monkeypatch, first_line, mode, expected):
    """A faulty first line has the same effect as without simulated time."""
    monkeypatch.setenv("PATH", str(tmp_path))  # where no node finds a program
    path = tmp_path / "node.py"
    path.write_bytes(first_line.encode() + b"import sys\n")
    path.chmod(mode)
    assert job.interpreter_of(str(path)) == expected


def test_hashes_are_the_same_in_each_run(tmp_path):
    """The order of a set depends on them."""
    node, plan = tmp_path / "node.py", tmp_path / "my.txt"
    node.write_text("#!/usr/bin/python3\n")
    node.chmod(0o755)
    plan.write_text("1,2,0.5\n")
    setting = SimpleNamespace(remap=(), ros={}, sandbox=Sandbox())
    replayed = Job("node", (str(node),), PLAN._replace(path=str(plan)), setting)
    (tmp_path / "replay").mkdir()
    command = job.sandboxed(replayed, str(tmp_path / "replay"), 5)
    assert "PYTHONHASHSEED=0" in command
    assert command[command.index("-c") + 2 :][:2] == ["5", str(node)]


@pytest.mark.parametrize("name", ["week 3: slalom.txt", "plan #2.txt", "a'b.txt"])
def test_the_node_gets_the_path_of_the_plan_as_text(tmp_path, name):
    """rospy reads the values of arguments as YAML."""
    (tmp_path / name).write_text("0,0,0\n1,0\n")
    setting = read_setting(
        PACKAGE, "ideal", "none", remap=(), tolerances={}, sandbox=Sandbox(), ros={}
    )
    replay = Job("node", ("/bin/true",), read_plan(str(tmp_path / name)), setting)
    folder = tmp_path / "empty"
    folder.mkdir()
    *_, argument = job.sandboxed(replay, str(folder))
    path = yaml.safe_load(argument.partition(":=")[2])
    assert os.path.dirname(path) == str(folder) and os.path.isfile(path)
