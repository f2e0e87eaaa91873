#!/usr/bin/python3
"""Let a node drive a plan on the simulated car, and judge it: the test node of replay.test.

The results are written as a JUnit file with one test case for each check. The verdict is also
published on ``~verdict`` (std_msgs/String, latched). rostest hides the output of test nodes, so
another node, replay_check.py --show, prints it on the terminal.
"""

import os
import sys
from typing import Sequence
from xml.etree import ElementTree

import rospy
from std_msgs.msg import String

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.grading.judge import Check
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.replay import replay
from mushr_ros_intro.ros.ros_time import wait_for

SHOW_TIMEOUT = 5.0
"""Longest wait until the verdict has been printed [s of wall-clock time]."""


def show() -> int:
    """Print the verdict; return 0."""
    node.init_node("verdict")
    print(rospy.wait_for_message("/replay/verdict", String).data, flush=True)
    return 0


def publish(text: str) -> None:
    """Publish the verdict, and wait until it has been printed."""
    publisher = rospy.Publisher("~verdict", String, queue_size=1, latch=True)
    publisher.publish(text)
    if wait_for(publisher.get_num_connections, SHOW_TIMEOUT):
        wait_for(lambda: not publisher.get_num_connections(), SHOW_TIMEOUT)


def write_results(path: str, checks: Sequence[Check], text: str) -> None:
    """Write a JUnit file. It is complete, or it does not exist, which rostest reports as an error.

    Args:
        path: of the file.
        checks: the checks, which become test cases.
        text: the verdict.
    """
    failures = sum(not check.passed for check in checks)
    counts = {"tests": str(len(checks)), "failures": str(failures), "errors": "0", "time": "0"}
    suite = ElementTree.Element("testsuite", {"name": "replay", **counts})
    for check in checks:
        names = {"classname": "replay", "name": check.name, "time": "0"}  # rosunit reads the time
        case = ElementTree.SubElement(suite, "testcase", names)
        if not check.passed:
            ElementTree.SubElement(case, "failure", type="").text = check.message
    ElementTree.SubElement(suite, "system-out").text = text
    ElementTree.ElementTree(suite).write(f"{path}.part", encoding="utf-8")
    os.replace(f"{path}.part", path)


def main() -> int:
    """Judge a node; return 0 if it passes all checks, else 1."""
    node.init_node("replay")
    path = next(each for each in sys.argv if each.startswith("--gtest_output=xml:"))[19:]
    try:
        report = replay()
        checks, text = report.checks, report.verdict
    except (UserError, OSError) as error:
        checks = [Check("replay", False, f"the replay failed: {error}")]
        text = checks[0].message
    print(text)
    publish(text)
    write_results(path, checks, text)
    return int(not all(check.passed for check in checks))


if __name__ == "__main__":
    sys.exit(show() if "--show" in sys.argv else main())
