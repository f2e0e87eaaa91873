"""The simulated car and its mux in a replay: they process messages when the world calls them."""

from collections import deque
from typing import Deque, Iterator, List, Sequence, Tuple

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import State
from mushr_ros_intro.car.odometry import Odometry
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.simulator.ackermann_cmd_mux import AckermannCmdMux
from mushr_ros_intro.simulator.car_sim import CarSim
from mushr_ros_intro.simulator.mux import Input, full_topic
from mushr_ros_intro.stamps import STAMP_TOLERANCE

MUX = "/car/mux/ackermann_cmd_mux"


class ReplayCar(CarSim):
    """The simulated car, which receives commands and the map from the world."""

    def __init__(self, poses: Deque[PoseWithCovarianceStamped]) -> None:
        self._poses = poses
        self._corrected: List[State] = []
        self._reported: Deque[int] = deque()  # instants whose states late commands may still change
        super().__init__(publishes_clock=False)

    def _connect(self) -> None:
        def on_pose(msg: PoseWithCovarianceStamped) -> None:
            msg._connection_header = {"topic": poses.resolved_name}  # not what its sender says
            self._poses.append(msg)

        kind = PoseWithCovarianceStamped
        poses = rospy.Subscriber("initialpose", kind, on_pose, tcp_nodelay=True)

    def states_at(self, stamps: Sequence[int]) -> List[State]:
        """Return the states at instants [ns], which are reported then."""
        with self._changed:
            self._correct(stamps[-1] - STAMP_TOLERANCE if stamps else 0)
            self._reported += stamps
            return self._evaluate(stamps)

    def publish(self, states: List[State]) -> None:
        """Publish states."""
        self._publisher.publish(states)

    def add_frames(self, odometry: str, base: str) -> None:
        """Publish the transforms with other names of the frames, too."""

        def convert(_: State, measured: Odometry) -> TFMessage:
            return conversions.transforms_to_msg(measured.state, odometry, base, True)

        self._publisher.add("/tf", TFMessage, convert)

    def publish_each(self, states: List[State]) -> Iterator[int]:
        """Publish states on each topic that has a subscriber; yield its number of connections."""
        return self._publisher.publish_each(states)

    def count_connections(self) -> int:
        """Return the number of connections to which each state is written."""
        return self._publisher.count_connections()

    def _correct(self, until: int) -> None:
        """Keep the states that were reported until an instant [ns], as they are now."""
        while self._reported and self._reported[0] <= until:
            self._corrected.append(self._history.state_at(self._reported.popleft()))

    def corrected_states(self) -> List[State]:
        """Return the states of the car when it reported them, corrected by late commands."""
        with self._changed:
            if self._reported:
                self._correct(self._reported[-1])
            return list(self._corrected)


class ReplayMux(AckermannCmdMux):
    """The mux, which the world calls, and which gives its output to the car."""

    def __init__(
        self, commands: Deque[Tuple[AckermannDriveStamped, Input]], car: ReplayCar
    ) -> None:
        self._commands = commands
        self._car = car
        super().__init__(MUX)

    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        # Not what its sender says.
        msg._connection_header = {"topic": full_topic(self._name, source.topic)}
        self._commands.append((msg, source))

    def on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Process a command."""
        super()._on_command(msg, source)

    def expire(self) -> None:
        """Send a stop if the last live input has expired."""
        with self._lock:
            self._expire(self._read_clock())

    def _held(self) -> float:
        return 0.0

    def _send(self, msg: AckermannDriveStamped) -> None:
        super()._send(msg)
        msg._connection_header = {"topic": self._output_pub.resolved_name}
        self._car.on_message(msg, conversions.command_from_msg)
