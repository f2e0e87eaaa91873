#!/usr/bin/python3
"""Drive a plan: publish its start pose, and then its commands ten times a second."""

import math
import os
import sys
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import rosgraph
import rospkg
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import Point, PoseArray, PoseStamped, PoseWithCovarianceStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Path
from rospy.numpy_msg import numpy_msg
from std_msgs.msg import String
from tf.transformations import quaternion_from_euler
from visualization_msgs.msg import MarkerArray

from mushr_ros_intro.car.bicycle import Pose, compose, inverse
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.model import Command, InitialPose, State
from mushr_ros_intro.car.profile import car_from, names_in, read_profile
from mushr_ros_intro.parameters import ParameterError, Parameters, flag, number, text
from mushr_ros_intro.plan.find import find_plan, read_plan
from mushr_ros_intro.plan.model import Fault, Plan, PlanError, Row
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.preview.limits import slowed
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.preview.report import check
from mushr_ros_intro.preview.spread import spread
from mushr_ros_intro.preview.text import SHOWN_FAULTS
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.connections import (
    PATIENCE,
    REANNOUNCE_EVERY,
    reannounce,
    registered_nodes,
    wait_until_connected,
)
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.ros.sim_time import sleep_until
from mushr_ros_intro.sim.mux import NOBODY, TakeoverMonitor
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD as PERIOD
from mushr_ros_intro.sim.stamps import NANOSECONDS, STAMP_TOLERANCE, effective_stamp
from mushr_ros_intro.world.grid import Grid

POSE_TOLERANCE = 1e-3
"""How far from the start pose the car may report itself [m, rad] once it has taken it."""

LEAD = STAMP_TOLERANCE - PERIOD
"""How far ahead of the clock a plan begins in lock-step [ns]: as far as a stamp is taken as it is.

The clock runs on until the start pose has come, and then takes no time to get there. Where the car
stands at the start pose anyway, only the stamp of its report can say that it has.
"""

SETTLING = 2 * PERIOD
"""How long after the car should stand [ns] its pose is compared with the prediction."""

MAX_PATH_POSES = 10_000
"""The predicted path of a long plan has no more poses than about this many."""

MAX_WALL_COMMANDS = 10_000
"""A plan with more commands is predicted as if there were no walls: they take time to look at."""

MAP_TOPIC = "/map"

SPREAD_RUNS = 1000
SPREAD_SEED = 1
MAX_SPREAD_COMMANDS = 20_000
"""The spread of a plan with more commands is not shown: it would take more than seconds."""

NO_MASTER = "the master does not answer, and the plan is given up"


class DriveError(RuntimeError):
    """A plan that cannot be driven, or not to its end; says why."""


