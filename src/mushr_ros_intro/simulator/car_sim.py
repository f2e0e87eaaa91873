"""Simulate the car: a kinematic bicycle that follows commands and reports its pose."""

import threading
from typing import Callable, List, Optional, Sequence

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Command, Event, InitialPose, State, at_rest, halted
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.geometry import MAX_COORDINATE, Pose
from mushr_ros_intro.plan.plan import as_float32
from mushr_ros_intro.ros import conversions, node
from mushr_ros_intro.ros.connections import has_live_publisher, wait_until_connected
from mushr_ros_intro.simulator import sim_clock
from mushr_ros_intro.simulator.state_publisher import StatePublisher
from mushr_ros_intro.stamps import (
    NANOSECONDS,
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    effective_stamp,
    from_seconds,
)
from mushr_ros_intro.world.footprint import POINT, Footprint, World, is_free
from mushr_ros_intro.world.grid import Grid

FACTOR = "speed of simulated time relative to wall-clock time; 0 is lock-step"


class CarSim:
    """The simulated car as a node.

    Subscribes, relative to the car's namespace, to ``initialpose`` and
    ``mux/ackermann_cmd_mux/output``, and to /map. Publishes ``car_pose``, ``odom``,
    ``joint_states``, ``driven_path``, ``~collision``, /tf, and /clock in simulated time. Services:
    ``~reset``; with /clock also ``~pause``, ``~resume`` and ``~step``.

    Example: ``roslaunch mushr_ros_intro sim.launch car:=mushr_nano x:=1.0``
    """

    def __init__(self, publishes_clock: bool = False) -> None:
        """Set up the node; if `publishes_clock`, it publishes /clock."""
        with node.parameters() as parameters:
            number, limit = parameters.number, MAX_COORDINATE
            self._start = Pose(
                number("x", 0.0, "m", -limit, limit, "start pose"),
                number("y", 0.0, "m", -limit, limit, "start pose"),
                number("theta", 0.0, "rad", -1e3, 1e3, "start pose"),
            )
            self._car = car_from(parameters)
            meaning = "rate of the pose, the odometry, the joint states and the transforms"
            pose_rate = number("pose_rate", 50.0, "Hz", 0.1, 1000.0, meaning)
            factor = number("real_time_factor", 1.0, "", 0.0, 1e6, FACTOR)
            meaning = "the car is ready only when it has received a map"
            self._expects_map = parameters.flag("expects_map", False, meaning)
            profile = parameters.optional_text("profile", "name of the car, for the log")
            meaning = "what walls stop: the car's body, or the point at its rear axle"
            is_point = parameters.choice("collision", ("body", "point"), "body", meaning) == "point"
            prefix = node.frame_prefix(parameters)
            meaning = "publish the transform from the map to the odometry"
            with_map = parameters.flag("publish_map_to_odom", True, meaning)
            meaning = "offer the topics and services of MuSHR's simulator, too"
            has_mushr_interface = parameters.flag("mushr_interface", False, meaning)
        self.pose_period = from_seconds(1.0 / pose_rate)
        """The time between two reports of the pose [ns]."""
        # The lock of the state and the clock; notified of events and service calls.
        self._changed = threading.Condition()
        self.clock = (
            sim_clock.OwnClock(self.pose_period, self._changed, factor)
            if publishes_clock
            else sim_clock.FollowedClock(self.pose_period, self._changed)
        )
        values = (profile or "without a profile", self._car, pose_rate, self.clock.description)
        rospy.loginfo("car %s: %s; pose rate %g Hz; time: %s", *values)
        self._footprint = POINT if is_point else Footprint()
        self._stamp_tolerance = SIMULATED_STAMP_TOLERANCE if publishes_clock else STAMP_TOLERANCE
        self._now = self.clock.read()
        self._history = History(self._car, at_rest(self._now, self._start))
        self._world: Optional[World] = None
        self._publisher = StatePublisher(
            self._car, self._now, not publishes_clock, prefix, with_map
        )
        self._publish: sim_clock.Publish = self._publisher.publish
        if has_mushr_interface:
            self._publish = self._offer_mushr_interface(prefix)
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
        self.clock.run(self._evaluate, self._publish)

    def _offer_mushr_interface(self, prefix: str) -> sim_clock.Publish:
        """Offer the interface of MuSHR's simulator, too; return the function that publishes."""
        # Only here, because plain car_sim needs none of MuSHR's packages.
        from mushr_ros_intro.simulator.mushr_interface import MushrInterface

        interface = MushrInterface(self._car, prefix, self.add, self._publisher)

        def publish(states: List[State]) -> None:
            self._publisher.publish(states)
            interface.on_reported(states)

        return publish

    def _is_ready(self) -> bool:
        """Return whether the mux is connected, and whether a map, if expected, is in use."""
        needs_map = self._expects_map or self._map_sub.get_num_connections()
        return (self._world is not None or not needs_map) and has_live_publisher(self._command_sub)

    def _evaluate(self, instants: Sequence[int]) -> List[State]:
        """Return the car's state at instants [ns]; needs the lock."""
        self._read_clock()
        return [self._history.state_at(instant) for instant in instants]

    @conversions.ignore_bad_messages
    def _on_map(self, msg: OccupancyGrid) -> None:
        self.use_map(conversions.grid_from_msg(msg))

    def use_map(self, grid: Grid) -> None:
        """Use a map from now on."""
        world = World(grid, self._footprint)
        is_free(*world, self._start)  # fills the map's caches before the lock is taken
        with self._changed:
            now = self._read_clock()
            self._world = self._publisher.world = world
            self._history.set_walls(world)
            state = self._history.state_at(now)
        if not is_free(*world, state.pose):
            rospy.logwarn(
                f"the car is inside a wall at {state.pose}; drive it out, or place it elsewhere"
            )

    @conversions.ignore_bad_messages
    def on_message(self, msg: rospy.Message, read: Callable[[rospy.Message], Event]) -> None:
        """Add a command or an initial pose to the history; it applies at its stamp."""
        self.add(read(msg), msg._connection_header["topic"])

    def add(self, event: Event, topic: str) -> Optional[int]:
        """Add an event from a topic or service; return its stamp [ns], None if it is rejected."""
        if not self._accepts(event, topic):
            return None
        with self._changed:
            now = self._read_clock()
            stamp = effective_stamp(event.stamp, now)
            has_stamp = stamp == event.stamp
            applied = event if has_stamp else event._replace(stamp=stamp, has_stamp=False)
            self._history.add(applied, now)
            self.clock.on_event(applied)
        # MuSHR sends stops with one old stamp while no input drives.
        is_stop = isinstance(event, Command) and not event.speed
        if event.stamp and not is_stop and abs(event.stamp - now) > self._stamp_tolerance:
            rospy.logwarn_throttle(
                1.0,
                f"the stamp of a message on {topic} differs by "
                f"{(event.stamp - now) / NANOSECONDS:+.1f} s from the car's clock; expected at "
                f"most {STAMP_TOLERANCE / NANOSECONDS:g} s. The message is applied on arrival. "
                "Its sender was suspended, as by Ctrl-Z, or its stamp is wrong, or the clocks of "
                "two machines differ",
            )
        return stamp

    def _accepts(self, event: Event, topic: str) -> bool:
        """Return whether the car accepts an event; log a rejected event or a limited command."""
        if isinstance(event, InitialPose):
            if self._world is None or is_free(*self._world, event.pose):
                return True
            rospy.logwarn_throttle(
                1.0,
                f"rejected the initial pose {event.pose} on {topic}: the car would be inside a "
                "wall. The car does not move; expected a pose with enough space for its body",
            )
            return False
        asked = (event.speed, event.steering_angle)
        possible = self._car.within_limits(*asked)
        if asked != tuple(map(as_float32, possible)):  # a command has float32 values
            rospy.logwarn_throttle(
                10.0,
                "a command asks for {:g} m/s and {:g} rad; within its limits, the car drives {:g} "
                "m/s and {:g} rad".format(*asked, *possible),
            )
        return True

    def _read_clock(self) -> int:
        """Return the time [ns]; needs the lock. If the clock was set back, the car stops."""
        now = self.clock.read()
        if now < self._now:
            rospy.logwarn("the clock was set back; the car stops and forgets its commands")
            state = self._history.state_at(self._now)
            self._history = History(self._car, halted(state, now), self._world)
        self._now = now
        return now

    def _reset(self) -> str:
        """Place the car at its start pose, at rest, with its odometry at zero; needs the lock."""
        now = self._read_clock()
        self._history = History(self._car, at_rest(now, self._start), self._world)
        self.clock.reset()
        return f"at the start pose since {now / NANOSECONDS:.9f} s"
