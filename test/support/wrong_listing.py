#!/usr/bin/python3
"""The tutorial's listing with a fault: wrong_listing.py FAULT, for replays to find.

It has that one only: it waits for its subscribers and counts its commands, where the listing's
sleep and its second by the clock come short on a busy machine. The one named hold_up is none of its
own: it stops the replay for half a second, as a busy machine may, and drives on.
"""

import os
import signal
import sys
import threading

import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf.transformations import quaternion_from_euler

from mushr_ros_intro.ros.connections import wait_until_connected

FAULTS = ("crash", "hang", "hold_up", "nan", "order", "silent", "slow")

HELD_UP = 0.5
"""[s] More than a replay lets a car be late by; so far the clock came meanwhile, and the plan."""


def main(fault):
    rospy.init_node("wrong_listing")
    commands = rospy.Publisher(
        "/car/mux/ackermann_cmd_mux/input/navigation", AckermannDriveStamped, queue_size=10
    )
    placements = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=10)
    with open(rospy.get_param("~plan_file")) as plan_file:
        plan = [tuple(map(float, line.split(","))) for line in plan_file]
    if fault == "order":
        plan[2], plan[3] = plan[3], plan[2]
    assert wait_until_connected(commands, "subscribers", 30.0)
    assert wait_until_connected(placements, "subscribers", 30.0)
    if fault == "silent":
        rospy.spin()

    x, y, theta = plan[0]
    placement = PoseWithCovarianceStamped()
    position, orientation = placement.pose.pose.position, placement.pose.pose.orientation
    position.x, position.y = x, y
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion_from_euler(0, 0, theta)
    if fault == "hold_up":
        os.kill(os.getppid(), signal.SIGSTOP)
        threading.Timer(HELD_UP, os.kill, [os.getppid(), signal.SIGCONT]).start()
    placements.publish(placement)
    for row, (speed, steering_angle) in enumerate(plan[1:], 1):
        if fault == "crash" and row == 3:
            raise IndexError("list index out of range \x1b[0m")  # no character for XML
        if fault == "hang" and row == 3:
            rospy.spin()
        if fault == "nan" and row == 3:
            speed = float("nan")
        drive = AckermannDrive(speed=speed, steering_angle=steering_angle)
        frequency = 1 if fault == "slow" else 10
        rate = rospy.Rate(frequency)
        for _ in range(frequency):
            commands.publish(AckermannDriveStamped(drive=drive))
            rate.sleep()


if __name__ == "__main__":
    assert sys.argv[1] in FAULTS
    main(sys.argv[1])
