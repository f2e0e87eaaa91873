#!/usr/bin/python3
"""A student's node: drive the plan in the file ~plan_file."""

import math

import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped


def read_plan(path):
    with open(path) as file:
        lines = [line.split("#")[0].strip() for line in file]
    return [tuple(map(float, line.split(","))) for line in lines if line]


def publisher(topic, kind):
    made = rospy.Publisher(topic, kind, queue_size=10)
    while not made.get_num_connections():
        rospy.sleep(0.1)
    return made


def send_start(placements, x, y, theta):
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = rospy.Time.now()
    msg.header.frame_id = "map"
    msg.pose.pose.position.x, msg.pose.pose.position.y = x, y
    msg.pose.pose.orientation.z = math.sin(theta / 2.0)
    msg.pose.pose.orientation.w = math.cos(theta / 2.0)
    placements.publish(msg)


def send_command(commands, speed, steering_angle):
    msg = AckermannDriveStamped()
    msg.header.stamp = rospy.Time.now()
    msg.drive.speed, msg.drive.steering_angle = speed, steering_angle
    commands.publish(msg)


def main():
    rospy.init_node("drive_plan")
    start, *rows = read_plan(rospy.get_param("~plan_file"))
    placements = publisher("/initialpose", PoseWithCovarianceStamped)
    commands = publisher("/car/mux/ackermann_cmd_mux/input/navigation", AckermannDriveStamped)
    send_start(placements, *start)
    rate = rospy.Rate(10)
    for row in rows:
        for _ in range(10):
            rate.sleep()
            send_command(commands, *row)
    rate.sleep()
    send_command(commands, 0.0, 0.0)


if __name__ == "__main__":
    main()
