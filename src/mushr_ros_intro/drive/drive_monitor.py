"""Watch the car while a plan is driven, and report how the drive ended."""

import math
import threading
import time
from contextlib import suppress
from typing import Optional, Set

import rosgraph
import rospy
from geometry_msgs.msg import PoseArray

from mushr_ros_intro.drive.car_pose import POSE_TOLERANCE, CarPose, ReportedPose
from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.drive.preview_publisher import Prediction
from mushr_ros_intro.drive.timetable import Timetable
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import compose, inverse
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.ros.connections import registered_nodes
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault, ask
from mushr_ros_intro.stamps import CALL_TIMEOUT, NANOSECONDS, SETTLING, STAMP_TOLERANCE

TOLERANCE = 0.1
"""A final pose that differs by more from an exact prediction is an error [m, rad]."""

CHECK_PERIOD = 0.4
"""Period of the checks while the plan is driven [s of wall-clock time]."""

REPORT_TIMEOUT = 10.0
"""Longest wait for the car's report after the plan, or for its clock [s of wall-clock time]."""

HALT_TIMEOUT = 1.0
"""Longest wait for the car to stand after Ctrl-C [s of wall-clock time]."""


class DriveMonitor:
    """The observed course of a drive."""

    def __init__(
        self,
        plan: Plan,
        car_name: str,
        timetable: Timetable,
        commands: CommandPublisher,
        car_pose: CarPose,
    ) -> None:
        """Subscribe to the car's collisions, and start to watch the car.

        Create `commands` before the monitor: a shutdown then stops the car before `_log_stop`.
        """
        self._plan = plan
        self._timetable = timetable
        self._commands = commands
        self._car_pose = car_pose
        self._lost_at = ""
        self._wall = ""
        self._others: Set[str] = set()
        self._is_done = False
        rospy.Subscriber(f"/{car_name}/car_sim/collision", PoseArray, self._on_collision)
        rospy.on_shutdown(self._log_stop)
        threading.Thread(target=self._watch, daemon=True).start()
        threading.Thread(target=self._call_master, daemon=True).start()

    def _watch(self) -> None:
        """Watch the drive, in a thread: simulated time stands still if the car has died."""
        lost_since, restarts = math.inf, self._car_pose.restarts
        while not self._is_done:
            time.sleep(CHECK_PERIOD)
            self._find_others()
            if not self._timetable.start:
                continue
            now = ros_time.now()
            position = self._timetable.position(now)
            was_lost = lost_since < math.inf
            is_lost = self._car_pose.is_lost()
            is_new = restarts != self._car_pose.restarts
            if is_lost and not was_lost:
                lost_since = time.monotonic()
                self._lost_at = position
                seconds = (now - self._timetable.start) / NANOSECONDS
                rospy.logwarn(
                    f"{position}, {seconds:.1f} s after the start: the car no longer reports its "
                    f"pose on {self._car_pose.topic}. Is it still running (rosnode list)?"
                )
            elif not is_lost and (was_lost or is_new):
                lost_since, restarts = math.inf, self._car_pose.restarts
                self._lost_at = self._lost_at or position
                event = "has been restarted" if is_new else "reports its pose again"
                rospy.logwarn("%s: the car %s", position, event)
            if ros_time.is_simulated() and time.monotonic() > lost_since + REPORT_TIMEOUT:
                node.end_with_error(UserError(f"{self._lost()}, and simulated time stands still"))
                return

    def _call_master(self) -> None:
        """End the drive if the master does not answer, in a thread: a call takes up to 5 s.

        If the network is cut, no command arrives, and TCP reports no error for minutes.
        """
        while not self._is_done:
            time.sleep(CHECK_PERIOD)
            if not self._timetable.start:
                continue
            try:
                ask(rosgraph.get_master_uri(), CALL_TIMEOUT, rospy.get_name(), "getPid")
            except CallError as error:
                if error.fault is CallFault.REFUSED:
                    continue  # the master has ended; the nodes remain connected
                if not self._is_done:
                    text = f"{error}. The master is suspended, or the network to the master is cut"
                    node.end_with_error(UserError(f"{text}. The drive ends"))
                return

    def _find_others(self) -> None:
        """Log a warning for each other node that publishes commands on the same topic."""
        topic = self._commands.topic
        with suppress(rosgraph.MasterException, OSError):
            others = {*registered_nodes(topic, "publishers")} - {rospy.get_name(), *self._others}
            self._others |= others
            for name in sorted(others):
                rospy.logwarn(
                    f"{name} also publishes on {topic}. The car gets the commands of both nodes"
                )

    def _lost(self) -> str:
        """Return the message for a car that no longer reports its pose."""
        position = self._lost_at or "the end of the plan"
        return f"the car has not reported its pose on {self._car_pose.topic} since {position}"

    def finish(self, prediction: Prediction) -> None:
        """Wait until the car has come to rest, and report the drive.

        Args:
            prediction: the prediction of the drive.

        Raises:
            UserError: the car no longer reports its pose, has hit a wall, or did not end at the
                predicted pose.
            rospy.ROSInterruptException: the node is shut down.
        """
        report = self._settled(prediction) if prediction.is_placed else None
        self._is_done = True
        if report:
            self._compare(report, prediction)
        elif self._wall:
            raise UserError(self._wall)
        elif not prediction.is_placed:
            move = compose(inverse(self._plan.start), prediction.pose)
            x, y, theta = (round(value, 2) + 0.0 for value in move)  # no negative zero
            rospy.loginfo(
                "all commands have been sent; the car should stand "
                f"{abs(x):.2f} m {'ahead of' if x >= 0.0 else 'behind'} its start, "
                f"{abs(y):.2f} m to the {'left' if y >= 0.0 else 'right'}, "
                f"and turned by {theta:.2f} rad"
            )
        elif self._car_pose.last:
            raise UserError(
                f"{self._lost()}, so it is not known where it is. If it has ended, start it again "
                "(roslaunch mushr_ros_intro sim.launch)"
            )
        else:
            rospy.loginfo(
                f"all commands have been sent; the car should end at {prediction.pose}. No node "
                "reports the car's pose, so it is not known where the car is"
            )

    def _settled(self, prediction: Prediction) -> Optional[ReportedPose]:
        """Return a report of the car at rest after the plan, or None if there is none in time."""
        if not self._car_pose.last or self._car_pose.is_lost():
            return None
        end = self._timetable.end
        rest = end + prediction.rest - self._plan.duration + SETTLING

        def find() -> Optional[ReportedPose]:
            # A late command is inserted into the car's history, and can still change the pose.
            last = self._car_pose.last
            assert last is not None  # reports are never removed
            is_there = last.pose.is_close_to(prediction.pose, POSE_TOLERANCE)
            return last if last.stamp >= rest + (0 if is_there else STAMP_TOLERANCE) else None

        seconds = (rest - end + STAMP_TOLERANCE) / NANOSECONDS
        return ros_time.wait_for(find, REPORT_TIMEOUT + seconds)

    def _compare(self, report: ReportedPose, prediction: Prediction) -> None:
        """Compare the final pose with the prediction.

        Raises:
            UserError: the car has hit a wall, or did not end at the predicted pose.
        """
        expected = prediction.pose
        if self._wall:
            raise UserError(f"{self._wall}. {self._cause()}" if self._others else self._wall)
        distance, angle = report.pose.distance_to(expected), report.pose.angle_to(expected)
        is_close = report.pose.is_close_to(expected, TOLERANCE)
        if prediction.is_exact and not is_close:
            raise UserError(
                f"after the plan, the car was at {report.pose}, but it should have ended at "
                f"{expected}, {distance:.2f} m and {angle:.2f} rad from there. {self._cause()}"
            )
        done = "the plan has been driven" if is_close else "all commands of the plan have been sent"
        rospy.loginfo(f"{done}; the car should end at {expected}")
        # The distances between the reported poses have a larger sum if a command arrived late.
        driven = ""
        if prediction.distance is not None and report.pose.is_close_to(expected, POSE_TOLERANCE):
            driven = f"drove {prediction.distance:.2f} m and "
        rospy.loginfo(
            f"the car {driven}stopped at {report.pose}; difference {distance:.1e} m, "
            f"{angle:.1e} rad"
        )

    def _cause(self) -> str:
        """Return the likely cause of a wrong final pose."""
        if self._others:
            return f"{', '.join(self._others)} also published on {self._commands.topic}"
        if self._lost_at:
            return f"In {self._lost_at}, the car did not report its pose, or it was restarted"
        return "Did another input of the mux drive the car, or did another node place it?"

    def _on_collision(self, msg: PoseArray) -> None:
        """Log a collision during the drive."""
        stamp = msg.header.stamp.to_nsec()
        if msg.poses and 0 < self._timetable.start <= stamp:
            pose = conversions.pose_from_msg(msg.poses[0])
            self._wall = f"the car stopped at a wall in {self._timetable.position(stamp)} at {pose}"
            rospy.logwarn("%s", self._wall)

    def _log_stop(self) -> None:
        """If the drive is interrupted, log where the car stops, or its last pose."""
        if self._is_done or not self._timetable.start:
            return
        self._is_done = True
        position = self._timetable.stop_position()
        stands = ros_time.wait_for(self._car_pose.stands, HALT_TIMEOUT)
        last = self._car_pose.last
        text = f"stopped in {position}" if stands else f"the drive ended in {position}"
        if last:
            text += f" at {last.pose}" if stands else f"; the last reported pose is {last.pose}"
        rospy.logwarn("%s", text)
