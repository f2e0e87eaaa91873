#!/usr/bin/python3
"""Drive a plan: publish its start pose, and then a command ten times per second."""

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, Quaternion
from std_msgs.msg import Time
from tf.transformations import quaternion_from_euler

from mushr_ros_intro.drive.car_pose import CarPose
from mushr_ros_intro.drive.command_publisher import CommandPublisher
from mushr_ros_intro.drive.drive_monitor import DriveMonitor
from mushr_ros_intro.drive.preview_publisher import PREVIEW_PARAMETERS, Preview
from mushr_ros_intro.drive.timetable import Timetable
from mushr_ros_intro.parameters import Values, flag, loaded, number, text
from mushr_ros_intro.paths import find_file, package_folder
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.ros import connections, conversions, node, ros_time

PLAN = "a plan, such as _plan_file:=figure_8"
ACTIVE_TOPIC = "topic ~active of the mux; if another input drives the car, the drive ends"
TIMEOUT = "timeout for subscribers, for the start pose, and for /clock"


def read(name: str) -> Plan:
    """Return the plan that is given by its name or path."""
    return read_plan(find_file(name, package_folder("plans"), ".txt"))


def control_topic(values: Values) -> str:
    """Return the mux input for plans, of the car to drive."""
    return f"/{values['car_name']}/mux/ackermann_cmd_mux/input/navigation"


class PathPublisher:
    """The tutorial's node.

    Publishes the start pose on ``~init_pose_topic`` (geometry_msgs/PoseWithCovarianceStamped) and
    the commands on ``~control_topic`` (ackermann_msgs/AckermannDriveStamped). Waits until the car
    reports the start pose on /CAR_NAME/car_pose. Checks the plan before the drive. Publishes on
    ``~start`` (std_msgs/Time, latched) when the first row of the plan begins.
    Stops the car at the end, on Ctrl-C, on an error, and if ``~active_topic`` shows that another
    input drives.

    Example: ``rosrun mushr_ros_intro path_publisher.py _plan_file:=figure_8``
    """

    PARAMETERS = (
        loaded("plan_file", read, expected=PLAN),
        node.car_name("the car to drive"),
        text("control_topic", control_topic, "topic of the commands; by default that of the car"),
        node.init_pose_topic("topic of the start pose"),
        text("active_topic", None, ACTIVE_TOPIC),
        flag("send_init_pose", True, "place the car at the start pose"),
        flag("loop", False, "repeat the plan until killed"),
        number("countdown", 0.0, "s", 0.0, 1e4, "wait before the first command"),
        number("subscriber_timeout", 10.0, "s", 0.0, 1e6, TIMEOUT),
        *PREVIEW_PARAMETERS,
    )

    def __init__(self, values: Values) -> None:
        car_name, self.loop = values["car_name"], values["loop"]
        self.places_car, self.countdown = values["send_init_pose"], values["countdown"]
        self.timeout = values["subscriber_timeout"]
        plan = values["plan_file"]
        self.preview = Preview(plan, values, car_name, self.places_car)
        self.plan = self.preview.plan  # its speeds are limited to ~max_speed

        self.frame = f"{car_name}/base_footprint"
        self.pub_controls = CommandPublisher(values["control_topic"], values["active_topic"])
        self.pub_init_pose = rospy.Publisher(
            values["init_pose_topic"], PoseWithCovarianceStamped, queue_size=10, tcp_nodelay=True
        )
        self.pub_start = rospy.Publisher("~start", Time, queue_size=1, latch=True)
        self.car_pose = CarPose(car_name)
        self.timetable = Timetable(self.plan, self.loop)
        self.monitor = DriveMonitor(
            self.plan, car_name, self.timetable, self.pub_controls, self.car_pose
        )
        rospy.loginfo("%s", values.text)

    def run(self) -> int:
        """Drive the plan; return the exit status, which is 1 if a single drive is interrupted."""
        try:
            self.drive()
        except rospy.ROSInterruptException:
            return 0 if self.loop else 1
        return 0

    def drive(self) -> None:
        """Wait for the car, check the plan, drive it, and report the result."""
        ros_time.wait_for_clock(self.timeout)
        self.pub_controls.wait_for_subscriber(self.timeout)
        if self.places_car:
            self.car_pose.wait_until_reported(self.timeout)
            connections.wait_for_subscriber(self.pub_init_pose, self.timeout)
        prediction = self.preview.show()
        self.pub_controls.wait_until_free(self.timeout, self.countdown)

        self.run_plan()
        while self.loop:
            self.run_plan()
        self.pub_controls.stop()
        self.monitor.finish(prediction)

    def run_plan(self) -> None:
        """Place the car at the start pose, send the commands of each row, and stop the car."""
        stamp = self.timetable.begin()
        if self.places_car:
            self.send_init_pose(stamp)
            stamp = self.car_pose.wait_until_at(self.plan.start, stamp, self.timeout)
        self.timetable.start_after(stamp)
        self.pub_start.publish(Time(conversions.time_from(self.timetable.start)))
        for row in self.plan.rows:
            self.send_command(row)
        self.timetable.wait_until(self.timetable.end)
        self.pub_controls.end(self.timetable.end)

    def send_init_pose(self, stamp: int) -> None:
        """Publish the start pose with the stamp `stamp` [ns]."""
        x, y, theta = self.plan.start
        msg = PoseWithCovarianceStamped()
        msg.header.stamp = conversions.time_from(stamp)
        msg.header.frame_id = conversions.MAP_FRAME
        msg.pose.pose.position = Point(x=x, y=y)
        msg.pose.pose.orientation = Quaternion(*quaternion_from_euler(0, 0, theta))
        self.pub_init_pose.publish(msg)

    def send_command(self, row: Row) -> None:
        """Publish the command of a row ten times per second for the duration of the row."""
        for due in self.timetable.instants(row):  # instead of rospy.Rate
            msg = AckermannDriveStamped()
            msg.header.stamp = conversions.time_from(due)
            msg.header.frame_id = self.frame
            msg.drive.speed = row.speed
            msg.drive.steering_angle = row.steering_angle
            self.pub_controls.publish(msg)


if __name__ == "__main__":
    node.main("path_publisher", PathPublisher)
