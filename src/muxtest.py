#!/usr/bin/python3
"""Test node: which input of a mux wins when? For .test files of any package.

It sends commands to the inputs, step by step, and looks at what comes out. The car stands: every
command has the speed 0, and the input's number in hundredths of a radian as its steering angle.
A step that goes wrong while messages are late by more than a period is done up to three times.

Parameters, all private:
    inputs: the topic of each input by its name, such as {teleop: /car/mux/input/teleop}; all are
        of ackermann_msgs/AckermannDriveStamped
    output: the topic that the mux publishes
    active: the topic of std_msgs/String on which it says who drives; none, if not given
    steps: a list of what to do, each {send: [names of inputs], wins: name}; send: [] and
        wins: idle stand for silence
    hz: how often each input sends [Hz], default 10.0
    step_duration: [s on ROS's clock], default 1.0; the first half of a step is for the change
    wait_time: for how long to wait for the mux [s of wall-clock time], default 20.0
"""

import contextlib
import functools
import unittest
from typing import Any, Dict, List, Tuple

import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.grading.checks import Series, as_number, wait_for
from mushr_ros_intro.parameters import ParameterError, number, text
from mushr_ros_intro.ros.conversions import command_to_msg
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.mux_config import IDLE
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

_ON_ITS_WAY = 2.0
"""How long a message may take [s of wall-clock time]."""

_TRIES = 3
"""How often a step is done that goes wrong while messages are late, on a busy machine."""


