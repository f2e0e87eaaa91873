#!/usr/bin/python3
"""Test node: do messages come evenly, by their stamps? For .test files of any package.

Parameters, all private:
    topic: of any kind whose messages have a header
    hz: how often a message is to come [Hz], default 10.0
    jitter: how far a stamp may be from where it belongs [s], default half a period
    plan_file: the path of a plan, whose first row begins with the first message; each row is to
        have its messages, such as ten for a second; none, if not given
    test_duration: for how long to listen [s by the stamps from the first message on], default that
        of the plan and a second more, or 5.0
    wait_time: for how long to wait for the first message [s of wall-clock time], default 20.0
"""

import unittest
from typing import List

import roslib.message
import rospy
import rostest

from mushr_ros_intro.grading.checks import Series, as_number, rate_faults, wait_for
from mushr_ros_intro.parameters import ParameterError, number, text
from mushr_ros_intro.plan.find import read_plan
from mushr_ros_intro.plan.model import PlanError
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

_SHOWN = 5
"""How many faults are said."""


class RateTest(unittest.TestCase):
    """The test node."""

    def setUp(self) -> None:
        """Read the parameters."""
        self._messages = Series()
        self._trouble = ""

        def parameter(name: str, default: float, unit: str, least: float) -> float:
            value = as_number(rospy.get_param(f"~{name}", default))
            return number(f"~{name}", value, unit, least, 1e6)

        try:
            self._topic = rospy.resolve_name(text("~topic", rospy.get_param("~topic", None)))
            self._period = from_seconds(1.0 / parameter("hz", 10.0, "Hz", 1e-6))
            half = 0.5 * self._period / NANOSECONDS
            self._jitter = from_seconds(parameter("jitter", half, "s", 0.0))
            self._durations: List[int] = []
            duration = 5.0
            if rospy.has_param("~plan_file"):
                plan = read_plan(text("~plan_file", rospy.get_param("~plan_file")))
                self._durations = [row.duration for row in plan.rows]
                duration = plan.duration / NANOSECONDS + 1.0
            self._duration = parameter("test_duration", duration, "s", 0.0)
            self._patience = parameter("wait_time", 20.0, "s", 0.0)
        except (ParameterError, PlanError) as error:
            self.fail(str(error))

    def test_rate(self) -> None:
        """The messages come as often as they are to, in every row."""
        subscriber = rospy.Subscriber(self._topic, rospy.AnyMsg, self._take, tcp_nodelay=True)
        self.addCleanup(subscriber.unregister)
        wait_for(
            lambda: self._messages.entries or self._trouble,
            f"a message on {self._topic}",
            self._patience,
        )
        duration = from_seconds(self._duration)
        wait_for(
            lambda: self._trouble or self._messages.covers(duration, rospy.get_rostime().to_nsec()),
            f"{self._duration:g} s to pass on the clock",
            self._patience + 10.0 * self._duration,
        )
        if self._trouble:
            self.fail(self._trouble)
        stamps = [stamp for stamp, _ in self._messages.entries]
        faults = rate_faults(stamps, self._durations, self._period, self._jitter)
        if self._durations:
            # What comes after the plan, such as a stop, is not the plan's.
            last = stamps[0] + sum(self._durations)
            within = [stamp for stamp in stamps if stamp <= last]
            faults = rate_faults(within, self._durations, self._period, self._jitter)
        elif len(stamps) < self._duration * NANOSECONDS / self._period - 2:
            faults.append(f"{len(stamps)} messages came in {self._duration:g} s")
        if faults:
            more = [f"and {len(faults) - _SHOWN} more"] if len(faults) > _SHOWN else []
            self.fail("\n".join([f"on {self._topic}:", *faults[:_SHOWN], *more]))

    def _take(self, msg: rospy.AnyMsg) -> None:
        """Note the stamp of a message."""
        kind = msg._connection_header["type"]
        message_class = roslib.message.get_message_class(kind)
        if message_class is None or getattr(message_class, "_has_header", False) is False:
            self._trouble = f"{self._topic} is a {kind}, which has no header; expected one"
            return
        stamp = message_class().deserialize(msg._buff).header.stamp.to_nsec()
        if stamp == 0:
            self._trouble = f"a message on {self._topic} has no stamp; expected one in each"
        self._messages.add(stamp, None)


if __name__ == "__main__":
    init_node("ratetest")
    rostest.rosrun("mushr_ros_intro", "ratetest", RateTest)
