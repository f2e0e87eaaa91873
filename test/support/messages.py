"""Messages that the tests send, and their stamps."""

import math

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped

LEAD = rospy.Duration(0.3)
"""How far ahead of the clock the tests stamp their first message: time to send the rest."""


def command(stamp, speed, steering_angle):
    """Return a command."""
    msg = AckermannDriveStamped()
    msg.header.stamp = stamp
    msg.header.frame_id = "car/base_footprint"
    msg.drive.speed, msg.drive.steering_angle = speed, steering_angle
    return msg


def placement(stamp, x, y, theta, frame="map"):
    """Return a message that places the car."""
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = stamp
    msg.header.frame_id = frame
    msg.pose.pose.position.x, msg.pose.pose.position.y = x, y
    msg.pose.pose.orientation.z = math.sin(theta / 2.0)
    msg.pose.pose.orientation.w = math.cos(theta / 2.0)
    return msg


def at(begin, seconds):
    """Return the instant `seconds` after another."""
    return begin + rospy.Duration.from_sec(seconds)


def is_stop(message):
    """Return whether a command tells the car to stand with straight wheels."""
    return not message.drive.speed and not message.drive.steering_angle
