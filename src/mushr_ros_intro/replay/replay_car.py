"""The simulated car and its mux in a replay: they process messages when the world calls them."""

import math
from collections import deque
from typing import Any, Deque, Dict, Optional, Tuple
from xml.etree import ElementTree

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.model import Car, State
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
    """The simulated car and its mux, which process messages when the world calls them."""

    def __init__(
        self, car: Car, start: Pose, now: int, mux: Dict[str, Any], grid: Optional[Grid]
    ) -> None:
        """Place the car.

        Args:
            car: the car.
            start: where it stands.
            now: the time [ns].
            mux: the configuration of the mux.
            grid: the map, or None.
        """
        self.poses: Deque[PoseWithCovarianceStamped] = deque()
        """The initial poses that have arrived."""
        self.commands: Deque[Tuple[AckermannDriveStamped, Input]] = deque()
        """The commands that have arrived, and from which input."""
        self.core = CarCore(car, start, now, rospy.logwarn_throttle)
        self.publisher = StatePublisher(car, now, True, "car/", True)
        if grid is not None:
            self.publisher.world = World(grid, Footprint())
            self.core.set_walls(self.publisher.world, now)
        frames = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        frames.publish(_fixed_frames(package_folder("urdf/mushr_car.urdf")))
        kind = PoseWithCovarianceStamped
        rospy.Subscriber(INITIAL_POSES, kind, self.poses.append, tcp_nodelay=True)
        self._mux, config = Mux(True, rospy.logwarn), parse_config(mux)
        self._topics = MuxTopics(MUX, config.publisher)
        self._topics.subscribe(config.inputs, lambda *received: self.commands.append(received))
        self.inputs = self._topics.inputs
        """The subscribers of the mux, by topic."""

    def add_frames(self, odometry: str, base: str) -> None:
        """Publish the transforms with other names of the frames, too."""

        def convert(_: State, measured: Odometry) -> TFMessage:
            return conversions.transforms_to_msg(measured.state, odometry, base, True)

        self.publisher.add("/tf", TFMessage, convert)

    def process(self, msg: AckermannDriveStamped, source: Input, now: int) -> None:
        """Process a command, or raise a MessageError; only the time on the clock counts."""
        command = conversions.command_from_msg(msg)
        stop, passes = self._mux.add(source, command.stamp, now, math.inf)
        if stop is not None:
            self._topics.stop(stop)
        if passes:
            self._topics.send(msg)
            self.core.add(command, f"{MUX}/output", now)
            self._topics.announce(self._mux.active)

    def expire(self, now: int) -> None:
        """Send a stop if the last live input has expired."""
        stop = self._mux.expire(now, math.inf)
        if stop is not None:
            self._topics.stop(stop)


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
