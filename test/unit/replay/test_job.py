"""Check what happens if the process of a replay, or the node, is killed."""

import math
from types import SimpleNamespace

import pytest

from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.replay import job
from mushr_ros_intro.replay.job import Job, run_job
from mushr_ros_intro.replay.own_process import KilledError, ReplayError
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS
from support.recorded import PLAN, commands, replay, reported

RIGHT = reported(replay())
KILLED = reported(replay(outcome="the node was killed by signal SIGKILL; it printed nothing"))
CRASHED = reported(replay(outcome="the node was killed by signal SIGSEGV; it printed nothing"))
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
            run_job(replayed)
        assert raised.value is expected
    else:
        assert run_job(replayed) is expected
    assert left == []


class Standing:
    """A world, and the threads of its node, after the commands of a plan; nothing follows."""

    usages, ran, time_left = {}, 0.0, 1
    is_ending, silence = False, 0.0

    def __init__(self, sent):
        self.received, self.count = SimpleNamespace(commands=sent), len(sent)

    def observe(self, pace, left):
        assert left == self.time_left  # a stop may follow
        self.silence += 0.05
        self.ran += 0.05

    def fault(self, pace):
        return ""


def test_a_node_that_sends_no_stop():
    """It has driven the plan if nothing follows; it need not end."""
    world = Standing(commands())
    process = SimpleNamespace(has_ended=False, threads=world, excess=str)
    setting = SimpleNamespace(timeout=15.0)
    assert job._watch(process, world, Job("node", ("node",), PLAN, setting)) == ""
    assert world.silence == pytest.approx(job.DONE_AFTER, abs=0.06)


@pytest.mark.parametrize("timeout", [15.0, 80.0])
def test_a_node_that_hangs(timeout):
    """The message names both limits, because the load decides which one it exceeds first."""
    world = Standing(commands()[:4])
    process = SimpleNamespace(has_ended=False, threads=world, excess=str)
    setting = SimpleNamespace(timeout=timeout)
    message = job._watch(process, world, Job("node", ("node",), PLAN, setting))
    arrived = f" 4 of {count_commands(PLAN)} commands arrived, and then none for {timeout:g} s, "
    assert f"{arrived}or for 60 s of simulated time, although " in message
    assert world.silence == pytest.approx(min(timeout, 60.0), abs=0.06)


class Repeating(Standing):
    """The same, but the node sends on."""

    def observe(self, pace, left):
        assert self.count < 10_000, "the replay does not end"
        last = self.received.commands[-1]
        self.received.commands.append(last._replace(time=last.time + COMMAND_PERIOD))
        self.count += 1


def test_a_node_that_sends_on(monkeypatch):
    """Its drive ends at the same instant in all runs: 5 s after 1.5 times the plan's duration."""
    monkeypatch.setattr(job, "CHECK_PERIOD", math.inf)
    world = Repeating([*commands()])
    process = SimpleNamespace(has_ended=False, threads=world, excess=str)
    setting = SimpleNamespace(timeout=15.0)
    message = job._watch(process, world, Job("node", ("node",), PLAN, setting))
    assert message.startswith("the node still sends commands ")
    sent, limit = world.received.commands, PLAN.duration * 3 // 2 + 5 * NANOSECONDS
    assert 0 < sent[-1].time - sent[0].time - limit <= COMMAND_PERIOD


def test_a_node_that_sends_stops_on():
    """It has driven the plan if it sends only stops for 5 s; it may send them for ever."""
    world = Repeating([*commands()])
    begun = len(world.received.commands)
    world.received.commands.append(world.received.commands[-1]._replace(speed=0.0))
    process = SimpleNamespace(has_ended=False, threads=world, excess=str)
    setting = SimpleNamespace(timeout=15.0)
    assert job._watch(process, world, Job("node", ("node",), PLAN, setting)) == ""
    sent = world.received.commands
    seconds = (sent[-1].time - sent[begun].time) / NANOSECONDS
    assert job.STOPS_AFTER < seconds < job.STOPS_AFTER + 0.21


@pytest.mark.parametrize(
    ("first_line", "mode", "expected"),
    [
        ("#!/usr/bin/python3\n", 0o755, ["/usr/bin/python3"]),
        ("#! /usr/bin/env python3\n", 0o755, ["/usr/bin/env", "python3"]),
        ("#!/usr/bin/python3 -u -B\n", 0o755, ["/usr/bin/python3", "-u -B"]),
        ("#!/usr/bin/env python3 \t\n", 0o755, ["/usr/bin/env", "python3"]),
        ("#!/usr/bin/env python3\r\n", 0o755, ["/usr/bin/env", "python3\r"]),
        ("#!/usr/bin/python3\n", 0o644, []),
        ("#!/bin/bash\n", 0o755, []),
        ("import rospy\n", 0o755, []),
    ],
)
def test_interpreter(tmp_path, first_line, mode, expected):
    """A faulty first line has the same effect as without simulated time."""
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
