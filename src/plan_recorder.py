#!/usr/bin/python3
"""Record what the car is told to do, whoever drives it, as a plan."""

import math
import sys
import threading
from collections import deque
from typing import Deque, Optional, Tuple

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mushr_ros_intro.authoring.recording import Recording
from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import ParameterError, Parameters, file_name, folder, text
from mushr_ros_intro.plan.model import Row
from mushr_ros_intro.plan.write import WriteError, write_plan
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import (
    NANOSECONDS,
    SIMULATED_STAMP_TOLERANCE,
    STAMP_TOLERANCE,
    effective_stamp,
)

AT_REST = 1e-3
"""A car that moves less than this [m] from one reported pose to the next stands."""


class PlanRecorder:
    """The recorder as a node.

    Subscribes to the car's commands, which are the mux's output, to its pose, of which the last
    one before the first command is where the plan starts, and to ``initialpose``: where the car is
    placed, the recording begins anew. Services: ``~save`` writes a plan file of the drive so far,
    ``~clear`` begins anew. What has not been saved is written when the node is shut down.
    """

    def __init__(self) -> None:
        car_name = text("~car_name", rospy.get_param("~car_name", "car")).strip("/")
        car_sim = f"/{car_name}/car_sim"
        car = car_from(Parameters(rospy.get_param(car_sim, {}), f"{car_sim}/"))
        init_pose_topic = text(
            "~init_pose_topic", rospy.get_param("~init_pose_topic", "/initialpose")
        )
        self._folder = folder("~folder", rospy.get_param("~folder", "."))
        self._name = file_name("~name", rospy.get_param("~name", "recorded.txt"))

        self._lock = threading.Lock()
        # Simulated time is one clock for all, and may be far on when a message of it is looked at.
        self._tolerance = (
            STAMP_TOLERANCE if rospy.rostime.is_wallclock() else SIMULATED_STAMP_TOLERANCE
        )
        self._command_timeout = car.command_timeout
        self._recording = Recording(self._command_timeout)
        self._now = 0
        self._start: Optional[Pose] = None
        self._placed: Optional[Pose] = None  # where the car has last been placed
        self._saved: Tuple[Row, ...] = ()
        self._poses: Deque[Tuple[int, Pose]] = deque()  # of the last while, with their stamps

        rospy.Service("~save", Trigger, self._on_save)
        rospy.Service("~clear", Trigger, self._on_clear)
        self._pose_sub = rospy.Subscriber(
            f"/{car_name}/car_pose", PoseStamped, self._on_pose, tcp_nodelay=True
        )
        self._placement_sub = rospy.Subscriber(
            init_pose_topic, PoseWithCovarianceStamped, self._on_placement, tcp_nodelay=True
        )
        self._command_sub = rospy.Subscriber(
            f"/{car_name}/mux/ackermann_cmd_mux/output",
            AckermannDriveStamped,
            self._on_command,
            tcp_nodelay=True,
        )
        rospy.loginfo(
            "recording begins with the first command on %s; plans go to %s",
            self._command_sub.resolved_name,
            self._folder,
        )

    def _on_pose(self, msg: PoseStamped) -> None:
        """Note where the car is."""
        try:
            pose = conversions.pose_from_msg(msg.pose)
        except conversions.MessageError as error:
            rospy.logwarn_throttle(
                1.0, f"ignored a pose on {self._pose_sub.resolved_name}: {error}"
            )
            return
        with self._lock:
            stamp = effective_stamp(msg.header.stamp.to_nsec(), self._read_clock(), self._tolerance)
            self._poses.append((stamp, pose))
            while len(self._poses) > 2 and self._poses[1][0] < stamp - 2 * self._tolerance:
                self._poses.popleft()
            begin = self._recording.begin
            if begin is None:
                return
            if stamp <= begin:
                if self._start is None:
                    rospy.loginfo("recording")
                self._start = pose
            elif self._start is None:
                self._give_up()

    def _on_placement(self, msg: PoseWithCovarianceStamped) -> None:
        """Begin anew where the car is placed."""
        try:
            placement = conversions.initial_pose_from_msg(msg)
        except conversions.MessageError:
            return  # of which the car says that it ignores it
        with self._lock:
            stamp = effective_stamp(placement.stamp, self._read_clock(), self._tolerance)
            self._placed = placement.pose
            begin = self._recording.begin
            if begin is not None and begin < stamp:
                self._warn_of_loss("the car has been placed anew")
            self._recording.forget_until(stamp)
            while self._poses and self._poses[0][0] < stamp:
                self._poses.popleft()
            self._find_start()

    def _on_command(self, msg: AckermannDriveStamped) -> None:
        """Take a command."""
        try:
            command = conversions.command_from_msg(msg)
        except conversions.MessageError:
            return  # of which the mux and the car say that they ignore it
        if command.acceleration or command.steering_angle_velocity:
            rospy.logwarn_throttle(
                10.0, "the commands limit the acceleration or the steering rate, a plan does not"
            )
        with self._lock:
            now = self._read_clock()
            before = self._recording.begin
            stamp = effective_stamp(command.stamp, now, self._tolerance)
            self._recording.add(command._replace(stamp=stamp), now)
            begin = self._recording.begin
            if begin != before:
                self._find_start()
                if before is None and self._start is not None:
                    rospy.loginfo("recording")
            # The pose before the first command may come after it, but as late as that it does not.
            if begin is not None and self._start is None and begin < now - self._tolerance:
                self._give_up()

    def _give_up(self) -> None:
        """Forget a drive that began nobody knows where, and say so; needs the lock."""
        self._recording = Recording(self._command_timeout)
        rospy.logwarn_throttle(
            1.0, f"not recording: {self._pose_sub.resolved_name} has not said where the car is"
        )

    def _find_start(self) -> None:
        """Find where the car was before the first command; needs the lock."""
        self._start = None
        begin = self._recording.begin
        if begin is None:
            return
        before = [pose for stamp, pose in self._poses if stamp <= begin][-2:]
        if not before:
            return
        self._start = before[-1]
        if _apart(before[0], self._start) and _apart(self._placed or before[0], self._start):
            rospy.logwarn(
                "the car was driving when the recording began, so the start pose is only about "
                "right; expected it to stand"
            )

    def _read_clock(self) -> int:
        """Return the present [ns]; needs the lock.

        Where the clock jumped back, the recording begins anew.
        """
        now = rospy.get_rostime().to_nsec()
        if now < self._now - STAMP_TOLERANCE:
            self._warn_of_loss("the clock jumped back")
            self._begin_anew()
            self._poses.clear()
            self._now = now
        self._now = max(self._now, now)
        return self._now

    def _begin_anew(self) -> None:
        """Forget the drive so far; needs the lock."""
        self._recording = Recording(self._command_timeout)
        self._start, self._saved = None, ()

    def _warn_of_loss(self, why: str) -> None:
        """Say that the recording begins anew, and whether it has been saved; needs the lock."""
        rows = self._recording.rows()
        if rows and rows != self._saved:
            rospy.logwarn("%s: recording begins anew; the drive before was not saved", why)
        elif rows:
            rospy.loginfo("%s: recording begins anew", why)

    def _save(self) -> str:
        """Write the drive so far into a new file; return what to say about it.

        Raises:
            WriteError: it cannot be written, or there is nothing to write.
        """
        with self._lock:
            rows, start = self._recording.rows(), self._start
            if not rows:
                raise WriteError("the car has not been driven")
            if start is None:
                topic = self._pose_sub.resolved_name
                raise WriteError(f"{topic} has not said where the car was when the drive began")
            path = write_plan(self._folder, self._name, start, rows)
            self._saved = rows
        seconds = sum(row.duration for row in rows) / NANOSECONDS
        return "saved {}; the plan has {} row{}, {:.3f} s".format(
            path, len(rows), "" if len(rows) == 1 else "s", seconds
        )

    def _on_save(self, _: TriggerRequest) -> TriggerResponse:
        """Write the drive so far."""
        try:
            said = self._save()
        except WriteError as error:
            return TriggerResponse(False, f"nothing saved: {error}")
        rospy.loginfo("%s", said)
        return TriggerResponse(True, said)

    def _on_clear(self, _: TriggerRequest) -> TriggerResponse:
        """Begin anew."""
        with self._lock:
            self._begin_anew()
        said = "recording begins with the next command"
        rospy.loginfo("cleared; %s", said)
        return TriggerResponse(True, said)

    def finish(self) -> bool:
        """Write the drive if that has not been done; say whether nothing is lost."""
        with self._lock:
            rows = self._recording.rows()
            is_saved = not rows or rows == self._saved
        if is_saved:
            return True
        try:
            rospy.loginfo("%s", self._save())
        except WriteError as error:
            rospy.logfatal("%s: the drive is not saved: %s", rospy.get_name(), error)
            return False
        return True


def _apart(one: Pose, other: Pose) -> bool:
    """Say whether the car has moved between two poses."""
    return math.hypot(one.x - other.x, one.y - other.y) > AT_REST


def main() -> int:
    """Run the node; return its exit status."""
    init_node("plan_recorder")
    try:
        node = PlanRecorder()
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    rospy.spin()
    # Here and not on_shutdown, which another thread may run that ends with this one.
    return 0 if node.finish() else 1


if __name__ == "__main__":
    sys.exit(main())