class PathPublisher:
    """The tutorial's node.

    Publishes geometry_msgs/PoseWithCovarianceStamped on ``~init_pose_topic`` and
    ackermann_msgs/AckermannDriveStamped on ``~control_topic``; listens to /CAR_NAME/car_pose,
    where the car says that it has taken the start pose, and in the end where it stopped. Before
    it drives, it checks the plan, on the map on /map where there is one, and publishes, latched,
    nav_msgs/Path on ``~predicted_path``: where the plan takes the car. What car that is stands in
    the parameters of /CAR_NAME/car_sim, or in the profile ``~car``. With ``~spread`` it publishes
    likewise geometry_msgs/PoseArray on ``~spread_poses`` and visualization_msgs/MarkerArray on
    ``~spread_ellipses``: where cars with errors end, and pass. Where ``~active_topic`` is set
    (std_msgs/String, of the mux), the plan is over when somebody else drives the car.
    """

    def __init__(self) -> None:
        car_name = text("~car_name", rospy.get_param("~car_name", "car")).strip("/")
        control_topic = text(
            "~control_topic",
            rospy.get_param(
                "~control_topic", f"/{car_name}/mux/ackermann_cmd_mux/input/navigation"
            ),
        )
        init_pose_topic = text(
            "~init_pose_topic", rospy.get_param("~init_pose_topic", "/initialpose")
        )
        self._patience = number(
            "~subscriber_timeout", rospy.get_param("~subscriber_timeout", 10.0), "s", 0.0, 1e6
        )
        self._places_car = flag("~send_init_pose", rospy.get_param("~send_init_pose", True))
        self._loop = flag("~loop", rospy.get_param("~loop", False))
        self._is_strict = flag("~strict", rospy.get_param("~strict", False))
        self._shows_spread = flag("~spread", rospy.get_param("~spread", False))
        self._countdown = number("~countdown", rospy.get_param("~countdown", 0.0), "s", 0.0, 1e4)
        max_speed = rospy.get_param("~max_speed", math.inf)
        max_speed = number("~max_speed", max_speed, "m/s", 0.001, math.inf)
        active_topic = _text_or_none("~active_topic")
        self._profile, self._profile_name = _load_profile(_text_or_none("~car"))
        self._plan, changes = slowed(_load_plan(rospy.get_param("~plan_file", None)), max_speed)
        for line in _shown(changes):
            rospy.logwarn("%s", line)
        self._car_sim = f"/{car_name}/car_sim"
        self._frame = f"{car_name}/base_footprint"

        self._lock = threading.Lock()
        self._stopped = False
        self._last: Optional[Command] = None
        self._written: Dict[int, int] = {}
        self._release = 0
        self._next_line = 0
        self._quiet_until = 0.0
        self._watch = TakeoverMonitor(control_topic.rsplit("/", 1)[-1])
        self._active: Optional[str] = None
        self._is_over = False
        self._poses = threading.Condition()
        self._pose: Optional[Pose] = None
        self._pose_stamp = 0
        self._driven = 0.0

        # Every command counts, also when a stalled machine lets several fall due at once.
        self._pub_controls = rospy.Publisher(
            control_topic, AckermannDriveStamped, queue_size=100, tcp_nodelay=True
        )
        self._pub_init_pose = rospy.Publisher(
            init_pose_topic, PoseWithCovarianceStamped, queue_size=10, tcp_nodelay=True
        )
        self._pose_sub = rospy.Subscriber(
            f"/{car_name}/car_pose", PoseStamped, self._on_pose, tcp_nodelay=True
        )
        self._pub_path = rospy.Publisher("~predicted_path", Path, queue_size=1, latch=True)
        if self._shows_spread:
            self._pub_spread = rospy.Publisher("~spread_poses", PoseArray, queue_size=1, latch=True)
            self._pub_ellipses = rospy.Publisher(
                "~spread_ellipses", MarkerArray, queue_size=1, latch=True
            )
        self._active_sub = None
        if active_topic:
            self._active_sub = rospy.Subscriber(active_topic, String, self._on_active)
        rospy.loginfo(
            "plan %s: %d rows, %g s, %.2f m%s; commands to %s, %s",
            self._plan.path,
            len(self._plan.rows),
            self._plan.duration / NANOSECONDS,
            prediction.length(self._plan),
            ", in a loop" if self._loop else "",
            self._pub_controls.resolved_name,
            f"start pose to {self._pub_init_pose.resolved_name}"
            if self._places_car
            else "no start pose",
        )

    def run(self) -> None:
        """Drive the plan, once or until the node is shut down.

        Raises:
            DriveError: the plan cannot be driven, or not to its end.
            rospy.ROSInterruptException: the node is shut down.
        """
        try:
            self._wait_for_clock()
            self._wait_for_subscriber(self._pub_controls)
            if self._places_car:
                self._wait_for_subscriber(self._pub_init_pose)
                wait_until_connected(self._pose_sub, "publishers", self._patience)
            self._meet_car()
            self._look_ahead()
            self._wait_for_mux()
            self._count_down()
            start = None
            while start is None or self._loop:
                start = self.run_plan(start)
        finally:
            self.stop()

    def _meet_car(self) -> None:
        """Read from the parameters of the simulated car, if it is one, what car it is."""
        if rospy.rostime.is_wallclock() and rospy.get_param("/use_sim_time", False):
            raise DriveError("use_sim_time was set after this node had started; start it again")
        simulated = rospy.get_param(self._car_sim, {})
        self._leads = not rospy.rostime.is_wallclock() and "real_time_factor" in simulated
        self._in_lock_step = self._leads and not simulated["real_time_factor"]
        if self._profile is None:
            self._profile, place = simulated, f"{self._car_sim}/"
        else:
            place = "~car: "
        self._car = car_from(Parameters(self._profile, place))
        self._noisy_car = car_from(Parameters({**self._profile, "noise": True}, place))

    def _look_ahead(self) -> None:
        """Check the plan, and publish where it takes the car, stamped as if driven from now on.

        Raises:
            DriveError: the plan has faults, and is to be driven only without any.
        """
        grid = self._read_map() if self._places_car else None
        report = check(self._plan, self._profile_name, self._car, "", grid)
        faults = _shown(report.faults)
        if faults and self._is_strict:
            shown = "\n".join(faults)
            raise DriveError(f"~strict is set and the plan has faults; it is not driven\n{shown}")
        for line in faults:
            rospy.logwarn("%s", line)

        # Where the car hits nothing, the walls need not be looked at again.
        self._world = None
        if grid and report.hit and count_commands(self._plan) <= MAX_WALL_COMMANDS:
            self._world = World(grid)
        self._pub_path.publish(conversions.path_to_msg(self._predict(), self._now()))
        if self._shows_spread:
            self._publish_spread()

    def _predict(self) -> Iterable[State]:
        """Note where the car comes to rest, and when; return where it is on the way."""
        self._rest, self._expected = prediction.rest(self._plan, self._car, self._world)
        period = max(PERIOD, self._rest // MAX_PATH_POSES)
        return prediction.trajectory(self._plan, self._car, period, self._world)

    def _read_map(self) -> Optional[Grid]:
        """Return the map, or None where nobody publishes one."""
        topic = rospy.resolve_name(MAP_TOPIC)
        if not _is_published(topic):
            return None
        try:
            msg = rospy.wait_for_message(topic, numpy_msg(OccupancyGrid), PATIENCE)
            return conversions.grid_from_msg(msg)
        except rospy.ROSInterruptException:
            raise
        except (rospy.ROSException, conversions.MessageError) as error:
            rospy.logwarn("the plan is not checked against the map on %s: %s", topic, error)
        return None

    def _publish_spread(self) -> None:
        """Publish where many cars end that each have errors of their own, and pass on the way."""
        car = self._noisy_car
        if not (car.speed_noise or car.steering_noise):
            rospy.loginfo("this car has no noise, so there is no spread to show")
            return
        if count_commands(self._plan) > MAX_SPREAD_COMMANDS:
            rospy.logwarn(
                "the spread is not shown: the plan has %d commands, and expected are at most %d",
                count_commands(self._plan),
                MAX_SPREAD_COMMANDS,
            )
            return
        result = spread(self._plan, car, SPREAD_RUNS, SPREAD_SEED)
        ellipses = []
        for mean, (major, minor, direction) in zip(result.mean.tolist(), result.ellipses):
            ellipses.append((Pose(mean[0], mean[1], direction), major, minor))
        poses = (Pose(*pose) for pose in result.cloud.tolist())
        self._pub_spread.publish(conversions.poses_to_msg(poses, self._now()))
        self._pub_ellipses.publish(conversions.ellipses_to_msg(ellipses, self._now()))
        rospy.loginfo(
            "%d cars with errors of their own end %.2f m (root mean square) off the plan; "
            "their 95 %% ellipse is %.2f m long and %.2f m wide",
            SPREAD_RUNS,
            result.rms_errors[-1],
            2.0 * ellipses[-1][1],
            2.0 * ellipses[-1][2],
        )

    def run_plan(self, begin: Optional[int]) -> int:
        """Place the car and send every command of the plan.

        Args:
            begin: when to place the car, if it is placed [ns], None: now, or `LEAD` from now. The
                first command is due one period later, or once the car has taken the start pose,
                if it takes longer.

        Returns:
            When the plan ends, and the car is to stop [ns].
        """
        placed = self._now() if begin is None else begin
        if begin is None and self._in_lock_step:
            placed += LEAD
        placement = InitialPose(placed, Pose(*self._plan.start))
        if begin is not None:
            self._wait_until(self._release if self._leads else begin)
        if self._places_car:
            self.send_init_pose(placement)
        if begin is not None and not self._in_lock_step:
            self._send(Command(begin, 0.0, 0.0))
        if self._places_car:
            self._wait_for_start_pose(placement)
        if begin is not None and self._in_lock_step:
            # The car stands where it has been placed. A clock that knew of a stop alone would run
            # on soon, with the placement still to come.
            self._send(Command(begin, 0.0, 0.0))
        start, self._release = placed + PERIOD, placed
        if begin is None:
            if self._leads:
                sleep_until(self._pose_stamp, self._now())  # the car's pose comes before its clock
            self._release = self._now()
            start = first_due(placed, self._pose_stamp, self._release, self._leads)
        end = start + self._plan.duration
        self._next_line = start
        due = start
        for index, row in enumerate(self._plan.rows, 1):
            where = f"row {index} of {len(self._plan.rows)}"
            self.send_command(row, due, where, end)
            due += row.duration
        if not self._loop:
            self._send(Command(end, 0.0, 0.0))
            self._is_over = True  # who drives the car from now on does not matter
            self._report_end(end)
        return end

    def send_init_pose(self, placement: InitialPose) -> None:
        """Place the car."""
        x, y, theta = placement.pose
        msg = PoseWithCovarianceStamped()
        msg.header.stamp = conversions.time_from(placement.stamp)
        msg.header.frame_id = conversions.MAP_FRAME
        msg.pose.pose.position = Point(x=x, y=y)
        msg.pose.pose.orientation = Quaternion(*quaternion_from_euler(0, 0, theta))
        self._pub_init_pose.publish(msg)

    def _wait_for_start_pose(self, placement: InitialPose) -> None:
        """Wait until the car is where it has been placed, where anybody reports its pose.

        Raises:
            DriveError: it reports another pose, or none since.
        """
        topic = self._pose_sub.resolved_name
        if not self._is_reported():
            rospy.loginfo("nobody publishes %s, so the start pose is not checked", topic)
            return

        def is_there() -> bool:
            return self._pose_stamp >= placement.stamp and _close(self._pose, placement.pose)

        if not self._wait_for_pose(is_there, self._patience):
            raise DriveError(
                f"the car did not take the start pose {_pose_text(placement.pose)} within "
                f"{self._patience:g} s; {topic} says {_pose_text(self._pose)}. "
                "Is a wall there, is the clock held, or does something else place the car?"
            )
        self._driven = 0.0

    def send_command(self, row: Row, start: int, where: str, end: int) -> None:
        """Send a row's command at `start` [ns], and every 0.1 s from then on while it lasts.

        Every second of the plan it says `where` in it this is, and how long it takes to the `end`
        [ns]; where simulated time runs fast, no more often than one can read.
        """
        for due in range(start, start + row.duration, PERIOD):
            self._send(Command(due, row.speed, row.steering_angle))
            if due >= self._next_line:
                self._next_line += NANOSECONDS
                is_fast = not rospy.rostime.is_wallclock()
                if is_fast and time.monotonic() < self._quiet_until:
                    continue
                self._quiet_until = time.monotonic() + 0.5
                left = (end - due) / NANOSECONDS
                rospy.loginfo(
                    "%s: %g m/s, %g rad; %.1f s left", where, row.speed, row.steering_angle, left
                )

    def stop(self) -> None:
        """Stop the car for good, unless it has not been driven, and see the last message off."""
        with self._lock:
            if self._last and not self._stopped:
                if self._last.speed or self._last.steering_angle:
                    self._publish(Command(max(self._now(), self._last.stamp), 0.0, 0.0))
                self._flush()
            self._stopped = True

    def _send(self, command: Command) -> None:
        """Publish a command when it is due, unless the car has been stopped for good.

        The simulated car in simulated time gets each command when the one before it is due. So
        it can let the clock run up to the newest stamp, knowing that nothing older will come.
        """
        self._wait_until(self._release if self._leads else command.stamp)
        self._release = command.stamp
        with self._lock:
            self._raise_if_stopped()
            self._publish(command)

    def _raise_if_stopped(self) -> None:
        """Give up if the car has been stopped for good.

        Raises:
            DriveError: because somebody else drives it.
            rospy.ROSInterruptException: because the node is shut down.
        """
        if self._stopped and self._watch.lost_to:
            assert self._active_sub
            said = f"{self._active_sub.resolved_name} says '{self._watch.lost_to}'"
            if self._watch.lost_to.lower() in NOBODY:
                why = "the commands no longer reached the car in time"
            else:
                why = "somebody else drives the car"
            text = f"the plan is over: {said}, so {why}. It is not taken up again"
            if not self._last:
                text = (
                    f"{text}. No command has been sent; a joystick of MuSHR's has the car unless "
                    "its button for autonomous driving (RB) is held all the time"
                )
            raise DriveError(text)
        if self._stopped:
            raise rospy.ROSInterruptException("the car has been stopped")

    def _publish(self, command: Command) -> None:
        """Publish a command; needs the lock."""
        self._last = command
        self._written = self._count_written()
        self._pub_controls.publish(conversions.command_to_msg(command, self._frame))

    def _flush(self) -> None:
        """Wait until the last command is on its way: at its end rospy drops what is queued."""
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            now = self._count_written()
            if all(now[link] > count for link, count in self._written.items() if link in now):
                return
            time.sleep(0.001)

    def _count_written(self) -> Dict[int, int]:
        """Return how many commands have been written to each connection."""
        _, _, connections = self._pub_controls.impl.get_stats()
        return {link: count for link, _, count, connected in connections if connected}

    def _wait_until(self, due: int) -> None:
        """Sleep until `due` [ns].

        Raises:
            DriveError: that is long past, or far away, because the clock was set or the machine
                or the way to the master stood still; what is left of the plan would not be what
                was planned.
        """
        while True:
            now = self._now()
            early = due - now
            if abs(early) > STAMP_TOLERANCE:
                raise DriveError(
                    f"a command is due {early / NANOSECONDS:+.1f} s from now: the clock was set, "
                    "this machine stood still, or the way to the master is cut. The plan is given "
                    "up"
                )
            if early <= 0:
                return
            sleep_until(due, now)  # where time moves back, the next look at the clock says how far

    def _wait_for_clock(self) -> None:
        """Wait until there is a time at all, which under use_sim_time somebody must publish."""
        deadline = time.monotonic() + self._patience
        while not self._now():
            if time.monotonic() > deadline:
                raise DriveError(
                    f"use_sim_time is set, but nobody published /clock within {self._patience:g} s"
                )
            self._pause()

    def _wait_for_subscriber(self, publisher: rospy.Publisher) -> None:
        """Wait until somebody listens to `publisher`, and all who are going to do."""
        began = time.monotonic()
        reminders = 0
        while not publisher.get_num_connections():
            waited = time.monotonic() - began
            if waited > self._patience:
                raise DriveError(self._nobody(publisher.resolved_name))
            if waited > (reminders + 1) * REANNOUNCE_EVERY:
                if not reminders:
                    rospy.loginfo("waiting for a subscriber to %s", publisher.resolved_name)
                reminders += 1
                reannounce(publisher, "subscribers")
            self._pause()
        is_connected = wait_until_connected(publisher, "subscribers", self._patience)
        self._pause()
        if not is_connected:
            rospy.logwarn("not every subscriber to %s is connected", publisher.resolved_name)

    def _nobody(self, topic: str) -> str:
        """Say why nobody hears a topic after so long."""
        try:
            names = registered_nodes(topic, "subscribers")
        except (rosgraph.MasterException, OSError):
            names = []
        if names:
            return (
                f"nobody is connected to {topic} after {self._patience:g} s; the master knows who "
                f"should be: {', '.join(names)}. Does that answer (rosnode ping)? Nodes that are "
                "stopped, as by Ctrl-Z, can hold up the master"
            )
        return (
            f"nobody subscribes to {topic} after {self._patience:g} s. Is the car running "
            "(roslaunch mushr_ros_intro sim.launch), and is that its topic (rostopic list)?"
        )

    def _wait_for_mux(self) -> None:
        """Wait until the mux has said who drives, if that is of interest."""
        deadline = time.monotonic() + self._patience
        while self._active_sub and self._active is None:
            if time.monotonic() > deadline:
                raise DriveError(
                    f"{self._active_sub.resolved_name} said nothing within {self._patience:g} s, "
                    "so nobody could take the car over. Is the mux running, and is that its topic "
                    "(rostopic list)?"
                )
            self._pause()

    def _count_down(self) -> None:
        """Let the countdown pass, and say so every second."""
        end = time.monotonic() + self._countdown
        shown = 0
        while time.monotonic() < end:
            left = math.ceil(end - time.monotonic())
            if left != shown:
                shown = left
                rospy.loginfo("the car drives in %d s; Ctrl-C keeps it from that", left)
            self._pause()

    def _pause(self) -> None:
        """Let a moment of wall-clock time pass."""
        if rospy.is_shutdown():
            raise rospy.ROSInterruptException("shut down while waiting")
        self._raise_if_stopped()
        time.sleep(0.01)

    def _on_active(self, msg: String) -> None:
        """Stop the car for good if it is lost to somebody else."""
        with self._lock:
            self._active = msg.data
            if self._is_over or self._stopped:
                return
            self._watch = self._watch.hear(msg.data, self._last is not None)
        if self._watch.lost_to:
            self.stop()

    def _on_pose(self, msg: PoseStamped) -> None:
        """Note where the car is, and how far it has come."""
        try:
            pose = conversions.pose_from_msg(msg.pose)
        except conversions.MessageError as error:
            rospy.logwarn_throttle(
                1.0, f"ignored a pose on {self._pose_sub.resolved_name}: {error}"
            )
            return
        stamp = msg.header.stamp.to_nsec()
        if rospy.rostime.is_wallclock():
            stamp = effective_stamp(stamp, self._now())  # the car's clock may be another
        with self._poses:
            if self._pose is not None:
                self._driven += math.hypot(pose.x - self._pose.x, pose.y - self._pose.y)
            self._pose, self._pose_stamp = pose, stamp
            self._poses.notify_all()

    def _is_reported(self) -> bool:
        """Say whether anybody reports the car's pose."""
        return bool(self._pose_sub.get_num_connections()) or _is_published(
            self._pose_sub.resolved_name
        )

    def _wait_for_pose(self, condition: Callable[[], bool], patience: float) -> bool:
        """Wait until the car's reported pose meets a condition; say whether it does."""
        deadline = time.monotonic() + patience
        with self._poses:
            while not condition():
                if rospy.is_shutdown():
                    raise rospy.ROSInterruptException("shut down while waiting")
                self._raise_if_stopped()
                if time.monotonic() > deadline:
                    return False
                self._poses.wait(0.1)
        return True

    def _report_end(self, end: int) -> None:
        """Say where the car stopped, and where it should have."""
        expected = self._expected
        if not self._places_car:
            way = compose(inverse(Pose(*self._plan.start)), expected)
            x, y = round(way.x, 2), round(way.y, 2)
            rospy.loginfo(
                "the plan has been driven; the car should stand %.2f m %s where it began, %.2f m "
                "to the %s, and turned by %.2f rad",
                abs(x),
                "ahead of" if x >= 0.0 else "behind",
                abs(y),
                "left" if y >= 0.0 else "right",
                way.theta,
            )
            return
        is_closed_form = self._car.is_ideal and self._world is None
        means = "closed form" if is_closed_form else "prediction"
        rospy.loginfo("the plan has been driven; its %s ends at %s", means, _pose_text(expected))
        if not self._is_reported():
            return
        rolling = self._rest - self._plan.duration  # a car with limits does not stand at once
        stands = end + rolling + SETTLING

        def has_settled() -> bool:
            # A command that comes late is put in its place, and the pose is another from then on.
            is_there = _close(self._pose, expected)
            return self._pose_stamp >= (stands if is_there else stands + STAMP_TOLERANCE)

        patience = self._patience + (rolling + STAMP_TOLERANCE) / NANOSECONDS
        if not self._wait_for_pose(has_settled, patience):
            rospy.logwarn("the car no longer reports its pose")
            return
        with self._poses:
            pose, driven = self._pose or expected, self._driven
        rospy.loginfo(
            "the car drove %.2f m and stopped at %s; difference %.1e m, %.1e rad",
            driven,
            _pose_text(pose),
            math.hypot(pose.x - expected.x, pose.y - expected.y),
            abs(math.remainder(pose.theta - expected.theta, math.tau)),
        )

    @staticmethod
    def _now() -> int:
        """Return the present [ns]."""
        return rospy.get_rostime().to_nsec()


def first_due(placed: int, reported: int, now: int, leads: bool) -> int:
    """Return when a plan's first command is due [ns], one period after the car has been placed.

    Args:
        placed: when the car was to be placed [ns].
        reported: the stamp of the newest pose that it has reported [ns].
        now: the present [ns].
        leads: whether the clock waits for the commands: then, if it ran on before the car knew of
            its placement, the plan begins after the report, and not at a random present.
    """
    due = placed + PERIOD
    if not leads:
        return max(due, now)
    return due if reported < due else reported + PERIOD


def _text_or_none(name: str) -> Optional[str]:
    """Return the text of a parameter, or None where it is left out or empty."""
    value = rospy.get_param(name, "")
    return None if value == "" else text(name, value)


def _load_profile(name: Optional[str]) -> Tuple[Optional[Mapping[str, Any]], str]:
    """Return the profile of the car that ``~car`` names, if it does, and what to call the car."""
    if name is None:
        return None, "car"
    folder = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "config", "cars")
    names = names_in(folder)
    if name not in names:
        raise ParameterError(f"parameter ~car is {name!r}; expected one of {', '.join(names)}")
    return read_profile(os.path.join(folder, f"{name}.yaml")), name


