"""The common part of the test nodes posetest and ratetest."""

import unittest
from typing import Any, Callable, Type

import roslib.message
import rospy
import rostest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.replay.checks import Series
from mushr_ros_intro.ros import node, ros_time
from mushr_ros_intro.stamps import from_seconds


class NodeTestCase(unittest.TestCase):
    """A test that is configured by the private parameters of its node.

    Every test node has the parameter ``wait_time``: how long to wait for the first message of a
    topic [s of wall-clock time], default 20.0.
    """

    def setUp(self) -> None:
        """Read the parameters; a bad one is a failure."""
        self.series = Series()
        """What the test has received."""
        self.error = ""
        """Set by a callback to make the test fail."""
        parameters = node.parameters()
        try:
            self.patience = parameters.number("wait_time", 20.0, "s", 0.0, 1e6)
            self.configure(parameters)
        except UserError as error:
            self.fail(str(error))

    def configure(self, parameters: Parameters) -> None:
        """Read the parameters of the subclass.

        Raises:
            UserError: a parameter, or a file that it names, cannot be used.
        """
        raise NotImplementedError

    def listen(self, topic: str, take: Callable[[Any], None]) -> None:
        """Pass each message of a topic, which may be of any type, to `take`."""

        def decode(msg: Any) -> None:
            if isinstance(msg, rospy.AnyMsg):  # rospy itself knows the type of /clock
                message_class = roslib.message.get_message_class(msg._connection_header["type"])
                msg = message_class().deserialize(msg._buff)
            take(msg)

        rospy.Subscriber(topic, rospy.AnyMsg, decode, tcp_nodelay=True)

    def wait_for_series(
        self, what: str, seconds: float, is_over: Callable[[], bool] = lambda: False
    ) -> None:
        """Wait until the first `seconds` of the series are complete, or `is_over` returns true.

        Args:
            what: an item of the series; completes the message "waited 1 s for ...".
            seconds: counted from the first stamp.
            is_over: evaluated every 10 ms.

        Raises:
            AssertionError: nothing came within ``wait_time``, the clock stands, or `error` is set.
        """
        self.wait_for(lambda: self.series.entries, what, self.patience)
        duration = from_seconds(seconds)
        self.wait_for(
            lambda: is_over() or self.series.covers(duration, ros_time.now()),
            f"{seconds:g} s to pass on the clock",
            self.patience + 10.0 * seconds,
        )

    def wait_for(self, condition: Callable[[], Any], what: str, seconds: float) -> None:
        """Fail if a condition is not true within `seconds` of wall-clock time, or on an error."""
        is_met = ros_time.wait_for(lambda: self.error or condition(), seconds)
        if self.error or not is_met:
            self.fail(self.error or f"waited {seconds:g} s for {what}")


def main(name: str, test: Type[NodeTestCase]) -> None:
    """Run the test node `name`."""
    node.init_node(name)
    rostest.rosrun("mushr_ros_intro", name, test)
