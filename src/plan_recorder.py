#!/usr/bin/python3
"""Record the commands that the car receives, from any source, as a plan."""

import contextlib
import threading
from typing import Callable, Iterator, Optional

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from mushr_ros_intro.authoring.plan_file import PlanFile, plan_file_parameters
from mushr_ros_intro.authoring.recorder import Recording
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import Values
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.simulator.car_parameters import simulated_car_parameters
from mushr_ros_intro.stamps import CurrentTime


class PlanRecorder:
    """The recorder as a node.

    Subscribes to the mux's output, to the car's pose and to ``~init_pose_topic``: a new initial
    pose begins a new recording. Services: ``~save`` writes the drive so far into a plan file,
    ``~clear`` begins a new recording. At shutdown the node saves what is not saved yet.

    Example: ``rosrun mushr_ros_intro plan_recorder.py _name:=my_drive.txt``
    """

    PARAMETERS = (
        node.car_name("the car to record"),
        node.init_pose_topic("topic of the initial pose"),
        *plan_file_parameters("recorded.txt"),
    )

    def __init__(self, values: Values) -> None:
        car_name = values["car_name"]
        self._file = PlanFile(values["folder"], values["name"])
        car = car_from(simulated_car_parameters(car_name))
        self._command_timeout = car.command_timeout

        self._lock = threading.Lock()
        self._time = CurrentTime()
        self._begin_anew()

        node.offer_service("~save", self._lock, self._save)
        node.offer_service("~clear", self._lock, self._begin_anew)
        self._pose_sub = rospy.Subscriber(
            f"/{car_name}/car_pose", PoseStamped, self._on_pose, tcp_nodelay=True
        )
        self._empty = (
            "this recording has no drive: there was no command to drive after the first pose on "
            f"{self._pose_sub.resolved_name}"
        )
        rospy.Subscriber(
            values["init_pose_topic"],
            PoseWithCovarianceStamped,
            self._on_initial_pose,
            tcp_nodelay=True,
        )
        output = f"/{car_name}/mux/ackermann_cmd_mux/output"
        rospy.Subscriber(output, AckermannDriveStamped, self._on_command, tcp_nodelay=True)
        rospy.loginfo(f"recording begins with the first command on {output}")
        rospy.loginfo("%s", self._file.destination())

    def run(self) -> None:
        """Record until the node is shut down; then save the drive, and log what was saved.

        Raises:
            UserError: it cannot be saved.
        """
        rospy.spin()
        # Not in rospy.on_shutdown: the process would not wait for a hook in another thread.
        with self._lock:
            rospy.loginfo("%s", self._written(self._file.finish))

    @conversions.ignore_bad_messages
    def _on_pose(self, msg: PoseStamped) -> None:
        pose = conversions.pose_from_msg(msg.pose)
        with self._event() as now:
            self._recording.add_pose(msg.header.stamp.to_nsec(), pose, now)

    @conversions.ignore_bad_messages
    def _on_initial_pose(self, msg: PoseWithCovarianceStamped) -> None:
        initial_pose = conversions.initial_pose_from_msg(msg)
        with self._event() as now:
            if not self._file.is_saved(self._recording.place(initial_pose, now)):
                rospy.logwarn("new initial pose: recording begins anew; the drive was not saved")

    @conversions.ignore_bad_messages
    def _on_command(self, msg: AckermannDriveStamped) -> None:
        command = conversions.command_from_msg(msg)
        if command.acceleration or command.steering_angle_velocity:
            rospy.logwarn_throttle(
                10.0, "the commands limit the acceleration or the steering rate; a plan cannot"
            )
        with self._event() as now:
            if not self._recording.add_command(command, now):
                topic = self._pose_sub.resolved_name
                rospy.logwarn_throttle(1.0, f"not recording: there is no pose on {topic}")

    @contextlib.contextmanager
    def _event(self) -> Iterator[int]:
        """Hold the lock while an event is handled; yield the current time [ns].

        If the clock was set back, begin a new recording first.
        """
        with self._lock:
            if self._time.update(ros_time.now()):
                if not self._file.is_saved(self._recording.plan()):
                    rospy.logwarn(
                        "the clock was set back: recording begins anew; the drive was not saved"
                    )
                self._begin_anew()
            was_recording = self._recording.begin is not None
            yield self._time.now
            if not was_recording and self._recording.begin is not None:
                rospy.loginfo("recording")

    def _begin_anew(self) -> str:
        """Begin a new recording; return a message; needs the lock."""
        self._recording = Recording(self._command_timeout, ros_time.stamp_tolerance())
        return "recording begins with the next command"

    def _save(self) -> str:
        """Write the drive so far into a new file; return a message; needs the lock.

        Raises:
            UserError: there is no drive, or it cannot be written.
        """
        return self._written(self._file.save)

    def _written(self, write: Callable[[Optional[Plan], str], str]) -> str:
        """Write the drive so far; return a message; needs the lock.

        Whether the start pose is exact is known only now: an initial pose can arrive after the
        commands that were sent after it.
        """
        message = write(self._recording.plan(), self._empty)
        if self._recording.begin is None or self._recording.is_start_exact:
            return message
        return f"{message}; the car was moving at the start, so the start pose is approximate"


if __name__ == "__main__":
    node.main("plan_recorder", PlanRecorder)