def _load_plan(plan_file: Any) -> Plan:
    """Read the plan that ``~plan_file`` names."""
    if plan_file is None:
        raise ParameterError(
            "parameter ~plan_file is not set; expected the name or the path of a plan, "
            "such as _plan_file:=figure_8"
        )
    package = rospkg.RosPack().get_path("mushr_ros_intro")
    plans = os.path.realpath(os.path.join(package, "plans"))
    return read_plan(find_plan(text("~plan_file", plan_file), plans))


def _shown(faults: Sequence[Fault]) -> List[str]:
    """Return faults as lines, a bounded number."""
    lines = [str(fault) for fault in faults[:SHOWN_FAULTS]]
    if len(faults) > SHOWN_FAULTS:
        lines.append(f"... and {len(faults) - SHOWN_FAULTS} more")
    return lines


def _is_published(topic: str) -> bool:
    """Say whether anybody publishes a topic, as far as the master can tell."""
    try:
        return bool(registered_nodes(topic, "publishers"))
    except (rosgraph.MasterException, OSError):
        return False


def _close(pose: Optional[Pose], other: Pose) -> bool:
    """Say whether a reported pose is another one, within the tolerance."""
    return (
        pose is not None
        and math.hypot(pose.x - other.x, pose.y - other.y) <= POSE_TOLERANCE
        and abs(math.remainder(pose.theta - other.theta, math.tau)) <= POSE_TOLERANCE
    )


