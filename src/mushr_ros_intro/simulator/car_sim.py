"""Simulate the car: a kinematic bicycle that follows commands and reports its pose."""

import threading
from typing import Callable, Optional, Sequence

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg

from mushr_ros_intro.car.model import Car, Event
from mushr_ros_intro.car.profile import CAR_PARAMETERS, car_of
from mushr_ros_intro.geometry import MAX_COORDINATE, ORIGIN, Pose
from mushr_ros_intro.parameters import Values, flag, number, text
from mushr_ros_intro.ros import conversions, node
from mushr_ros_intro.ros.connections import has_live_publisher, wait_until_connected
from mushr_ros_intro.simulator import sim_clock
from mushr_ros_intro.simulator.car_core import CarCore
from mushr_ros_intro.simulator.car_parameters import (
    COLLISION,
    EXPECTS_MAP,
    FOOTPRINTS,
    FRAME_PREFIX,
)
from mushr_ros_intro.simulator.state_publisher import StatePublisher
from mushr_ros_intro.stamps import (
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    from_seconds,
)
from mushr_ros_intro.world.footprint import World, is_free

FACTOR = "speed of simulated time relative to wall-clock time; 0 is lock-step"


class CarSim:
    """The simulated car as a node.

    Subscribes, relative to the car's namespace, to ``initialpose`` and
    ``mux/ackermann_cmd_mux/output``, and to /map. Publishes ``car_pose``, ``odom``,
    ``joint_states``, ``driven_path``, ``~collision``, /tf, and /clock in simulated time. Services:
    ``~reset``; with /clock also ``~pause``, ``~resume`` and ``~step``.

    Example: ``roslaunch mushr_ros_intro sim.launch car:=mushr_nano x:=1.0``
    """

    PARAMETERS = (
        number("x", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE, "start pose"),
        number("y", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE, "start pose"),
        number("theta", 0.0, "rad", -1e3, 1e3, "start pose"),
        *CAR_PARAMETERS,
        number("pose_rate", 50.0, "Hz", 0.1, 1000.0, "of pose, odometry, joints and transforms"),
        number("real_time_factor", 1.0, "", 0.0, 1e6, FACTOR),
        EXPECTS_MAP,
        text("profile", None, "name of the car, for the log"),
        COLLISION,
        FRAME_PREFIX,
        flag("publish_map_to_odom", True, "publish the transform from the map to the odometry"),
        flag("mushr_interface", False, "offer the topics and services of MuSHR's simulator, too"),
    )

    def __init__(self, values: Values, publishes_clock: bool = False) -> None:
        """Set up the node; if `publishes_clock`, it publishes /clock."""
        start = Pose(values["x"], values["y"], values["theta"])
        car, prefix = car_of(values), values["frame_prefix"]
        pose_rate, factor = values["pose_rate"], values["real_time_factor"]
        self._expects_map = values["expects_map"]
        self.pose_period = from_seconds(1.0 / pose_rate)
        """The time between two reports of the pose [ns]."""
        # The lock of the state and the clock; notified of events and service calls.
        self._changed = threading.Condition()
        self.clock = (
            sim_clock.OwnClock(self.pose_period, self._changed, factor)
            if publishes_clock
            else sim_clock.FollowedClock(self.pose_period, self._changed)
        )
        described = values["profile"] or "without a profile", car
        time = self.clock.description
        rospy.loginfo("car %s: %s; pose rate %g Hz; time: %s", *described, pose_rate, time)
        self._footprint = FOOTPRINTS[values["collision"]]
        now = self.clock.read()
        tolerance = SIMULATED_STAMP_TOLERANCE if publishes_clock else STAMP_TOLERANCE
        self._core = CarCore(car, start, now, rospy.logwarn_throttle, tolerance)
        with_map = values["publish_map_to_odom"]
        self._publisher = StatePublisher(car, now, not publishes_clock, prefix, with_map)
        self._on_reported: Callable[[int], None] = lambda _: None
        if values["mushr_interface"]:
            self._offer_mushr_interface(car, prefix)
        self._connect()

    def _connect(self) -> None:
        """Create the service and the subscribers."""
        node.offer_service("~reset", self._changed, self._reset)
        self._map_sub = rospy.Subscriber(
            "/map", numpy_msg(OccupancyGrid), self._on_map, queue_size=1, buff_size=1 << 20
        )
        # No queue size: every message counts.
        rospy.Subscriber(
            "initialpose",
            PoseWithCovarianceStamped,
            self.on_message,
            conversions.initial_pose_from_msg,
            tcp_nodelay=True,
        )
        self._command_sub = rospy.Subscriber(
            "mux/ackermann_cmd_mux/output",
            AckermannDriveStamped,
            self.on_message,
            conversions.command_from_msg,
            tcp_nodelay=True,
        )

    def run(self) -> None:
        """Report the car's state until the node is shut down."""
        # A node that receives the car's pose can rely on the car receiving commands.
        wait_until_connected(self._command_sub, "publishers")
        self._publisher.announce(self._is_ready)
        self.clock.run(self._report)

    def _offer_mushr_interface(self, car: Car, prefix: str) -> None:
        """Offer the interface of MuSHR's simulator, too."""
        # Only here, because plain car_sim needs none of MuSHR's packages.
        from mushr_ros_intro.simulator.mushr_interface import MushrInterface

        interface = MushrInterface(car, prefix, self.add, self._publisher)
        self._on_reported = interface.on_reported

    def _is_ready(self) -> bool:
        """Return whether the mux is connected, and whether a map, if expected, is in use."""
        needs_map = self._expects_map or self._map_sub.get_num_connections()
        has_map = self._core.world is not None
        return (has_map or not needs_map) and has_live_publisher(self._command_sub)

    def _report(self, instants: Sequence[int]) -> None:
        """Publish the car's states at instants [ns]; needs the lock."""
        self._publisher.publish(self._core.states(instants, self.clock.read()))
        if instants:
            self._on_reported(instants[-1])

    @conversions.ignore_bad_messages
    def _on_map(self, msg: OccupancyGrid) -> None:
        """Use a map from now on."""
        world = World(conversions.grid_from_msg(msg), self._footprint)
        is_free(*world, ORIGIN)  # fills the map's caches before the lock is taken
        with self._changed:
            self._core.set_walls(world, self.clock.read())
            self._publisher.world = world

    @conversions.ignore_bad_messages
    def on_message(self, msg: rospy.Message, read: Callable[[rospy.Message], Event]) -> None:
        """Add a command or an initial pose; it applies at its stamp."""
        self.add(read(msg), msg._connection_header["topic"])

    def add(self, event: Event, topic: str) -> Optional[int]:
        """Add an event from a topic or service; return its stamp [ns], None if it is rejected."""
        with self._changed:
            applied = self._core.add(event, topic, self.clock.read())
            if applied:
                self.clock.on_event(applied)
        return applied.stamp if applied else None

    def _reset(self) -> str:
        """Place the car at its start pose, at rest, with its odometry at zero; needs the lock."""
        now = self.clock.read()
        self._core.reset(now)
        self.clock.reset()
        return f"at the start pose since {sim_clock.shown(now)}"
