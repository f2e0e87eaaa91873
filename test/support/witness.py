"""Print every command to the car and every pose of the car."""

import sys

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry import planar
from geometry_msgs.msg import PoseStamped


def show(what, msg, *numbers):
    words = (what, str(msg.header.stamp.to_nsec()), *map(float.hex, numbers))
    sys.stdout.write(" ".join(words) + "\n")  # one call, because each topic has a thread


def on_command(msg):
    show("command", msg, msg.drive.speed, msg.drive.steering_angle)


def on_pose(msg):
    show("pose", msg, *planar(msg.pose))


if __name__ == "__main__":
    rospy.init_node("witness")
    output = "/car/mux/ackermann_cmd_mux/output"
    rospy.Subscriber(output, AckermannDriveStamped, on_command, tcp_nodelay=True)
    rospy.Subscriber("/car/car_pose", PoseStamped, on_pose, tcp_nodelay=True)
    rospy.spin()