def _pose_text(pose: Optional[Pose]) -> str:
    """Return a pose as text."""
    return "nothing" if pose is None else str(pose)


def main() -> int:
    """Run the node; return its exit status."""
    init_node("path_publisher")
    try:
        node = PathPublisher()
    except (ParameterError, PlanError) as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    except OSError as error:
        rospy.logfatal("%s: %s: %s", rospy.get_name(), NO_MASTER, error)
        return 1

    status = 1

    def drive() -> None:
        nonlocal status
        try:
            node.run()
            status = 0
        except rospy.ROSInterruptException:
            status = 0
        except (DriveError, ParameterError) as error:
            rospy.logfatal("%s: %s", rospy.get_name(), error)
        except OSError as error:
            rospy.logfatal("%s: %s: %s", rospy.get_name(), NO_MASTER, error)

    # In a thread of its own: Ctrl-C holds up this one, until the stop has been sent after the
    # command that was on its way.
    thread = threading.Thread(target=drive, daemon=True)
    rospy.on_shutdown(node.stop)
    thread.start()
    thread.join()
    # Where the master had the node shut down, another thread does so, beginning with the stop: it
    # has yet to sign off, and would end with this one.
    while rospy.core.is_shutdown_requested() and not rospy.is_shutdown():
        time.sleep(0.01)
    return status


if __name__ == "__main__":
    sys.exit(main())
