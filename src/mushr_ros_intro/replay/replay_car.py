"""The simulated car and its mux in a replay: they process messages when the world calls them."""

import math
from typing import Any, Deque, Dict, List, Sequence, Tuple
from xml.etree import ElementTree

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import Car, Event, State
from mushr_ros_intro.car.odometry import Odometry
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.replay.mistakes import INITIAL_POSES
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.simulator.ackermann_cmd_mux import MuxTopics
from mushr_ros_intro.simulator.car_core import CarCore
from mushr_ros_intro.simulator.mux import Input, Mux, parse_config
from mushr_ros_intro.simulator.state_publisher import StatePublisher
from mushr_ros_intro.world.footprint import Footprint, World
from mushr_ros_intro.world.grid import Grid

MUX = "/car/mux/ackermann_cmd_mux"


class ReplayCar:
    """The simulated car, which receives initial poses, commands and the map from the world."""

    def __init__(self, car: Car, start: Pose, now: int, poses: Deque[Any]) -> None:
        """Place the car at `start`; it appends the initial poses that it receives to `poses`."""
        self._core = CarCore(car, start, now, rospy.logwarn_throttle)
        self.publisher = StatePublisher(car, now, True, "car/", True)
        frames = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        frames.publish(_fixed_frames(package_folder("urdf/mushr_car.urdf")))
        kind = PoseWithCovarianceStamped
        rospy.Subscriber(INITIAL_POSES, kind, poses.append, tcp_nodelay=True)

    def use_map(self, grid: Grid, now: int) -> None:
        """Use a map from now on [ns]."""
        self.publisher.world = World(grid, Footprint())
        self._core.set_walls(self.publisher.world, now)

    def add_frames(self, odometry: str, base: str) -> None:
        """Publish the transforms with other names of the frames, too."""

        def convert(_: State, measured: Odometry) -> TFMessage:
            return conversions.transforms_to_msg(measured.state, odometry, base, True)

        self.publisher.add("/tf", TFMessage, convert)

    def add(self, event: Event, now: int) -> None:
        """Process an initial pose or a command."""
        self._core.add(event, "a topic", now)

    def states_at(self, stamps: Sequence[int], now: int) -> List[State]:
        """Return the states at instants [ns], which are reported now [ns]."""
        return self._core.states(stamps, now)


def _fixed_frames(path: str) -> TFMessage:
    """Return the transforms that robot_state_publisher has on /tf_static, from a URDF file."""
    msg = TFMessage()
    for joint in ElementTree.parse(path).getroot().findall("joint[@type='fixed']"):
        values = {each.tag: each.attrib for each in joint}
        frame = TransformStamped(child_frame_id="car/" + values["child"]["link"])
        frame.header.frame_id = "car/" + values["parent"]["link"]
        place = frame.transform.translation
        place.x, place.y, place.z = map(float, values["origin"]["xyz"].split())
        frame.transform.rotation.w = 1.0
        msg.transforms.append(frame)
    return msg


class ReplayMux:
    """The mux, which the world calls, and which gives its output to the car."""

    def __init__(
        self,
        parameters: Dict[str, Any],
        commands: Deque[Tuple[AckermannDriveStamped, Input]],
        car: ReplayCar,
    ) -> None:
        """Subscribe to the inputs.

        Args:
            parameters: the configuration.
            commands: the mux appends to it what it receives, and from which input.
            car: the car.
        """
        self._car = car
        self._core = Mux(True, rospy.logwarn)
        config = parse_config(parameters)
        self._topics = MuxTopics(MUX, config.publisher)
        self._topics.subscribe(config.inputs, lambda *received: commands.append(received))
        self.inputs = self._topics.inputs

    def process(self, msg: AckermannDriveStamped, source: Input, now: int) -> None:
        """Process a command, or raise a MessageError; only the time on the clock counts."""
        command = conversions.command_from_msg(msg)
        stop, passes = self._core.add(source, command.stamp, now, math.inf)
        if stop is not None:
            self._topics.stop(stop)
        if passes:
            self._topics.send(msg)
            self._car.add(command, now)
            self._topics.announce(self._core.active)

    def expire(self, now: int) -> None:
        """Send a stop if the last live input has expired."""
        stop = self._core.expire(now, math.inf)
        if stop is not None:
            self._topics.stop(stop)
