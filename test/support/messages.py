"""Topics and messages of the tests, and the stamps of messages."""

import math

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped

MUX = "/car/mux/ackermann_cmd_mux"
NAVIGATION = f"{MUX}/input/navigation"
TELEOP = f"{MUX}/input/teleop"
OUTPUT = f"{MUX}/output"

COMMAND_TIMEOUT = 0.2
"""[s] The mux and the car obey a command for this time."""

LEAD = rospy.Duration(0.3)
"""The stamp of the first message is in the future by this time, so the others are sent in time."""


def command(stamp, speed, steering_angle):
    """Return a command [m/s, rad]."""
    msg = AckermannDriveStamped()
    msg.header.stamp = stamp
    msg.header.frame_id = "car/base_footprint"
    msg.drive.speed, msg.drive.steering_angle = speed, steering_angle
    return msg


def placement(stamp, x, y, theta, frame="map"):
    """Return an initial pose [m, m, rad]."""
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = stamp
    msg.header.frame_id = frame
    msg.pose.pose.position.x, msg.pose.pose.position.y = x, y
    msg.pose.pose.orientation.z = math.sin(theta / 2.0)
    msg.pose.pose.orientation.w = math.cos(theta / 2.0)
    return msg


def at(begin, seconds):
    """Return the instant `seconds` after `begin`."""
    return begin + rospy.Duration.from_sec(seconds)


def is_stop(message):
    """Return whether speed and steering angle of a command are 0."""
    return not message.drive.speed and not message.drive.steering_angle
