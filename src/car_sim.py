#!/usr/bin/python3
"""Simulate the car: a kinematic bicycle that obeys commands and reports where it is."""

import sys
import threading
import time
from contextlib import suppress
from typing import Callable, Optional

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
from tf2_msgs.msg import TFMessage

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Command, Contact, Event, InitialPose, State, at_rest, halted
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import ParameterError, Parameters, number
from mushr_ros_intro.plan.model import MAX_COORDINATE
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.connections import PATIENCE, CallError, ask, responds, wait_until_connected
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.clock import Kind, Stream, carry_over, hear, horizon
from mushr_ros_intro.sim.stamps import NANOSECONDS, STAMP_TOLERANCE, effective_stamp, from_seconds
from mushr_ros_intro.world.footprint import is_free, on_map


class CarSim:
    """The simulated car as a node.

    Topics, relative to the car's namespace: subscribes to ``initialpose`` and
    ``mux/ackermann_cmd_mux/output``, and to /map, where somebody publishes one; publishes
    ``car_pose``, ``odom``, ``joint_states`` and /tf, and ``~collision``, latched: the pose at which
    the car stands against a wall, and no pose once it stands there no longer.
    """

    def __init__(self, keeps_clock: bool) -> None:
        """Set up the node, which publishes the simulated time as well if it `keeps_clock`."""

        def parameter(name: str, default: float, unit: str, least: float, most: float) -> float:
            value = number(f"~{name}", rospy.get_param(f"~{name}", default), unit, least, most)
            rospy.loginfo("%s: %g %s", name, value, unit)
            return value

        self._car = car_from(Parameters(rospy.get_param("~", {}), "~"))
        rospy.loginfo("%s", self._car)
        self._period = from_seconds(1.0 / parameter("pose_rate", 50.0, "Hz", 0.1, 1000.0))
        self._factor = parameter("real_time_factor", 1.0, "", 0.0, 1e6)
        self._start = Pose(
            parameter("x", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE),
            parameter("y", 0.0, "m", -MAX_COORDINATE, MAX_COORDINATE),
            parameter("theta", 0.0, "rad", -1e3, 1e3),
        )
        prefix = rospy.get_namespace().strip("/")
        self._odom_frame = f"{prefix}/odom".lstrip("/")
        self._base_frame = f"{prefix}/base_footprint".lstrip("/")

        self._keeps_clock = keeps_clock
        rospy.loginfo("time: %s", self._describe_time())

        # Held while the state or the clock changes; notified of events and of the services.
        self._changed = threading.Condition()
        self._now = rospy.get_rostime().to_nsec()
        if self._keeps_clock:
            self._now = int(time.time()) * NANOSECONDS
        self._stream: Optional[Stream] = None
        self._paused = False
        self._steps = 0
        self._history = History(self._car, at_rest(self._now, self._start))
        self._world: Optional[World] = None
        self._announced: Optional[Contact] = None
        self._is_on_map = True

        # In wall-clock time a slow subscriber is better off without old states; in simulated time,
        # which may run fast, every one of them is to arrive.
        queue_size = 10_000 if self._keeps_clock else 1
        options = {"queue_size": queue_size, "tcp_nodelay": True}
        self._pose_pub = rospy.Publisher("car_pose", PoseStamped, **options)
        self._odom_pub = rospy.Publisher("odom", Odometry, **options)
        self._joint_pub = rospy.Publisher("joint_states", JointState, **options)
        self._collision_pub = rospy.Publisher("~collision", PoseArray, queue_size=10, latch=True)
        self._collision_pub.publish(conversions.collision_to_msg(None, self._now))
        # As tf2_ros's broadcaster does, which is the one thing that would bring tf2_ros in (7 MB).
        self._tf_pub = rospy.Publisher("/tf", TFMessage, queue_size=100, tcp_nodelay=True)
        if self._keeps_clock:
            self._clock_pub = rospy.Publisher("/clock", Clock, **options)

        self._map_sub = rospy.Subscriber(
            "/map", numpy_msg(OccupancyGrid), self._on_map, queue_size=1, buff_size=1 << 20
        )
        # No queue size: every message counts, and the history forgets none that is young enough.
        rospy.Subscriber(
            "initialpose",
            PoseWithCovarianceStamped,
            self._on_message,
            conversions.initial_pose_from_msg,
            tcp_nodelay=True,
        )
        self._command_sub = rospy.Subscriber(
            "mux/ackermann_cmd_mux/output",
            AckermannDriveStamped,
            self._on_message,
            conversions.command_from_msg,
            tcp_nodelay=True,
        )
        rospy.Service("~reset", Trigger, self._on_reset)
        if self._keeps_clock:
            rospy.Service("~pause", Trigger, self._on_pause)
            rospy.Service("~resume", Trigger, self._on_resume)
            rospy.Service("~step", Trigger, self._on_step)

    def run(self) -> None:
        """Report the car's state at the pose rate until the node is shut down."""
        # Who hears the car may count on its hearing the commands.
        wait_until_connected(self._command_sub, "publishers")
        if self._keeps_clock:
            self._run_clock()
            return
        rate = rospy.Rate(NANOSECONDS / self._period, reset=True)
        while not rospy.is_shutdown():
            with self._changed:
                now = self._read_clock()  # first, for it may begin another history
                state = self._history.state_at(now)
            self._publish(state)
            rate.sleep()

    def _run_clock(self) -> None:
        """Keep the clock, and report the car's state each time that a pose is due.

        In lock-step the clock moves as far as the known commands reach in one step, and the poses
        on the way are reported just before it does.
        """
        next_pose = self._now + self._period
        begin = (time.monotonic(), self._now)  # the real-time factor is kept from here
        while not rospy.is_shutdown():
            self._give_up()
            with self._changed:
                wall = time.monotonic()
                limit = horizon(self._stream, wall, self._factor == 0.0, next_pose, self._period)
                target = next_pose
                if self._steps:
                    begin = (wall, target)
                elif self._paused or (limit is not None and limit <= self._now):
                    self._changed.wait(0.05)
                    if self._paused or self._factor == 0.0:
                        begin = (time.monotonic(), self._now)
                    continue
                elif limit is not None and self._factor == 0.0:
                    target = limit
                    begin = (wall, target)
                else:
                    target = next_pose if limit is None else min(next_pose, limit)
                    due = begin[0] + (target - begin[1]) / NANOSECONDS / (self._factor or 1.0)
                    if wall < due:
                        self._changed.wait(due - wall)
                        continue
                    if wall > due + 0.1:
                        begin = (wall, target)  # a clock that fell behind does not catch up
                states = [
                    self._history.state_at(stamp)
                    for stamp in range(next_pose, target + 1, self._period)
                ]
                next_pose += len(states) * self._period
                self._now = target
                if self._steps:
                    self._steps -= 1
                    self._changed.notify_all()
            for state in states:
                self._publish(state)
            self._clock_pub.publish(Clock(clock=conversions.time_from(target)))

    def _give_up(self) -> None:
        """Forget a stream that is over, and say so if the car still drove."""
        with self._changed:
            stream = self._stream
            if self._paused or not stream or not stream.over(time.monotonic()):
                return
            self._stream = None
        if self._factor == 0.0 and stream.kind == Kind.DRIVE:
            rospy.logwarn(
                "no command came for %g s of wall-clock time after one to drive; the clock goes on",
                stream.patience,
            )

    def _on_map(self, msg: OccupancyGrid) -> None:
        """Put up the walls of a map."""
        try:
            world = World(conversions.grid_from_msg(msg))
        except conversions.MessageError as error:
            rospy.logwarn(f"ignored a map on {self._map_sub.resolved_name}: {error}")
            return
        is_free(*world, self._start)  # what is worked out once is worked out here, without the lock
        with self._changed:
            now = self._read_clock()
            self._world = world
            self._history.build(world)
            state = self._history.state_at(now)
        rospy.loginfo("driving in a map of %d x %d cells", world.grid.width, world.grid.height)
        if not is_free(*world, state.pose):
            rospy.logwarn(
                f"the car stands in a wall at {state.pose}; it can only drive out of it, or be "
                "placed elsewhere"
            )

    def _on_message(self, msg: rospy.Message, read: Callable[[rospy.Message], Event]) -> None:
        """Take a command or a placement, to be applied at its stamp."""
        try:
            event = read(msg)
        except conversions.MessageError as error:
            rospy.logwarn_throttle(1.0, f"ignored a message on {_topic(msg)}: {error}")
            return
        world = self._world
        if world and isinstance(event, InitialPose) and not is_free(*world, event.pose):
            rospy.logwarn_throttle(
                1.0,
                f"refused to place the car at {event.pose}, as {_topic(msg)} asks: it would stand "
                "in a wall there. It stays where it was; expected a pose with room for its body",
            )
            return
        if isinstance(event, Command):
            asked = (event.speed, event.steering_angle)
            possible = self._car.within_limits(*asked)
            if possible != asked:
                rospy.logwarn_throttle(
                    10.0,
                    "asked for {:g} m/s and {:g} rad; this car does {:g} m/s and {:g} rad".format(
                        *asked, *possible
                    ),
                )
        with self._changed:
            now = self._read_clock()
            stamp = effective_stamp(event.stamp, now)
            event_then = event._replace(stamp=stamp)
            self._history.add(event_then, now)
            self._stream = hear(self._stream, event_then, now, time.monotonic())
            self._changed.notify_all()
        if event.stamp and stamp != event.stamp:
            ahead = (event.stamp - now) / NANOSECONDS
            rospy.logwarn_throttle(
                1.0,
                f"a message on {_topic(msg)} is stamped {ahead:+.1f} s from this machine's "
                f"clock; expected at most {STAMP_TOLERANCE / NANOSECONDS:g} s. It is applied on "
                "arrival; synchronise the clocks of the machines",
            )

    def _read_clock(self) -> int:
        """Return the present [ns], never before an earlier present; needs the lock.

        Where the clock jumped back, the car is put at rest where it is and time starts afresh.
        """
        if self._keeps_clock:
            return self._now
        now = rospy.get_rostime().to_nsec()
        if now < self._now - STAMP_TOLERANCE:
            rospy.logwarn("the clock jumped back; the car stands and starts afresh")
            state = self._history.state_at(self._now)
            self._history = History(self._car, halted(state, now), self._world)
            self._now = now
        self._now = max(self._now, now)
        return self._now

    def _publish(self, state: State) -> None:
        """Publish everything that says where the car is, with one stamp."""
        if self._pose_pub.get_num_connections():
            self._pose_pub.publish(conversions.car_pose_to_msg(state))
        if self._odom_pub.get_num_connections():
            self._odom_pub.publish(
                conversions.odometry_to_msg(state, self._car, self._odom_frame, self._base_frame)
            )
        if self._joint_pub.get_num_connections():
            self._joint_pub.publish(conversions.joint_states_to_msg(state, self._car))
        if self._tf_pub.get_num_connections():
            self._tf_pub.publish(
                conversions.transforms_to_msgs(state, self._odom_frame, self._base_frame)
            )
        self._announce(state)

    def _announce(self, state: State) -> None:
        """Say once where the car hit a wall, that it is off it again, and that it left the map."""
        if state.collision != self._announced:
            self._announced = state.collision
            self._collision_pub.publish(conversions.collision_to_msg(state.collision, state.stamp))
            if state.collision:
                rospy.logwarn(
                    f"the car hit a wall and stands at {state.collision.pose}; "
                    "it can drive away from it"
                )
        if self._world is None:
            return
        is_on_map = on_map(*self._world, state.pose)
        if self._is_on_map and not is_on_map:
            rospy.logwarn(f"the car left the map at {state.pose}; there are no walls out there")
        self._is_on_map = is_on_map

    def _describe_time(self) -> str:
        """Say whose time this is, and how fast it runs."""
        if not self._keeps_clock:
            return "from /clock" if rospy.get_param("/use_sim_time", False) else "wall-clock"
        if self._factor == 0.0:
            return "simulated, in lock-step with the commands"
        return f"simulated, {self._factor:g} times real time"

    def _on_pause(self, _: TriggerRequest) -> TriggerResponse:
        """Hold the clock."""
        return self._answer_at_clock(paused=True, steps=0)

    def _on_resume(self, _: TriggerRequest) -> TriggerResponse:
        """Let the clock run on."""
        return self._answer_at_clock(paused=False, steps=0)

    def _on_step(self, _: TriggerRequest) -> TriggerResponse:
        """Let the held clock run to the next pose."""
        return self._answer_at_clock(paused=True, steps=1)

    def _answer_at_clock(self, paused: bool, steps: int) -> TriggerResponse:
        """Hold the clock or let it go, and say when that is."""
        with self._changed:
            self._stream = carry_over(self._stream, time.monotonic(), self._paused)
            self._paused, self._steps = paused, steps
            self._changed.notify_all()
            while self._steps and not rospy.is_shutdown():
                self._changed.wait(0.1)
            return TriggerResponse(True, f"{self._now / NANOSECONDS:.9f} s")

    def _on_reset(self, _: TriggerRequest) -> TriggerResponse:
        """Put the car at its start pose, at rest, with its odometry at zero; time goes on."""
        with self._changed:
            now = self._read_clock()
            self._history = History(self._car, at_rest(now, self._start), self._world)
            self._stream = None
            self._changed.notify_all()
        return TriggerResponse(True, f"at the start pose since {now / NANOSECONDS:.9f} s")


def _has_to_keep_the_clock() -> bool:
    """Say whether time is to be simulated, and nobody that is alive does so yet."""
    master = rosgraph.get_master_uri()
    try:
        if not ask(master, PATIENCE, "car_sim", "getParam", "/use_sim_time"):
            return False
        publishers, _, _ = ask(master, PATIENCE, "car_sim", "getSystemState")
    except CallError:
        return False  # it is not set, or there is no master, which init_node says
    names = {name for topic, nodes in publishers if topic == "/clock" for name in nodes}
    return not any(map(responds, names))


def _topic(msg: rospy.Message) -> str:
    """Return the name of the topic that a received message came on."""
    return msg._connection_header["topic"]


def main() -> int:
    """Run the node; return its exit status."""
    keeps_clock = _has_to_keep_the_clock()
    # Who keeps the clock does not listen to it too.
    init_node("car_sim", disable_rostime=keeps_clock)
    try:
        node = CarSim(keeps_clock)
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    with suppress(rospy.ROSInterruptException):
        node.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
