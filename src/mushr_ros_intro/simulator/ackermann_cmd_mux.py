"""Select one of several command inputs for the car."""

import threading
import time
from typing import Callable, Dict, Optional, Sequence

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from std_msgs.msg import String

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.parameters import Values
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.simulator.mux import IDLE, MUX_PARAMETERS, Input, Mux, config_of, full_topic
from mushr_ros_intro.stamps import NANOSECONDS


class MuxTopics:
    """The topics of a mux: its output, the name of the input that drives, and its inputs."""

    def __init__(self, name: str, output: str) -> None:
        """Advertise the topics of a mux, given its name and the topic of its output."""
        self._name = name
        self._frame = ""
        self._announced = ""
        self.inputs: Dict[str, rospy.Subscriber] = {}
        """The subscribers by topic."""
        self.output = rospy.Publisher(
            full_topic(name, output), AckermannDriveStamped, queue_size=100, tcp_nodelay=True
        )
        # On a busy machine, another node must see each change.
        self._active = rospy.Publisher(f"{name}/active", String, queue_size=100, latch=True)
        self.announce(IDLE)

    def subscribe(
        self,
        inputs: Sequence[Input],
        on_command: Callable[[AckermannDriveStamped, Input], None],
    ) -> None:
        """Subscribe to inputs.

        Connect the output before, so that no command of a connected sender is lost.
        """
        wait_until_connected(self.output, "subscribers")
        for each in inputs:
            topic = full_topic(self._name, each.topic)
            self.inputs[topic] = rospy.Subscriber(
                topic, AckermannDriveStamped, on_command, each, tcp_nodelay=True
            )
            rospy.loginfo(
                f"input {each.name}: {topic}, priority {each.priority}, "
                f"timeout {each.timeout / NANOSECONDS:g} s"
            )

    def send(self, msg: AckermannDriveStamped) -> None:
        """Forward a message unchanged."""
        self._frame = msg.header.frame_id
        self.output.publish(msg)

    def stop(self, stamp: int) -> None:
        """Send a stop with a stamp [ns]; no input drives any more."""
        self.output.publish(conversions.command_to_msg(Command(stamp, 0.0, 0.0), self._frame))
        self.announce(IDLE)

    def announce(self, active: str) -> None:
        """Publish the name of the input that drives if it has changed."""
        if active != self._announced:
            self._announced = active
            self._active.publish(String(data=active))


class AckermannCmdMux:
    """The mux as a node.

    The parameters below its name are the configuration, and its topics are below its name: the
    input ``input/navigation`` of /car/mux/ackermann_cmd_mux is the topic
    /car/mux/ackermann_cmd_mux/input/navigation. Publishes the name of the input that drives on
    ``active`` below its name, the name of the node that sends the commands on ``driver``, and a
    stop when the last live input expires.

    Example: ``roslaunch mushr_ros_intro sim.launch`` starts it with config/ackermann_cmd_mux.yaml
    """

    PARAMETERS = MUX_PARAMETERS

    def __init__(self, values: Values) -> None:
        """Subscribe to the inputs."""
        config = config_of(values)
        self._lock = threading.Lock()
        self._is_live = threading.Event()
        self._core = Mux(ros_time.is_simulated(), rospy.logwarn)
        self._topics = MuxTopics(rospy.get_name(), config.publisher)
        self._driver = ""
        self._driver_pub = rospy.Publisher("~driver", String, queue_size=100, latch=True)
        self._topics.subscribe(config.inputs, self._on_command)

    def run(self) -> None:
        """Send a stop whenever the last live input expires, until the node is shut down."""
        while not rospy.is_shutdown():
            if self._is_live.wait(ros_time.SHUTDOWN_POLL_PERIOD):
                with self._lock:
                    self._stop(self._core.expire(ros_time.now(), time.monotonic()))
                # In lock-step, a wait for the clock would wake up this thread at each command.
                time.sleep(ros_time.POLL_PERIOD)

    def _stop(self, stamp: Optional[int]) -> None:
        """Send a stop if it has a stamp [ns]; needs the lock."""
        if stamp is not None:
            self._is_live.clear()
            self._driver = ""  # the next drive is announced, also if it is of the same node
            self._topics.stop(stamp)

    @conversions.ignore_bad_messages
    def _on_command(self, msg: AckermannDriveStamped, source: Input) -> None:
        """Forward a command unchanged if its input may drive."""
        command = conversions.command_from_msg(msg)
        with self._lock:
            stop, passes = self._core.add(source, command.stamp, ros_time.now(), time.monotonic())
            self._stop(stop)
            if passes:
                self._announce_driver(msg._connection_header["callerid"])
                self._topics.send(msg)
                self._topics.announce(self._core.active)
            self._is_live.set()

    def _announce_driver(self, name: str) -> None:
        """Publish the name of the node that sends the commands if it is new, or after a stop."""
        if name != self._driver:
            self._driver = name
            self._driver_pub.publish(String(data=name))
