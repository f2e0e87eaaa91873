#!/usr/bin/python3
"""Test node: check which input of a mux wins. For .test files of any package.

The node sends commands to the inputs, step by step, and compares the output. The car stands: every
command has the speed 0, and the number of its input in hundredths of a radian as steering angle.
A failed step is repeated up to two times if messages were late by more than a period.

Parameters, all private:
    inputs: the topic of each input by its name, such as {teleop: /car/mux/input/teleop}; all are
        of ackermann_msgs/AckermannDriveStamped
    output: the topic that the mux publishes
    active: the topic of std_msgs/String with the name of the active input; if not set, the name is
        not checked
    steps: a list of {send: [names of inputs], wins: name}; send: [] and wins: idle mean silence
    hz: how often each input sends [Hz], default 10.0
    step_duration: [s of ROS time], default 1.0; the output counts in the second half of a step
    wait_time: how long to wait for the mux [s of wall-clock time], default 20.0
"""

import contextlib
from typing import List, Optional, Tuple

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.grading.checks import Series
from mushr_ros_intro.grading.steps import Step, parse_steps
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros.conversions import command_to_msg
from mushr_ros_intro.ros.node_test_case import NodeTestCase, main
from mushr_ros_intro.sim.mux_config import IDLE
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

_TRANSIT = 2.0
"""The longest time that a message takes [s of wall-clock time]."""

_TRIES = 3
"""How often a step is tried if messages are late."""


class MuxTest(NodeTestCase):
    """The test node."""

    def configure(self, parameters: Parameters) -> None:
        """Read the parameters, and connect to the mux."""
        inputs, self._steps = parse_steps(rospy.get_param("~", {}))
        output = parameters.text("output")
        active_topic = parameters.optional_text("active")
        self._period = 1.0 / parameters.number("hz", 10.0, "Hz", 1e-3, 1e6)
        self._duration = parameters.number("step_duration", 1.0, "s", 1e-3, 1e6)

        self._outputs = Series()
        self._delays: List[float] = []
        """By how much the messages of a step were late [s]."""
        self._active: Optional[str] = None
        """The name of the active input; None if it is not published."""
        self._names = list(inputs)
        self._publishers = {
            name: rospy.Publisher(topic, AckermannDriveStamped, queue_size=10, tcp_nodelay=True)
            for name, topic in inputs.items()
        }
        subscriber = self.subscribe(output, AckermannDriveStamped, self._take)
        for publisher in self._publishers.values():
            topic = publisher.resolved_name
            self.wait_for(publisher.get_num_connections, f"a subscriber of {topic}")
        topic = subscriber.resolved_name
        self.wait_for(subscriber.get_num_connections, f"a publisher of {topic}")
        if active_topic is not None:
            topic = self.subscribe(active_topic, String, self._take_active).resolved_name
            self.wait_for(lambda: self._active, f"a message on {topic}")

    def test_mux(self) -> None:
        """The expected input wins in every step."""
        self.fail_with([fault for step in self._steps for fault in self._judge(step)])

    def _judge(self, step: Step) -> List[str]:
        """Return what goes wrong in a step, which is repeated if messages are late."""
        for _ in range(_TRIES):
            faults = self._try(step)
            if not faults or max(self._delays) <= self._period:
                return faults
        delay = f"messages were up to {max(self._delays):.1f} s late in each of {_TRIES} tries"
        return [*faults, f"{step.name}: {delay}; the machine may be too busy for this test"]

    def _try(self, step: Step) -> List[str]:
        """Send the commands of a step; return what goes wrong."""
        self._delays = [0.0]
        middle, end = self._send(step.send)
        with contextlib.suppress(AssertionError):  # which the comparison below explains
            self.wait_for(lambda: self._agrees(step.wins, end), step.name, _TRANSIT)
        active = self._active
        found = {name for stamp, name in self._outputs.entries if middle <= stamp < end}
        faults = []
        if found != {step.wins} - {IDLE}:
            output = " and ".join(sorted(found)) or IDLE
            faults.append(f"{step.name}: the output is {output}; expected {step.wins}")
        if active not in (None, step.wins):
            faults.append(f"{step.name}: the active input is {active}; expected {step.wins}")
        return faults

    def _agrees(self, wins: str, end: int) -> bool:
        """Return whether the expected input drove until `end` [ns], as far as is known yet."""
        last = end - 2 * from_seconds(self._period)
        has_driven = any(name == wins and stamp >= last for stamp, name in self._outputs.entries)
        return self._active in (None, wins) and (has_driven or wins == IDLE)

    def _send(self, names: List[str]) -> Tuple[int, int]:
        """Send commands to some inputs for one step; return its middle and its end [ns]."""
        due = begin = rospy.get_time()
        end = begin + self._duration
        while due < end:
            self._delays.append(rospy.get_time() - due)
            stamp = rospy.get_rostime().to_nsec()
            for name in names:
                angle = 0.01 * (1 + self._names.index(name))
                self._publishers[name].publish(command_to_msg(Command(stamp, 0.0, angle), ""))
            due += self._period
            self.wait_for(
                lambda due=due: rospy.get_time() >= min(due, end),  # type: ignore[misc]
                f"{self._period:g} s to pass on the clock",
                self.patience + 10.0 * self._period,
            )
        return from_seconds(0.5 * (begin + end)), from_seconds(end)

    def _take(self, msg: AckermannDriveStamped) -> None:
        """Add the name of the input that drives; ignore stops."""
        number = round(100.0 * msg.drive.steering_angle)
        if msg.drive.speed == 0.0 and number == 0:
            return
        is_known = msg.drive.speed == 0.0 and 0 < number <= len(self._names)
        now = rospy.get_rostime().to_nsec()
        stamp = msg.header.stamp.to_nsec() or now
        self._delays.append((now - stamp) / NANOSECONDS)
        self._outputs.add(stamp, self._names[number - 1] if is_known else "an unknown command")

    def _take_active(self, msg: String) -> None:
        """Keep the name of the active input."""
        self._active = msg.data


if __name__ == "__main__":
    main("muxtest", MuxTest)