class MuxTest(unittest.TestCase):
    """The test node."""

    def setUp(self) -> None:
        """Read the parameters, and connect to the mux."""
        self._outputs = Series()
        self._delays: List[float] = []
        self._active = ""

        def parameter(name: str, default: float, unit: str) -> float:
            value = as_number(rospy.get_param(f"~{name}", default))
            return number(f"~{name}", value, unit, 1e-3, 1e6)

        try:
            inputs, self._steps = _checked(
                rospy.get_param("~inputs", None), rospy.get_param("~steps", None)
            )
            output = text("~output", rospy.get_param("~output", None))
            self._active_topic = rospy.get_param("~active", "")
            self._period = 1.0 / parameter("hz", 10.0, "Hz")
            self._duration = parameter("step_duration", 1.0, "s")
            self._patience = parameter("wait_time", 20.0, "s")
        except ParameterError as error:
            self.fail(str(error))
        self._names = list(inputs)
        self._publishers = {
            name: rospy.Publisher(topic, AckermannDriveStamped, queue_size=10, tcp_nodelay=True)
            for name, topic in inputs.items()
        }
        subscriber = rospy.Subscriber(output, AckermannDriveStamped, self._take, tcp_nodelay=True)
        for publisher in self._publishers.values():
            topic = publisher.resolved_name
            wait_for(publisher.get_num_connections, f"a subscriber of {topic}", self._patience)
        topic = subscriber.resolved_name
        wait_for(subscriber.get_num_connections, f"a publisher of {topic}", self._patience)
        if self._active_topic:
            rospy.Subscriber(self._active_topic, String, self._take_active)
            topic = rospy.resolve_name(self._active_topic)
            wait_for(lambda: self._active, f"a message on {topic}", self._patience)

    def test_mux(self) -> None:
        """In every step the input wins that is to."""
        faults: List[str] = []
        for place, (send, wins) in enumerate(self._steps, 1):
            what = f"step {place}, in which {' and '.join(send) or 'nobody'} send"
            for _ in range(_TRIES):
                found = self._try(what, send, wins)
                if not found or max(self._delays) <= self._period:
                    break
            else:
                found.append(
                    f"{what}: messages were up to {max(self._delays):.1f} s late, in each of "
                    f"{_TRIES} tries; the machine may be too busy to tell"
                )
            faults += found
        if faults:
            self.fail("\n".join(faults))

    def _try(self, what: str, send: List[str], wins: str) -> List[str]:
        """Do a step, and note by how much its messages are late [s]; return what goes wrong."""
        self._delays = [0.0]
        middle, end = self._send(send)
        # What has been sent, and who is said to drive, may still be on its way.
        with contextlib.suppress(AssertionError):
            wait_for(functools.partial(self._agrees, wins, end), what, _ON_ITS_WAY)
        active = self._active
        stamped = (name for stamp, name in self._outputs.entries if middle <= stamp < end)
        came = sorted(set(stamped))
        expected = [] if wins == IDLE else [wins]
        faults = []
        if came != expected:
            faults.append(
                f"{what}: {' and '.join(came) or 'nothing'} came out; "
                f"expected {' and '.join(expected) or 'nothing'}"
            )
        if self._active_topic and active != wins:
            faults.append(f"{what}: {active} is said to drive; expected {wins}")
        return faults

    def _agrees(self, wins: str, end: int) -> bool:
        """Say whether the input that is to win until `end` [ns] has been seen to."""
        is_named = not self._active_topic or self._active == wins
        last = end - 2 * from_seconds(self._period)
        came = (name == wins and stamp >= last for stamp, name in self._outputs.entries)
        return is_named and (wins == IDLE or any(came))

    def _send(self, names: List[str]) -> Tuple[int, int]:
        """Send commands on some inputs for a step; return its middle and its end [ns]."""
        due = begin = rospy.get_time()
        end = begin + self._duration
        while due < end:
            self._delays.append(rospy.get_time() - due)
            stamp = rospy.get_rostime().to_nsec()
            for name in names:
                angle = 0.01 * (1 + self._names.index(name))
                self._publishers[name].publish(command_to_msg(Command(stamp, 0.0, angle), ""))
            due += self._period
            wait_for(
                lambda due=due: rospy.get_time() >= min(due, end),  # type: ignore[misc]
                f"{self._period:g} s to pass on the clock",
                self._patience + 10.0 * self._period,
            )
        return from_seconds(0.5 * (begin + end)), from_seconds(end)

    def _take(self, msg: AckermannDriveStamped) -> None:
        """Note whose command came out; a stop is nobody's."""
        place = round(100.0 * msg.drive.steering_angle)
        if msg.drive.speed == 0.0 and place == 0:
            return
        is_known = msg.drive.speed == 0.0 and 0 < place <= len(self._names)
        now = rospy.get_rostime().to_nsec()
        stamp = msg.header.stamp.to_nsec() or now
        self._delays.append((now - stamp) / NANOSECONDS)
        self._outputs.add(stamp, self._names[place - 1] if is_known else "something else")

    def _take_active(self, msg: String) -> None:
        """Note who is said to drive."""
        self._active = msg.data


def _checked(inputs: Any, steps: Any) -> Tuple[Dict[str, str], List[Tuple[List[str], str]]]:
    """Return the inputs and the steps, if they are such.

    Raises:
        ParameterError: they are not.
    """
    if (
        not isinstance(inputs, dict)
        or not inputs
        or not all(isinstance(topic, str) for topic in inputs.values())
    ):
        raise ParameterError(f"parameter ~inputs is {inputs!r}; expected {{name: topic, ...}}")
    names = [*inputs, IDLE]
    if not isinstance(steps, list) or not steps:
        raise ParameterError(f"parameter ~steps is {steps!r}; expected a list of steps")
    found: List[Tuple[List[str], str]] = []
    for step in steps:
        send = step.get("send") if isinstance(step, dict) else None
        wins = step.get("wins") if isinstance(step, dict) else None
        is_known = isinstance(send, list) and set(send) <= set(inputs)
        if send is None or not is_known or wins is None or wins not in names:
            raise ParameterError(
                f"parameter ~steps has {step!r}; expected {{send: [name, ...], wins: name}}, with "
                f"names out of {', '.join(names)}"
            )
        found.append((send, wins))
    return inputs, found


if __name__ == "__main__":
    init_node("muxtest")
    rostest.rosrun("mushr_ros_intro", "muxtest", MuxTest)
