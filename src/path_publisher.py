#!/usr/bin/python3
"""Drive a plan: publish its start pose, and then a command ten times per second."""

import math

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion
from tf.transformations import quaternion_from_euler

from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.drive.start_pose import StartPose
from mushr_ros_intro.drive.timetable import Timetable
from mushr_ros_intro.parameters import Values, flag, loaded, number, text
from mushr_ros_intro.plan.parse import read_named_plan
from mushr_ros_intro.plan.plan import Row
from mushr_ros_intro.ros import node, ros_time

ACTIVE_TOPIC = "topic ~active of the mux; if another input drives the car, the drive ends"
TIMEOUT = 20.0
"""Timeout for subscribers, for the start pose, and for /clock [s of wall-clock time]."""


def control_topic(values: Values) -> str:
    """Return the mux input for plans, of the car to drive."""
    return f"/{values['car_name']}/mux/ackermann_cmd_mux/input/navigation"


class PathPublisher:
    """The tutorial's node.

    Publishes the start pose on ``~init_pose_topic`` (geometry_msgs/PoseWithCovarianceStamped) and
    the commands on ``~control_topic`` (ackermann_msgs/AckermannDriveStamped). Waits until the car
    reports the start pose on /CAR_NAME/car_pose. Stops the car at the end, on Ctrl-C, on an error,
    and if ``~active_topic`` shows that another input drives.

    Example: ``rosrun mushr_ros_intro path_publisher.py _plan_file:=figure_8``
    """

    PARAMETERS = (
        loaded("plan_file", read_named_plan, expected="a plan, such as _plan_file:=figure_8"),
        node.car_name("the car to drive"),
        text("control_topic", control_topic, "topic of the commands; by default that of the car"),
        node.init_pose_topic("topic of the start pose"),
        text("active_topic", None, ACTIVE_TOPIC),
        flag("send_init_pose", True, "place the car at the start pose"),
        flag("loop", False, "repeat the plan until killed"),
        number("max_speed", math.inf, "m/s", 0.001, math.inf, "faster rows are slowed down"),
        number("countdown", 0.0, "s", 0.0, 1e4, "wait before the first command"),
    )

    def __init__(self, values: Values) -> None:
        self.plan, self.loop, self.places_car = (
            values[name] for name in ("plan_file", "loop", "send_init_pose")
        )
        self.max_speed, self.countdown = values["max_speed"], values["countdown"]
        self.frame = f"{values['car_name']}/base_footprint"
        self.pub_controls = CommandPublisher(values["control_topic"], values["active_topic"])
        self.pub_init_pose = rospy.Publisher(
            values["init_pose_topic"], PoseWithCovarianceStamped, queue_size=10, tcp_nodelay=True
        )
        self.start_pose = StartPose(values["car_name"], self.plan.start)
        self.timetable = Timetable(self.plan)
        rospy.set_param("~plan_file", self.plan.path)  # drive_monitor may be in another directory
        rospy.loginfo("%s", values.text)

    def run(self) -> int:
        """Drive the plan; return the exit status, which is 1 if a single drive is interrupted."""
        try:
            self.drive()
        except rospy.ROSInterruptException:
            return 0 if self.loop else 1
        return 0

    def drive(self) -> None:
        """Wait for the car, drive the plan, and stop the car."""
        ros_time.wait_for_clock(TIMEOUT)
        self.pub_controls.wait_for_subscriber(TIMEOUT)
        if self.places_car:
            self.start_pose.wait_until_connected(self.pub_init_pose, TIMEOUT)
        if any(abs(row.speed) > self.max_speed for row in self.plan.rows):
            rospy.logwarn("rows with more than %g m/s (~max_speed) are slowed down", self.max_speed)
        self.pub_controls.wait_until_free(TIMEOUT, self.countdown)

        self.run_plan()
        while self.loop:
            self.run_plan()
        self.pub_controls.stop()
        rospy.loginfo("all commands of %s have been sent", self.plan.path)

    def run_plan(self) -> None:
        """Place the car at the start pose, send the commands of each row, and stop the car."""
        stamp = self.timetable.begin()
        if self.places_car:
            self.send_init_pose(stamp)
            stamp = self.start_pose.wait_until_reported(stamp, TIMEOUT, not self.loop)
        self.timetable.start_after(stamp)
        for row in self.plan.rows:
            self.send_command(row)
        self.timetable.wait_until(self.timetable.end)
        self.pub_controls.end(self.timetable.end)

    def send_init_pose(self, stamp: int) -> None:
        """Publish the start pose with the stamp `stamp` [ns]."""
        x, y, theta = self.plan.start
        msg = PoseWithCovarianceStamped()
        msg.header.stamp = ros_time.time_from(stamp)
        msg.header.frame_id = "map"
        msg.pose.pose.position = Point(x=x, y=y)
        msg.pose.pose.orientation = Quaternion(*quaternion_from_euler(0, 0, theta))
        self.pub_init_pose.publish(msg)

    def send_command(self, row: Row) -> None:
        """Publish the command of a row ten times per second for the duration of the row."""
        for due in self.timetable.instants(row):  # instead of rospy.Rate
            msg = AckermannDriveStamped()
            msg.header.stamp = ros_time.time_from(due)
            msg.header.frame_id = self.frame
            msg.drive.speed = max(-self.max_speed, min(self.max_speed, row.speed))
            msg.drive.steering_angle = row.steering_angle
            self.pub_controls.publish(msg)


if __name__ == "__main__":
    node.main("path_publisher", PathPublisher)
