"""The common part of the test nodes posetest and ratetest."""

import time
import unittest
from typing import Any, Callable, Optional, Sequence, Type

import rospy
import rostest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.grading.checks import Series
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros import node
from mushr_ros_intro.sim.stamps import from_seconds

_MAX_FAULTS = 5
"""How many faults a failure shows."""


class NodeTestCase(unittest.TestCase):
    """A test that is configured by the private parameters of its node.

    Every test node has the parameter ``wait_time``: how long to wait for the first message of a
    topic [s of wall-clock time], default 20.0.
    """

    def setUp(self) -> None:
        """Read the parameters; a bad one is a failure."""
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

    def subscribe(self, topic: str, kind: Any, callback: Callable[[Any], None]) -> rospy.Subscriber:
        """Subscribe to a topic until the test ends."""
        subscriber = rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)
        self.addCleanup(subscriber.unregister)
        return subscriber

    def wait_for(
        self, condition: Callable[[], Any], what: str, patience: Optional[float] = None
    ) -> Any:
        """Return the first true value of `condition`.

        Args:
            condition: evaluated every 10 ms.
            what: completes the message "waited 1 s for ...".
            patience: how long to wait [s of wall-clock time], default wait_time.

        Raises:
            AssertionError: the time is over, or `error` is set.
        """
        patience = self.patience if patience is None else patience
        deadline = time.monotonic() + patience
        while True:
            if self.error:
                self.fail(self.error)
            value = condition()
            if value:
                return value
            if time.monotonic() > deadline:
                self.fail(f"waited {patience:g} s for {what}")
            time.sleep(0.01)

    def wait_for_series(
        self, series: Series, seconds: float, is_over: Callable[[], bool] = lambda: False
    ) -> None:
        """Wait until the first `seconds` of a series are complete, or `is_over` returns true."""
        duration = from_seconds(seconds)
        self.wait_for(
            lambda: is_over() or series.covers(duration, rospy.get_rostime().to_nsec()),
            f"{seconds:g} s to pass on the clock",
            self.patience + 10.0 * seconds,
        )

    def fail_with(self, faults: Sequence[str]) -> None:
        """Fail if there are faults, and show the first few of them."""
        if faults:
            more = len(faults) - _MAX_FAULTS
            rest = [f"and {more} more"] if more > 0 else []
            self.fail("\n".join([*faults[:_MAX_FAULTS], *rest]))


def main(name: str, test: Type[NodeTestCase]) -> None:
    """Run the test node `name`."""
    node.init_node(name)
    rostest.rosrun("mushr_ros_intro", name, test)
