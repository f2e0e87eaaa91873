#!/usr/bin/python3
"""Test node: check that messages have evenly spaced stamps. For .test files of any package.

Parameters, all private:
    topic: of any type with a header
    hz: expected rate [Hz], default 10.0
    jitter: allowed deviation of the time between two stamps [s], default half a period
    plan_file: the path of a plan whose first row begins with the first message. Each row must have
        its number of messages, such as ten for one second. If not set, there are no rows.
    test_duration: how long to listen from the first message on, by the stamps [s], default 5.0, or
        one second longer than the plan
    wait_time: how long to wait for the first message [s of wall-clock time], default 20.0
"""

from typing import Any, List

import rospy

from mushr_ros_intro.parameters import Parameters, user_path
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.replay.checks import plan_faults, rate_faults
from mushr_ros_intro.replay.node_test_case import NodeTestCase, main
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds

_MAX_FAULTS = 5
"""How many faults a failure shows."""


class RateTest(NodeTestCase):
    """The test node."""

    def configure(self, parameters: Parameters) -> None:
        """Read the parameters."""
        self._topic = rospy.resolve_name(parameters.text("topic"))
        period = 1.0 / parameters.number("hz", 10.0, "Hz", 1e-6, 1e6)
        self._period = from_seconds(period)
        self._jitter = from_seconds(parameters.number("jitter", 0.5 * period, "s", 0.0, 1e6))
        self._rows: List[int] = []
        duration = 5.0
        plan_file = parameters.optional_text("plan_file")
        if plan_file is not None:
            plan = read_plan(user_path(plan_file))
            self._rows = [row.duration for row in plan.rows]
            duration = plan.duration / NANOSECONDS + 1.0
        self._duration = parameters.number("test_duration", duration, "s", 0.0, 1e6)

    def test_rate(self) -> None:
        """The stamps are evenly spaced, and every row has its messages."""
        self.listen(self._topic, self._take)
        self.wait_for_series(f"a message on {self._topic}", self._duration)
        stamps = [stamp for stamp, _ in self.series.entries]
        if self._rows:
            faults = plan_faults(stamps, self._rows, self._period, self._jitter)
        else:
            duration = from_seconds(self._duration)
            faults = rate_faults(stamps, duration, self._period, self._jitter)
        lines = [f"{self._topic}: {fault}" for fault in faults[:_MAX_FAULTS]]
        if len(faults) > _MAX_FAULTS:
            lines.append(f"and {len(faults) - _MAX_FAULTS} more")
        if lines:
            self.fail("\n".join(lines))

    def _take(self, msg: Any) -> None:
        """Add the stamp of a message."""
        if not msg._has_header:
            self.error = f"{self._topic} has the type {msg._type}; expected a type with a header"
        elif not msg.header.stamp:
            self.error = f"a message on {self._topic} has no stamp; expected one in each"
        else:
            self.series.add(msg.header.stamp.to_nsec(), None)


if __name__ == "__main__":
    main("ratetest", RateTest)
