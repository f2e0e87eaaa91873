"""Check the defaults of the command line of grade.py."""

import os

from mushr_ros_intro.classroom.arguments import parse_arguments


def test_replays_at_the_same_time(monkeypatch):
    """They share the processors that this process may use, not all of the machine."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 7, 8})
    words = ["plan.txt", "--node", "my_ros_intro", "path_publisher.py"]
    assert parse_arguments(words, "").jobs == 6
