#!/usr/bin/python3
"""Let a node drive a plan on the simulated car, and judge it: the test node of replay.test."""

import unittest
from typing import Dict, Optional

import rostest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.grading import judge
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.replay import replay


class ReplayTest(unittest.TestCase):
    """One test case for each check."""

    _checks: Optional[Dict[str, judge.Check]] = None
    _error = ""

    def setUp(self) -> None:
        """Run the replay, once for all test cases."""
        cls = type(self)
        if cls._checks is None and not cls._error:
            try:
                cls._checks = {check.name: check for check in replay()[1]}
            except (UserError, OSError) as error:
                cls._error = f"the replay failed: {error}"
        if cls._error:
            self.fail(cls._error)

    def _assert_check(self, name: str) -> None:
        """Fail if a check has not passed; otherwise print its message."""
        assert self._checks is not None
        check = self._checks[name]
        if not check.passed:
            self.fail(check.message)
        print(f"{name}: {check.message}")

    def test_node(self) -> None:
        """The node starts, drives, and ends without an error."""
        self._assert_check("node")

    def test_start_pose(self) -> None:
        """The node sends the plan's start pose, and the car reports it."""
        self._assert_check("start_pose")

    def test_commands(self) -> None:
        """The commands are those of the plan, in its order."""
        self._assert_check("commands")

    def test_rate(self) -> None:
        """Every row has ten commands per second for its duration."""
        self._assert_check("rate")

    def test_path(self) -> None:
        """The driven path is close to the predicted path everywhere."""
        self._assert_check("path")

    def test_final_pose(self) -> None:
        """The car ends at the predicted final pose."""
        self._assert_check("final_pose")

    def test_rest(self) -> None:
        """The car is at rest at the end."""
        self._assert_check("rest")

    def test_collision(self) -> None:
        """The car touches no wall."""
        self._assert_check("collision")

    def test_map(self) -> None:
        """The car stays on the map."""
        self._assert_check("map")


if __name__ == "__main__":
    node.init_node("replay")
    rostest.rosrun("mushr_ros_intro", "replay", ReplayTest)
