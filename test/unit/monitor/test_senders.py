"""Test how the plan of a node is found."""

import os

import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.monitor import senders
from mushr_ros_intro.monitor.senders import Sender, plan_of
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault


def sender(plan_file):
    return Sender("/ann", "", "http://localhost:1", {"plan_file": plan_file})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the working directory of the node, with a plan."""
    (tmp_path / "my_plan.txt").write_text("0,0,0\n1,0.1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(senders, "ask", lambda *_: os.getpid())
    return tmp_path


def test_a_relative_path_begins_in_the_directory_of_the_node(folder):
    """As with rosrun and open()."""
    assert plan_of(sender("my_plan.txt")).path == f"{folder}/my_plan.txt"
    assert plan_of(sender(f"{folder}/my_plan.txt")).path == f"{folder}/my_plan.txt"


@pytest.mark.parametrize("value", [None, "", 7])
def test_a_node_without_a_plan(value):
    assert plan_of(sender(value)) is None


def test_plans_that_cannot_be_read(folder, monkeypatch):
    with pytest.raises(UserError, match="no_plan"):
        plan_of(sender("no_plan"))

    def refuse(*_):
        raise CallError("connection refused", CallFault.REFUSED)

    monkeypatch.setattr(senders, "ask", refuse)
    with pytest.raises(UserError, match="the node has ended or is on another machine"):
        plan_of(sender("my_plan.txt"))
